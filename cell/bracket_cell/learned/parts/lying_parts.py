"""What of the wrist camera's findings stands, and what lies: rough boxes, and exact poses where they can be told."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import cv2
import numpy as np
from numpy.typing import NDArray

from bracket_cell.learned.parts.lying_fit import LyingFit, LyingFitter
from bracket_ground.interfaces.bench import Bench
from bracket_ground.interfaces.frame import Frame
from bracket_ground.interfaces.perception import PartDetection
from bracket_ground.interfaces.pose import Pose
from bracket_ground.interfaces.product import Product
from bracket_ground.interfaces.resting_pose import lies_raised

LEAST_HEIGHT_M, MIN_CONFIDENCE = 0.02, 0.3  # of something that lies: its height, and that it is there
BEYOND_M = 0.003  # its box reaches so far beyond what is seen of it
SAME_BOX = 0.4  # intersection over union, from which two findings may be one thing
SAME_LOOK = 0.85  # boxes that overlap more than this are fitted only once
STANDING_IOU = 0.8  # intersection over union of silhouettes above which a part is taken to stand
MIN_IOU_GAIN = 0.1  # by which a lying pose must fit better than a standing detection
MOST_HIDDEN = 0.4  # share of a standing detection's box up to which its silhouette overrules it
MIN_CONFIDENCE_LEAD = 0.1  # surer by this it is of its type ...
UNKNOWN_MIN_IOU = 0.88  # ... else its silhouette must agree so well

Found = Sequence[PartDetection]


class LyingPartResolver:
    """Sorts what a detector found in the tray."""

    def __init__(self, bench: Bench, product: Product) -> None:
        self._bench, self._product = bench, product
        self._fitter = LyingFitter(bench.wrist.model, bench.tray, product.parts)

    def sort(
        self, frame: Frame, found: Found, *, fitted: bool = True
    ) -> tuple[tuple[PartDetection, ...], tuple[PartDetection, ...]]:
        """What stands, and everything else, each thing once, as an upright box on the floor (see `PartsView`).

        Args:
            fitted: how a thing lies is fitted; not where it may stand, as the detector knows nothing that stands.
        """
        typed = [detection for detection in found if detection.upright and detection.part in self._product.parts]
        fallen = [(detection, fit) for detection in typed if (fit := self._fallen(frame, detection, found)) is not None]
        standing = tuple(detection for detection in typed if all(detection is not other for other, _ in fallen))
        rest = [detection for detection in found if detection not in typed and detection.confidence >= MIN_CONFIDENCE]
        exact = [self._exact(detection, fit.part, fit.world_from_part) for detection, fit in fallen]
        rough: list[PartDetection] = []
        for part_detection in sorted(rest, key=lambda detection: (not detection.lies_on, -detection.confidence)):
            if any(covers(part, part_detection) for part in (*standing, *exact)) or _again(part_detection, exact):
                continue
            lies = self._placed(frame, part_detection, found, rough) if fitted else None
            if lies is None:
                rough.append(part_detection)
            else:
                exact.append(lies)
        apart = [
            detection
            for detection in rough
            if not _again(detection, exact) and not any(covers(part, detection) for part in exact)
        ]
        return standing, (*exact, *(on_floor(frame, self._bench, self._product, detection) for detection in apart))

    def _placed(self, frame: Frame, detection: PartDetection, found: Found, rough: Found) -> PartDetection | None:
        """A thing exactly as it lies; None where that is not known. What looks like a rough one is not fitted again."""
        if detection.lies is not None and self._raised(detection, detection.lies):
            return self._exact(detection, detection.part, detection.lies)
        tried = any(overlap(detection, other) >= SAME_LOOK for other in rough)
        if (fit := None if tried else self._lying(frame, detection, found)) is not None:
            return self._exact(detection, fit.part, fit.world_from_part)
        if detection.lies is not None and self._clearly(detection.part, self._same(detection, found)):
            return self._exact(detection, detection.part, detection.lies)
        return None

    def _raised(self, detection: PartDetection, lies: Pose) -> bool:
        """Whether it lies on others, where no side can be fitted to the floor."""
        floor_m = self._bench.tray.centre_m[2]
        return bool(detection.lies_on) or lies_raised(self._product.parts[detection.part], lies, floor_m)

    @staticmethod
    def _same(detection: PartDetection, found: Found) -> list[PartDetection]:
        """All findings that may be this thing."""
        return [other for other in found if overlap(detection, other) >= SAME_BOX]

    def _lying(self, frame: Frame, detection: PartDetection, found: Found) -> LyingFit | None:
        """How a thing lies, of whichever type it is; a large part may also be told as several small ones."""
        same = self._same(detection, found)
        types = tuple(dict.fromkeys(other.part for other in same))
        around = [other for other in found if not inside(other, detection)]
        hidden, less = (self._hidden(frame, detection, others) for others in (found, around))
        for mask in (hidden,) if np.array_equal(hidden, less) else (hidden, less):
            fit = self._fitter.fit(frame, detection.box_px, types, mask)
            if fit is not None and fit.agreement >= self._least_agreement(fit.part, same):
                return fit
        return None

    def _least_agreement(self, part: str, same: Found) -> float:
        """How well a part must fit what may also be something unknown, by what the detector says of the thing."""
        return 0.0 if self._clearly(part, same) else UNKNOWN_MIN_IOU

    def _clearly(self, part: str, same: Found) -> bool:
        """Whether the detector says clearly that a thing is of this type, and nothing unknown."""
        sure = max((detection.confidence for detection in same if detection.part == part), default=0.0)
        strange = max(
            (detection.confidence for detection in same if detection.part not in self._product.parts), default=0.0
        )
        return sure >= strange + MIN_CONFIDENCE_LEAD

    def _fallen(self, frame: Frame, detection: PartDetection, found: Found) -> LyingFit | None:
        """How a part lies that was told to stand; None where it stands, or where nothing else is sure."""
        hidden = self._hidden(frame, detection, found)
        left, top, right, bottom = (max(value, 0) for value in detection.box_px)
        if hidden[top:bottom, left:right].mean() > MOST_HIDDEN:
            return None
        stands = self._fitter.agreement(frame, detection.box_px, detection.part, detection.world_from_part, hidden)
        if stands >= STANDING_IOU:
            return None
        fit = self._fitter.fit(frame, detection.box_px, (detection.part,), hidden)
        return fit if fit is not None and fit.agreement > stands + MIN_IOU_GAIN else None

    def _hidden(self, frame: Frame, detection: PartDetection, found: Found) -> NDArray[np.uint8]:
        """1 where other things are seen."""
        mask = np.zeros(frame.image.shape[:2], np.uint8)
        for other in found:
            if other is not detection and overlap(detection, other) < SAME_BOX and other.confidence >= MIN_CONFIDENCE:
                left, top, right, bottom = (max(value, 0) for value in other.box_px)
                mask[top:bottom, left:right] = 1
        return mask

    def _exact(self, detection: PartDetection, part: str, lies: Pose) -> PartDetection:
        """With its exact pose, and the smallest box around it, from the floor on."""
        kind = self._product.parts[part]
        points = lies.transform(np.concatenate([solid.points() for solid in kind.whole]))
        (x, y), (first, second), degrees = cv2.minAreaRect(np.asarray(points[:, :2] * 1e3, np.float32))
        yaw = np.radians(degrees if first >= second else degrees + 90.0)
        length, width = max(first, second) / 1e3 + 2 * BEYOND_M, min(first, second) / 1e3 + 2 * BEYOND_M
        floor_m = self._bench.tray.centre_m[2]
        height = float(points[:, 2].max()) - floor_m
        pose = Pose.from_yaw((x / 1e3, y / 1e3, floor_m), float(yaw))
        size = (length, width, height)
        return replace(detection, part=part, world_from_part=pose, size_m=size, upright=False, lies=lies)


def on_floor(frame: Frame, bench: Bench, product: Product, detection: PartDetection) -> PartDetection:
    """What does not stand as an upright box along the axes of the world that holds what the camera sees of it.

    One look does not tell on which side it lies: it counts as high as it can be.
    """
    left, top, right, bottom = detection.box_px
    middle_m = detection.world_from_part.position_m[2]
    floor_m = bench.tray.centre_m[2]
    half_m = max(middle_m - floor_m, LEAST_HEIGHT_M / 2)
    pixels = np.array([[left, top], [right, top], [right, bottom], [left, bottom]], float)
    corners = bench.wrist.model.onto_plane(frame.world_from_camera, pixels, floor_m + half_m)[:, :2]
    low, high = corners.min(axis=0), corners.max(axis=0)
    x, y = (float(value) for value in (low + high) / 2)
    known = product.parts.get(detection.part)
    length, width = (float(value) + 2 * BEYOND_M for value in high - low)
    top_m = max(2 * half_m, *(known.size_m if known else (min(length, width),)))
    return replace(detection, world_from_part=Pose((x, y, floor_m)), size_m=(length, width, top_m), upright=False)


def covers(standing: PartDetection, other: PartDetection) -> bool:
    """Whether something is seen where a part stands: the part itself, seen twice."""
    if standing.stacked_with(other):
        return False
    x, y, _ = standing.world_from_part.inverse().transform(np.array(other.world_from_part.position_m))
    length, width, _ = standing.size_m
    return bool(abs(x) < length / 2 and abs(y) < width / 2)


def inside(small: PartDetection, large: PartDetection) -> bool:
    """Whether the middle of one box in the image is inside another, larger one."""
    left, top, right, bottom = large.box_px
    a, b, c, d = small.box_px
    smaller = (c - a) * (d - b) < (right - left) * (bottom - top)
    return smaller and left <= (a + c) / 2 <= right and top <= (b + d) / 2 <= bottom


def _again(detection: PartDetection, known: Found) -> bool:
    """Whether something is one of the known things, seen twice."""
    return any(overlap(detection, other) >= SAME_BOX and not detection.stacked_with(other) for other in known)


def overlap(first: PartDetection, second: PartDetection) -> float:
    """Intersection over union of the boxes of two findings in the image."""
    (left, top, right, bottom), (a, b, c, d) = first.box_px, second.box_px
    both = max(min(right, c) - max(left, a), 0) * max(min(bottom, d) - max(top, b), 0)
    return both / max((right - left) * (bottom - top) + (c - a) * (d - b) - both, 1)
