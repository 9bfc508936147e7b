"""A lens is found from drawn images of a ChArUco board, and nothing is told by too few or too like views."""

from __future__ import annotations

import re
from collections.abc import Iterator
from itertools import islice
from pathlib import Path

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from bracket_cell.learned.calibration.board import VIEWS, BoardReader, CharucoBoard, View
from bracket_cell.runs.calibrating import shown_lens
from bracket_ground.errors import DeviceFault, InputError
from bracket_ground.files.yaml_file import load_yaml
from bracket_ground.interfaces.camera_model import CameraModel
from bracket_ground.interfaces.frame import Frame
from bracket_ground.interfaces.pose import Pose

TRUE = CameraModel(640, 480, 612.0, 0.12, -0.21, 606.5, (311.2, 246.9), 1.3e-3, -0.8e-3, 0.05)
BOARD = CharucoBoard(squares=(9, 6), square_m=0.03, marker_m=0.022)
PRINT_PX_M = 3000.0
NOWHERE = Pose((0.0, 0.0, 0.0))

Image = NDArray[np.uint8]
Place = tuple[tuple[float, float, float], tuple[float, float, float]]


def drawn(turn: tuple[float, float, float], middle_m: tuple[float, float, float], noise: float = 2.0) -> Image:
    """The board as this camera sees it: each pixel's ray meets the print."""
    wide, high = (count * BOARD.square_m for count in BOARD.squares)
    printed = BOARD.opencv.generateImage((round(wide * PRINT_PX_M), round(high * PRINT_PX_M)))
    printed = cv2.GaussianBlur(printed, (0, 0), 2.0)
    rotation = cv2.Rodrigues(np.array(turn))[0]
    rows, columns = np.mgrid[0 : TRUE.height_px, 0 : TRUE.width_px]
    pixels = np.column_stack([columns.ravel(), rows.ravel()]).astype(float)
    rays = np.column_stack([TRUE.normalised(TRUE.straightened(pixels)), np.ones(len(pixels))])
    along = (rotation[:, 2] @ np.array(middle_m)) / (rays @ rotation[:, 2])
    on_board = (along[:, None] * rays - np.array(middle_m)) @ rotation[:, :2] + [wide / 2, high / 2]
    at = (on_board * PRINT_PX_M - 0.5).astype(np.float32).reshape(TRUE.height_px, TRUE.width_px, 2)
    image = cv2.remap(printed, at[..., 0], at[..., 1], cv2.INTER_LINEAR, borderValue=140.0)
    noisy = image + np.random.default_rng(0).normal(0, noise, image.shape)
    return np.repeat(np.clip(noisy, 0, 255).astype(np.uint8)[..., None], 3, axis=2)


def places(tilt_rad: float) -> Iterator[Place]:
    """Where a person holds it: turned to all sides, near and far."""
    rng = np.random.default_rng(7)
    while True:
        x, y, z = *rng.uniform((-0.13, -0.1), (0.13, 0.1)), rng.uniform(0.35, 0.6)
        turn = rng.uniform(-tilt_rad, tilt_rad, 3)
        yield (float(turn[0]), float(turn[1]), float(turn[2])), (float(x), float(y), float(z))


@pytest.fixture(scope="module")
def images() -> list[Image]:
    """Of a board that is shown well, each twice."""
    return [image for place in islice(places(0.5), VIEWS + 5) for image in [drawn(*place)] * 2]


def reader_of(tilt_rad: float, noise_px: float = 0.1, bent_m: float = 0.0) -> BoardReader:
    """A reader of corners that were projected."""
    reader, rng = BoardReader(BOARD), np.random.default_rng(1)
    corners = np.array(BOARD.opencv.getChessboardCorners(), np.float64)
    corners -= corners.mean(axis=0)
    corners[:, 2] = bent_m * (corners[:, 0] / corners[:, 0].max()) ** 2
    for turn, middle_m in islice(places(tilt_rad), VIEWS):
        seen = corners @ cv2.Rodrigues(np.array(turn))[0].T + middle_m
        pixels = TRUE.project(NOWHERE, seen) + rng.normal(0, noise_px, (len(corners), 2))
        reader.keep(View(np.arange(len(corners), dtype=np.int32), pixels), (TRUE.width_px, TRUE.height_px))
    return reader


def test_the_lens_is_found_from_drawn_images(images: list[Image]) -> None:
    reader = BoardReader(BOARD)
    for image in images:
        reader.add(image)
    lens, rms_px = reader.lens()
    assert rms_px < 0.3
    assert (lens.focal_px, lens.focal_y_px) == pytest.approx(tuple(TRUE.focals_px), rel=0.004)
    assert lens.principal_px == pytest.approx(tuple(TRUE.middle_px), abs=2.0)
    grid = np.stack(np.meshgrid(np.linspace(-0.4, 0.4, 9), np.linspace(-0.3, 0.3, 7), [1.0]), axis=-1).reshape(-1, 3)
    found = CameraModel(640, 480, **lens.model_dump())
    assert np.abs(found.project(NOWHERE, grid) - TRUE.project(NOWHERE, grid)).max() < 2.0


def test_a_board_that_moves_or_stays_where_it_was_gives_no_view() -> None:
    reader = BoardReader(BOARD)
    still, moved = drawn((0.1, 0.2, 0.0), (0.0, 0.0, 0.5)), drawn((0.1, 0.2, 0.0), (0.01, 0.0, 0.5))
    assert [reader.add(image) for image in (still, moved, still, still, still)] == [False, False, False, True, False]


def test_corners_tell_the_lens_as_well_as_they_were_seen() -> None:
    lens, _ = reader_of(0.5).lens()
    assert lens.focal_px == pytest.approx(TRUE.focal_px, abs=3 * 0.7)


@pytest.mark.parametrize(
    ("views", "said"),
    [
        ({"tilt_rad": 0.01}, "the board is tilted in 0 views, must be in 5: tilt the board more"),
        ({"tilt_rad": 0.25, "noise_px": 0.6}, "tilt the board more"),
        ({"tilt_rad": 0.5, "bent_m": 0.03}, "pixels off what any lens explains: is the board flat and sharp?"),
    ],
)
def test_views_that_tell_no_lens_are_refused(views: dict[str, float], said: str) -> None:
    with pytest.raises(ValueError, match=re.escape(said)):
        reader_of(**views).lens()


class Clock:
    time_s = 0.0

    def now_s(self) -> float:
        return self.time_s

    def sleep_until(self, time_s: float) -> None:
        self.time_s = time_s


class Drawn:
    def __init__(self, images: Iterator[Image]) -> None:
        self.images, self.number = images, 0
        self.frame: Frame | None = None

    def trigger(self) -> None:
        self.number += 1
        self.frame = Frame("overhead", self.number, self.number / 15, next(self.images), NOWHERE)

    def latest(self) -> Frame | None:
        return self.frame


def test_a_person_is_told_how_to_show_the_board(images: list[Image]) -> None:
    said: list[str] = []
    lens = shown_lens(Drawn(iter(images)), Clock(), BOARD, "overhead", said.append)
    assert lens.focal_px == pytest.approx(TRUE.focal_px, rel=0.004)
    assert said[0].startswith("hold the board before the overhead camera, still, in 15 places: tilt")
    assert "view 15 of 15" in said


def test_a_board_that_nobody_shows_is_given_up() -> None:
    grey = np.full((480, 640, 3), 90, np.uint8)
    with pytest.raises(DeviceFault, match="0 views of the board were seen, 15 are needed: tilt"):
        shown_lens(Drawn(iter([grey] * 10_000)), Clock(), BOARD, "overhead", lambda _: None)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("squares: [9, 6]\nsquare_m: 0.03\nmarker_m: 0.04\n", "board.yaml:3:11: must be less than square_m, 0.03"),
        ("squares: [9]\nsquare_m: 0.03\nmarker_m: 0.02\n", "board.yaml:1:"),
        ("squares: [2, 6]\nsquare_m: 0.03\nmarker_m: 0.02\n", "board.yaml:1:10: squares: must be 3 to 40 each"),
        (
            "squares: [9, 6]\nsquare_m: 0.03\nmarker_m: 0.02\ndictionary: ARUCO\n",
            "board.yaml:4:13: dictionary: legal: ",
        ),
        (
            "squares: [19, 16]\nsquare_m: 0.03\nmarker_m: 0.02\ndictionary: DICT_4X4_50\n",
            "board.yaml:4:13: has 50 markers, the board 152: take a larger one",
        ),
    ],
)
def test_a_board_that_cannot_be_is_refused(tmp_path: Path, text: str, said: str) -> None:
    (tmp_path / "board.yaml").write_text(text)
    with pytest.raises(InputError) as error:
        load_yaml(tmp_path / "board.yaml", CharucoBoard)
    assert said in str(error.value)
