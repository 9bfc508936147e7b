"""Poses of parts come back from images that were drawn with them."""

import math

import numpy as np
import pytest

from bracket_cell.learned.classical.box_model import View, outline
from bracket_cell.learned.classical.part_detector import ClassicalPartDetector
from bracket_cell.learned.classical.silhouette import Silhouette
from bracket_ground.errors import DeviceFault
from bracket_ground.interfaces.frame import Frame
from bracket_ground.interfaces.perception import PartDetection
from bracket_ground.interfaces.pose import Pose
from tests.learned.classical.scenes import BENCH, PRODUCT, Canvas, Standing

LOOK = Pose((*BENCH.tray.centre_m[:2], 0.52), (0.0, 0.7071067811865476, 0.7071067811865476, 0.0))


def on_tray(name: str, x_m: float, y_m: float, yaw_rad: float) -> Standing:
    """A part that stands in the tray, off its centre by (x, y)."""
    x, y, z = BENCH.tray.centre_m
    return name, x + x_m, y + y_m, yaw_rad, z + PRODUCT.parts[name].peg_length_m


def detect(parts: list[Standing], seed: int = 0, gain: float = 1.0) -> tuple[PartDetection, ...]:
    canvas = Canvas(View(BENCH.wrist.model, LOOK), grey=70)
    canvas.parts(parts)
    image = canvas.image(np.random.default_rng(seed), gain=gain)
    return ClassicalPartDetector(BENCH, PRODUCT).detect(Frame("wrist", 0, 0.0, image, LOOK))


def error(found: PartDetection, part: Standing) -> tuple[float, float]:
    x_m, y_m, z_m = found.world_from_part.position_m
    turn = found.world_from_part.yaw_rad - part[3]
    return math.dist((x_m, y_m, z_m), (part[1], part[2], part[4])), abs((turn + math.pi / 2) % math.pi - math.pi / 2)


@pytest.mark.parametrize("name", list(PRODUCT.parts))
def test_a_part_alone_is_found_where_it_stands(name: str) -> None:
    rng = np.random.default_rng(1)
    for seed in range(6):
        x_m, y_m, yaw_rad = rng.uniform((-0.11, -0.15, -1.5), (0.11, 0.15, 1.5))
        part = on_tray(name, float(x_m), float(y_m), float(yaw_rad))
        (found,) = detect([part], seed, gain=float(rng.uniform(0.7, 1.2)))
        distance_m, turn_rad = error(found, part)
        assert found.part == name
        assert distance_m < 0.0015
        assert turn_rad < math.radians(1.5)


def test_parts_of_one_type_that_touch_are_told_apart() -> None:
    width = PRODUCT.parts["o1"].size_m[1] + 0.0005
    parts = [on_tray("o1", 0.05, 0.06 + index * width, 0.0) for index in range(3)]
    found = sorted(detect(parts), key=lambda detection: detection.world_from_part.position_m[1])
    assert len(found) == 3
    assert all(error(detection, part)[0] < 0.005 for detection, part in zip(found, parts, strict=True))


def test_a_part_behind_a_taller_one_is_found() -> None:
    parts = [on_tray("o3", 0.0, 0.03, 0.0), on_tray("o1", 0.0, 0.08, 0.0)]
    found = {detection.part: detection for detection in detect(parts)}
    assert error(found["o3"], parts[0])[0] < 0.0015
    assert error(found["o1"], parts[1])[0] < 0.005


def test_an_empty_tray_shows_nothing() -> None:
    assert detect([]) == ()


def test_a_colour_that_is_no_standing_part_is_ignored() -> None:
    x_m, y_m, z_m = BENCH.tray.centre_m
    canvas = Canvas(View(BENCH.wrist.model, LOOK), grey=70)
    for index, part in enumerate(PRODUCT.parts.values()):
        smear = np.array([[0.0, 0.0, 0.0], [0.09, 0.012, 0.0], [0.0, 0.024, 0.0]])
        canvas.polygon(smear + np.array([x_m - 0.1, y_m - 0.1 + 0.1 * index, z_m]), np.array(part.colour_rgb))
    image = canvas.image(np.random.default_rng(0))
    assert ClassicalPartDetector(BENCH, PRODUCT).detect(Frame("wrist", 0, 0.0, image, LOOK)) == ()


@pytest.mark.parametrize("name", list(PRODUCT.parts))
@pytest.mark.parametrize("turn", [-1, 1])
def test_a_part_on_its_side_is_not_taken_for_a_standing_one(name: str, turn: int) -> None:
    x_m, y_m, z_m = BENCH.tray.centre_m
    half = math.sqrt(0.5)
    lying = Pose.from_yaw((x_m + 0.05, y_m - 0.05, z_m + PRODUCT.parts[name].size_m[1] / 2), 0.4)
    canvas = Canvas(View(BENCH.wrist.model, LOOK), grey=70)
    canvas.body(name, lying @ Pose((0.0, 0.0, 0.0), (half, turn * half, 0.0, 0.0)))
    image = canvas.image(np.random.default_rng(0))
    assert ClassicalPartDetector(BENCH, PRODUCT).detect(Frame("wrist", 0, 0.0, image, LOOK)) == ()


def test_a_part_far_from_the_tray_does_not_count() -> None:
    assert detect([on_tray("o1", 0.0, 0.27, 0.0)]) == ()


def test_signed_distance_is_negative_inside_and_metric_outside() -> None:
    square = outline(np.array([[0.0, 0.0], [4.0, 0.0], [4.0, 4.0], [0.0, 4.0], [2.0, 2.0]]))
    points = np.array([[2.0, 2.0], [4.0, 2.0], [7.0, 2.0], [2.0, -1.0]])
    assert np.allclose(Silhouette([square]).distances(points), [-2.0, 0.0, 3.0, 1.0])
    beside = outline(np.array([[4.0, 1.0], [9.0, 1.0], [9.0, 3.0], [4.0, 3.0]]))
    assert np.allclose(Silhouette([square, beside]).distances(points), [-2.0, 0.0, -1.0, 1.0])


def test_a_camera_that_looks_away_sees_no_parts() -> None:
    image = np.zeros((BENCH.wrist.height_px, BENCH.wrist.width_px, 3), np.uint8)
    sideways = Pose((0.2, -0.38, 0.3), (0.5, -0.5, 0.5, -0.5))
    upwards = Pose((*BENCH.tray.centre_m[:2], 0.5))
    for pose in (sideways, upwards):
        assert ClassicalPartDetector(BENCH, PRODUCT).detect(Frame("wrist", 0, 0.0, image, pose)) == ()


def test_an_image_of_the_wrong_size_is_a_fault_of_the_camera() -> None:
    image = np.zeros((120, 160, 3), np.uint8)
    with pytest.raises(DeviceFault, match="160 x 120"):
        ClassicalPartDetector(BENCH, PRODUCT).detect(Frame("wrist", 0, 0.0, image, LOOK))
