"""MediaPipe's hands in images: the palm network where hands are missing, the landmark network on each hand."""

from __future__ import annotations

import os
from collections.abc import Sequence
from pathlib import Path
from typing import Literal

import numpy as np

from cell.interfaces.pose import Array
from learned.hands.mediapipe.landmarks import LEAST_PRESENCE, Landmarks, read_landmarks
from learned.hands.mediapipe.palms import Roi, find_palms, overlaps
from learned.hands.regions import Image
from learned.inference.onnx_model import OnnxModel

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

    Raises:
        ModelError: they are not there.
    """

    def __init__(self, folder: Path, size: Size, most_hands: int = MOST_HANDS) -> None:
        self._palms = OnnxModel.load(network_file(folder, "palm", size), PALM_KIND)
        self._landmarks = OnnxModel.load(network_file(folder, "landmark", size), LANDMARK_KIND)
        self._most = most_hands
        self._rois: list[Roi] = []

    def picture(self, image: Image) -> list[Landmarks]:
        """All hands of a single RGB image."""
        rois = [palm.roi for palm in find_palms(self._palms, image)][: self._most]
        return self._read(image, rois)

    def frame(self, image: Image) -> list[Landmarks]:
        """All hands of the next RGB image of a stream; palms are looked for only while hands are missing."""
        rois = self._rois
        if len(rois) < self._most:
            found = [palm.roi for palm in find_palms(self._palms, image)][: self._most]
            rois = apart([*rois, *found])[: self._most]
        hands = self._read(image, rois)
        self._rois = apart([hand.roi for hand in hands])
        return hands

    def forget(self) -> None:
        """The next image is of another stream."""
        self._rois = []

    def _read(self, image: Image, rois: Sequence[Roi]) -> list[Landmarks]:
        hands = (read_landmarks(self._landmarks, image, roi) for roi in rois)
        return [hand for hand in hands if hand.presence >= LEAST_PRESENCE]


def apart(rois: Sequence[Roi]) -> list[Roi]:
    """Without the later ones of squares that overlap."""
    kept: list[Roi] = []
    for roi in rois:
        if not kept or float(overlaps(_box(roi), np.stack([_box(one) for one in kept])).max()) <= SAME_OVERLAP:
            kept.append(roi)
    return kept


def _box(roi: Roi) -> Array:
    """Upright corners (2, 2): MediaPipe compares squares as if they were not turned."""
    half = roi.side_px / 2
    return np.stack([roi.centre_px - half, roi.centre_px + half])
