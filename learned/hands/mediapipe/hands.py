"""MediaPipe's hands in images: the palm network where hands are missing, the landmark network on each hand."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from cell.interfaces.pose import Array
from learned.hands.mediapipe.files import LANDMARK_KIND, PALM_KIND, Size, network_file
from learned.hands.mediapipe.landmarks import LEAST_PRESENCE, Landmarks, read_landmarks
from learned.hands.mediapipe.palms import Roi, find_palms, overlaps
from learned.hands.regions import Image
from learned.onnx_model import OnnxModel

MOST_HANDS = 2
SAME_OVERLAP = 0.5  # of two squares about one hand


class MediaPipeHands:
    """The two networks.

    Args:
        folder: where they were written to by `cell hands fetch`.

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
