"""`cell doctor` compares the lens that CameraInfo tells with the bench file's."""

from __future__ import annotations

from types import SimpleNamespace

import pytest

from bracket_cell.configuration import load_configuration
from bracket_cell.plant.ros_camera import _lens
from bracket_cell.skills.drivers.settings import Ros2CameraSettings

BENCH = load_configuration().bench
WITH_LENS = {"focal_px": 530.0, "focal_y_px": 533.0, "principal_px": (262.0, 170.0), "distortion_k1": -0.1}


def remedy(topic: str = "/camera/image_raw", lens: dict[str, object] | None = None, **told: object) -> str:
    """What is said of a camera with such a lens whose node tells as much, or something else."""
    overhead = BENCH.overhead.model_copy(update=WITH_LENS if lens is None else lens)
    matrix, (width, height) = overhead.model.matrix, (overhead.width_px, overhead.height_px)
    k, p = matrix.ravel().tolist(), [*matrix[0], 0.0, *matrix[1], 0.0, *matrix[2], 0.0]
    info = {"width": width, "height": height, "k": k, "p": p, "distortion_model": "plumb_bob"}
    info |= {"d": list(overhead.model.distortion), **told}
    bench = BENCH.model_copy(update={"overhead": overhead})
    return _lens(SimpleNamespace(**info), bench, "overhead", Ros2CameraSettings(topic=topic)).remedy


def test_a_lens_as_the_bench_file_has_it_is_well() -> None:
    assert remedy() == ""
    assert remedy(lens={}) == ""
    assert remedy(d=[-0.1, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0], distortion_model="rational_polynomial") == ""


@pytest.mark.parametrize(
    ("told", "said"),
    [
        ({"width": 640}, "the bench file says 480 x 360"),
        ({"k": [530.0, 0, 262, 0, 560, 170, 0, 0, 1]}, "the bench file says focal_px: 530, focal_y_px: 533"),
        ({"k": [530.0, 0, 239.5, 0, 533, 179.5, 0, 0, 1]}, "the bench file says principal_px: [262, 170]"),
        ({"d": [0.0] * 5}, "the bench file says k1, k2, p1, p2, k3 = -0.1, 0, 0, 0, 0; its images 0, 0, 0, 0, 0"),
        ({"distortion_model": "equidistant"}, "its distortion is 'equidistant': publish rectified images"),
        ({"d": [-0.1, 0, 0, 0, 0, 0.5, 0, 0]}, "its distortion is 'plumb_bob': publish rectified images"),
    ],
)
def test_another_lens_is_told(told: dict[str, object], said: str) -> None:
    assert remedy(**told) == said  # type: ignore[arg-type]


def test_of_rectified_images_only_the_new_matrix_counts() -> None:
    straight = {**WITH_LENS, "distortion_k1": 0.0}
    assert remedy("/camera/image_rect_color", straight, d=[-0.1, 0.0, 0.0, 0.0, 0.0], k=[0.0] * 9) == ""
