"""A camera's lens from a ChArUco board that is shown to it (Garrido-Jurado et al., 2014; Zhang's calibration, 2000)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray
from pydantic import ValidationError, field_validator, model_validator

from bracket_ground.files.model import Disagreement, Model
from bracket_ground.files.units import Length
from bracket_ground.interfaces.intrinsics import Lens
from bracket_ground.interfaces.pose import Array

DICTIONARIES = tuple(sorted(name for name in dir(cv2.aruco) if name.startswith("DICT_")))
LEAST_CORNERS = 8  # that a view needs
VIEWS = 15  # that are collected
STILL_PX = 1.0  # that corners move at most between two images of a board that stands still
MOVED = 0.06  # share of the image's width by which the corners of a view must have moved from those of each other
MOST_RMS_PX = 1.0  # a worse fit is none
MOST_FOCAL, MOST_MIDDLE_PX = 0.005, 3.0  # deviations of focal length (share) and principal point: else views are alike
TILTED_RAD, LEAST_TILTED = 0.25, 5  # of a view against the image, and of how many
MORE = "tilt the board more, to all sides, near and far, into the image's corners"


class CharucoBoard(Model):
    """A printed ChArUco board, flat on something stiff.

    Attributes:
        squares: columns and rows of the chessboard.
        square_m: side of a square, as measured on the print.
        marker_m: side of a marker.
        dictionary: of the markers, as OpenCV names it.
        legacy: boards that OpenCV before 4.6 printed with an even number of rows.
    """

    squares: tuple[int, int]
    square_m: Length
    marker_m: Length
    dictionary: str = "DICT_5X5_250"
    legacy: bool = False

    @field_validator("squares")
    @classmethod
    def _has_corners(cls, value: tuple[int, int]) -> tuple[int, int]:
        columns, rows = value
        if not (3 <= columns <= 40 and 3 <= rows <= 40 and (columns - 1) * (rows - 1) >= LEAST_CORNERS):
            raise ValueError(f"must be 3 to 40 each, with {LEAST_CORNERS} inner corners")
        return value

    @field_validator("dictionary")
    @classmethod
    def _is_known(cls, value: str) -> str:
        if value not in DICTIONARIES:
            raise ValueError(f"legal: {', '.join(DICTIONARIES)}")
        return value

    @model_validator(mode="after")
    def _markers_fit(self) -> CharucoBoard:
        if self.marker_m >= self.square_m:
            raise Disagreement([(("marker_m",), f"must be less than square_m, {self.square_m:g}")])
        columns, rows = self.squares
        wanted, most = columns * rows // 2, len(self._dictionary.bytesList)
        if wanted > most:
            raise Disagreement([(("dictionary",), f"has {most} markers, the board {wanted}: take a larger one")])
        return self

    @property
    def _dictionary(self) -> cv2.aruco.Dictionary:
        return cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, self.dictionary))

    @property
    def opencv(self) -> cv2.aruco.CharucoBoard:
        board = cv2.aruco.CharucoBoard(self.squares, self.square_m, self.marker_m, self._dictionary)
        board.setLegacyPattern(self.legacy)
        return board


@dataclass(frozen=True, eq=False)
class View:
    """Corners of a board in one image.

    Attributes:
        corners: (n,) which inner corners of the board these are.
        pixels: (n, 2) where they are seen.
    """

    corners: NDArray[np.int32]
    pixels: Array

    def moved_px(self, other: View) -> float:
        """How far corners that both show are apart, in the mean; infinite where there are none."""
        _, mine, its = np.intersect1d(self.corners, other.corners, return_indices=True)
        if not len(mine):
            return float("inf")
        return float(np.linalg.norm(self.pixels[mine] - other.pixels[its], axis=1).mean())


class BoardReader:
    """Finds a board in images, and keeps the views that differ from each other."""

    def __init__(self, board: CharucoBoard) -> None:
        self._board = board.opencv
        self._detector = cv2.aruco.CharucoDetector(self._board)
        self._size_px = (0, 0)
        self._before: View | None = None
        self.views: list[View] = []

    def read(self, image: NDArray[np.uint8]) -> View | None:
        """The board in an image (h, w, 3); None where too little of it is seen."""
        pixels, corners, _, _ = self._detector.detectBoard(cv2.cvtColor(image, cv2.COLOR_RGB2GRAY))
        if corners is None or len(corners) < LEAST_CORNERS:
            return None
        return View(np.ravel(corners), np.reshape(pixels, (-1, 2)).astype(np.float64))

    def add(self, image: NDArray[np.uint8]) -> bool:
        """Keep what an image shows, where the board stands still, elsewhere than before; whether it was kept."""
        before, self._before = self._before, self.read(image)
        view, wide = self._before, image.shape[1]
        if view is None or before is None or view.moved_px(before) > STILL_PX:
            return False
        if any(view.moved_px(kept) < MOVED * wide for kept in self.views):
            return False
        self.keep(view, (wide, image.shape[0]))
        return True

    def keep(self, view: View, size_px: tuple[int, int]) -> None:
        """Keep a view of an image of this size."""
        self._size_px = size_px
        self.views.append(view)

    def lens(self) -> tuple[Lens, float]:
        """Focal lengths, principal point and distortion under which all views are of one flat board.

        Returns:
            the lens, and the root mean square of what corners are off [px].

        Raises:
            ValueError: the views do not tell it; in words, with what to do.
        """
        if len(self.views) < VIEWS:
            raise ValueError(f"{len(self.views)} views of the board were seen, {VIEWS} are needed: {MORE}")
        corners = np.asarray(self._board.getChessboardCorners(), np.float32)
        points = [corners[view.corners] for view in self.views]
        return _lens(points, [view.pixels.astype(np.float32) for view in self.views], self._size_px)


def _lens(
    points: Sequence[NDArray[np.float32]], pixels: Sequence[NDArray[np.float32]], size_px: tuple[int, int]
) -> tuple[Lens, float]:
    """As `BoardReader.lens`. Views that are hardly tilted fit nearly any focal length (Zhang, 2000, section 5)."""
    try:
        found = cv2.calibrateCameraExtended(points, pixels, size_px, np.eye(3), np.zeros(5))
        rms_px, matrix, bends, turns, _, spread, _, _ = found
        lens = Lens.opencv(matrix, bends)
    except (cv2.error, ValidationError) as error:
        raise ValueError(f"no lens sees the board so: is it flat, and its file right? {MORE}") from error
    tilted = sum(abs(float(cv2.Rodrigues(turn)[0][2, 2])) < np.cos(TILTED_RAD) for turn in turns)
    fx, fy, cx, cy = np.ravel(spread)[:4]
    if rms_px > MOST_RMS_PX:
        raise ValueError(f"corners are {rms_px:.1f} pixels off what any lens explains: is the board flat and sharp?")
    if tilted < LEAST_TILTED:
        raise ValueError(f"the board is tilted in {tilted} views, must be in {LEAST_TILTED}: {MORE}")
    if max(fx, fy) > MOST_FOCAL * lens.focal_px or max(cx, cy) > MOST_MIDDLE_PX:
        off = f"focal length {lens.focal_px:.0f} +- {max(fx, fy):.0f} px"
        raise ValueError(f"the views are too much alike ({off}): {MORE}")
    return lens, float(rms_px)
