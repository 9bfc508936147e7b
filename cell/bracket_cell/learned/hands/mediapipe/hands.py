"""MediaPipe's hands in images: the palm network where hands are missing, the landmark network on each hand."""

from __future__ import annotations

import math
import os
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import cycle
from pathlib import Path
from typing import Literal

import cv2
import numpy as np
from numpy.typing import NDArray

from bracket_cell.learned.hands.mediapipe.palms import (
    LEAST_SCORE,
    PLAIN,
    Roi,
    Tint,
    find_palms,
    overlaps,
    square,
    wrapped,
)
from bracket_cell.learned.hands.regions import Image
from bracket_cell.learned.inference.onnx_model import OnnxModel
from bracket_ground.interfaces.pose import Array

INPUT_PX = 224
LEAST_PRESENCE = 0.5
OF_PALM = (0, 1, 2, 3, 5, 6, 9, 10, 13, 14, 17, 18)  # what the next region is made from
WRIST, THUMB_TIP, INDEX_TIP = 0, 4, 8
INDEX_BASE, MIDDLE_BASE, RING_BASE, LITTLE_BASE = 5, 9, 13, 17
SHIFT, SCALE = -0.1, 2.0


@dataclass(frozen=True, eq=False)
class Landmarks:
    """A hand in an image.

    Attributes:
        points_px: (21, 2) column and row: wrist, then four each of thumb, index, middle, ring and little finger.
        world_m: (21, 3) about the hand's middle, as the network guesses its size.
        presence: from 0 to 1.
        left: probability that it is a left hand, as one sees it: not mirrored like a selfie.
    """

    points_px: Array
    world_m: Array
    presence: float
    left: float

    @property
    def roi(self) -> Roi:
        """The square in which it should be in the next image."""
        points = self.points_px
        towards = ((points[INDEX_BASE] + points[RING_BASE]) / 2 + points[MIDDLE_BASE]) / 2 - points[WRIST]
        turn = wrapped(math.pi / 2 - math.atan2(-towards[1], towards[0]))
        cosine, sine = math.cos(turn), math.sin(turn)
        back = np.array([[cosine, -sine], [sine, cosine]])
        straight = points[list(OF_PALM)] @ back
        low, high = straight.min(axis=0), straight.max(axis=0)
        width, height = high - low
        centre = ((low + high) / 2 + np.array([0.0, SHIFT * height])) @ back.T
        return Roi(centre, SCALE * float(max(width, height)), turn)


def read_landmarks(network: OnnxModel, image: Image, roi: Roi, tint: Tint = PLAIN) -> Landmarks:
    """The hand in a square of an RGB image; its presence says whether there is one."""
    answer = network.run({"image": warped(image, roi) * np.array(tint, np.float32)})
    points = answer["Identity"].astype(np.float64).reshape(21, 3)
    return Landmarks(
        points_px=roi.outside(points[:, :2] / INPUT_PX - 0.5),
        world_m=answer["Identity_3"].astype(np.float64).reshape(21, 3),
        presence=float(answer["Identity_1"].item()),
        left=1 - float(answer["Identity_2"].item()),
    )


def warped(image: Image, roi: Roi) -> NDArray[np.float32]:
    """A square (1, 224, 224, 3), 0 to 1, corner to corner; beyond the image its edge goes on."""
    corners = roi.outside(np.array([[-0.5, -0.5], [0.5, -0.5], [-0.5, 0.5]])).astype(np.float32)
    onto = cv2.getAffineTransform(corners, np.array([[0, 0], [INPUT_PX, 0], [0, INPUT_PX]], np.float32))
    return square(image, onto, INPUT_PX, cv2.BORDER_REPLICATE)


Size = Literal["lite", "full"]
Network = Literal["palm", "landmark"]
SIZES: tuple[Size, ...] = ("lite", "full")
PALM_KIND, LANDMARK_KIND = "hands.mediapipe_palm", "hands.mediapipe_landmark"
ON_THE_BENCH: Size = "lite"
FETCH = "make hands, or: cell lab hands"


def model_folder() -> Path:
    """The user's folder of fetched networks: below XDG_CACHE_HOME, or ~/.cache."""
    cache = os.environ.get("XDG_CACHE_HOME")
    return (Path(cache) if cache else Path.home() / ".cache") / "cell" / "mediapipe"


def network_file(folder: Path, network: Network, size: Size) -> Path:
    """File of one network in a folder."""
    return folder / f"{network}_{size}.onnx"


def folder_in_use(path: Path) -> Path:
    """The folder whose networks are used: that of `path` where they are there, else the user's cache."""
    return path.parent if path.name.startswith("landmark") and path.is_file() else model_folder()


MOST_HANDS = 2
SAME_OVERLAP = 0.5  # of two squares about one hand


class MediaPipeHands:
    """The two networks.

    Args:
        folder: where they were written to by `cell lab hands`.
        least_score: of a palm that the landmark network is to look at.
        tints: in which the networks see an image, one after the other until they see a hand.

    Raises:
        ModelError: they are not there.
    """

    def __init__(
        self,
        folder: Path,
        size: Size,
        most_hands: int = MOST_HANDS,
        least_score: float = LEAST_SCORE,
        tints: Sequence[Tint] = (PLAIN,),
    ) -> None:
        self._palms = OnnxModel.load(network_file(folder, "palm", size), PALM_KIND)
        self._landmarks = OnnxModel.load(network_file(folder, "landmark", size), LANDMARK_KIND)
        self._most, self._least_score, self._tints = most_hands, least_score, tints
        self._rois: list[Roi] = []
        self._next_tints = cycle([tint] for tint in tints)

    def picture(self, image: Image) -> list[Landmarks]:
        """All hands of a single RGB image."""
        return self.within(image, self._found(image, self._tints))

    def frame(self, image: Image) -> list[Landmarks]:
        """All hands of the next RGB image of a stream; palms are looked for while hands are missing, in one tint."""
        rois = self._rois
        if len(rois) < self._most:
            rois = apart([*rois, *self._found(image, next(self._next_tints))])[: self._most]
        hands = self.within(image, rois)
        self._rois = apart([hand.roi for hand in hands])
        return hands

    def landmarks(self, image: Image, roi: Roi) -> Landmarks:
        """What a square shows; its presence says whether that is a hand."""
        return read_landmarks(self._landmarks, image, roi, PLAIN)

    def _found(self, image: Image, tints: Sequence[Tint]) -> list[Roi]:
        """Squares about palms, of each tint the surest first."""
        found = (find_palms(self._palms, image, self._least_score, tint)[: self._most] for tint in tints)
        return apart([palm.roi for palms in found for palm in palms])

    def within(self, image: Image, rois: Sequence[Roi]) -> list[Landmarks]:
        """The hands of an RGB image that squares show."""
        hands = (self._seen(image, roi) for roi in rois)
        return [hand for hand in hands if hand is not None]

    def _seen(self, image: Image, roi: Roi) -> Landmarks | None:
        """The hand in a square, by the first tint that shows one."""
        seen = (read_landmarks(self._landmarks, image, roi, tint) for tint in self._tints)
        return next((hand for hand in seen if hand.presence >= LEAST_PRESENCE), None)


def apart(rois: Sequence[Roi]) -> list[Roi]:
    """Without the later ones of squares that overlap."""
    kept: list[Roi] = []
    for roi in rois:
        if not kept or float(overlaps(_box(roi), np.stack([_box(other) for other in kept])).max()) <= SAME_OVERLAP:
            kept.append(roi)
    return kept


def _box(roi: Roi) -> Array:
    """Upright corners (2, 2): MediaPipe compares squares as if they were not turned."""
    half = roi.side_px / 2
    return np.stack([roi.centre_px - half, roi.centre_px + half])
