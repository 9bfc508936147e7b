"""A camera's lens from the files of other programs: ROS's camera_info and OpenCV's FileStorage."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest

from bracket_ground.errors import InputError
from bracket_ground.files.yaml_file import load_yaml
from bracket_ground.interfaces.bench import CameraSetup

MATRIX = np.array([[612.0, 0.0, 301.2], [0.0, 609.5, 251.9], [0.0, 0.0, 1.0]])
BENDS = np.array([0.12, -0.21, 1.3e-3, -0.8e-3, 0.05])
ROS = """\
image_width: 640
image_height: 480
camera_name: narrow_stereo
camera_matrix: {rows: 3, cols: 3, data: [612.0, 0.0, 301.2, 0.0, 609.5, 251.9, 0.0, 0.0, 1.0]}
distortion_model: plumb_bob
distortion_coefficients:
  rows: 1
  cols: 5
  data: [0.12, -0.21, 0.0013, -0.0008, 0.05]
rectification_matrix: {rows: 3, cols: 3, data: [1, 0, 0, 0, 1, 0, 0, 0, 1]}
"""
CAMERA = "intrinsics: lens.yaml\nrate_hz: 15.0\nmount: {position_m: [0.8, 0.0, 1.4]}\n"


def camera(folder: Path, text: str, keys: str = CAMERA) -> CameraSetup:
    (folder / "lens.yaml").write_text(text)
    (folder / "camera.yaml").write_text(keys)
    return load_yaml(folder / "camera.yaml", CameraSetup)


def refused(folder: Path, text: str, keys: str = CAMERA) -> str:
    with pytest.raises(InputError) as error:
        camera(folder, text, keys)
    return str(error.value).replace(f"{folder}/", "")


def is_it(setup: CameraSetup) -> bool:
    same = np.allclose(setup.model.matrix, MATRIX) and np.allclose(setup.model.distortion, BENDS)
    return same and (setup.width_px, setup.height_px) == (640, 480)


def test_camera_info_of_ros_is_a_lens(tmp_path: Path) -> None:
    assert is_it(camera(tmp_path, ROS))


def test_camera_info_as_a_topic_shows_it_is_a_lens(tmp_path: Path) -> None:
    k, d = MATRIX.ravel().tolist(), BENDS.tolist()
    assert is_it(camera(tmp_path, f"width: 640\nheight: 480\ndistortion_model: plumb_bob\nd: {d}\nk: {k}\n"))


@pytest.mark.parametrize("names", [("camera_matrix", "distortion_coefficients"), ("cameraMatrix", "distCoeffs")])
def test_a_file_that_opencv_wrote_is_a_lens(tmp_path: Path, names: tuple[str, str]) -> None:
    path = str(tmp_path / "written.yml")
    storage = cv2.FileStorage(path, cv2.FILE_STORAGE_WRITE)
    storage.write("image_width", 640)
    storage.write("image_height", 480)
    storage.write(names[0], MATRIX)
    storage.write(names[1], BENDS.reshape(1, 5))
    storage.release()
    assert is_it(camera(tmp_path, Path(path).read_text()))


def test_a_file_without_a_size_takes_the_cameras_own(tmp_path: Path) -> None:
    text = "\n".join(ROS.splitlines()[2:])
    assert is_it(camera(tmp_path, text, f"width_px: 640\nheight_px: 480\n{CAMERA}"))
    assert "key 'width_px' is missing" in refused(tmp_path, text)


def test_what_was_read_needs_no_file_again(tmp_path: Path) -> None:
    setup = camera(tmp_path, ROS)
    (tmp_path / "lens.yaml").unlink()
    assert CameraSetup.model_validate(setup.model_dump()) == setup


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ("612.0, 0.0, 301.2, ", "612.0, ", "lens.yaml:4:"),
        ("[612.0, 0.0,", "[612.0, 0.3,", "lens.yaml:4:16: must be fx, 0, cx, 0, fy, cy, 0, 0, 1"),
        ("[612.0,", "[2.0,", "lens.yaml:4:16: focal_px: input should be greater than or equal to 10, not 2.0"),
        ("[612.0,", "[many,", "lens.yaml:4:42: camera_matrix.data.0: input should be a number"),
        (
            "plumb_bob",
            "equidistant",
            "lens.yaml:5:19: a lens of the model 'equidistant' is not known; legal: plumb_bob",
        ),
        ("0.05]", "0.05, 0.3]", "lens.yaml:6:1: only k1, k2, p1, p2, k3 are known, and one behind them is not 0"),
        ("0.05]", "0.9]", "lens.yaml:6:1: distortion_k3: input should be less than or equal to 0.5, not 0.9"),
        ("camera_matrix", "matrix_of", "lens.yaml:1:1: key 'camera_matrix' is missing"),
    ],
)
def test_a_file_of_no_such_lens_is_refused_with_its_line(tmp_path: Path, old: str, new: str, said: str) -> None:
    assert said in refused(tmp_path, ROS.replace(old, new))


def test_two_words_for_a_lens_are_refused(tmp_path: Path) -> None:
    said = refused(tmp_path, ROS, f"{CAMERA}focal_px: 600.0\n")
    assert said == "camera.yaml:4:11: is in lens.yaml, too: leave out one of them"
    said = refused(tmp_path, ROS, f"width_px: 1280\n{CAMERA}")
    assert said == "camera.yaml:1:11: lens.yaml is of images of 640 x 480 px: calibrate it at the size that is used"


def test_a_file_that_is_not_there_is_told(tmp_path: Path) -> None:
    (tmp_path / "camera.yaml").write_text(CAMERA)
    with pytest.raises(InputError, match=r"lens\.yaml"):
        load_yaml(tmp_path / "camera.yaml", CameraSetup)
