"""Scenes from a log: what the wrist camera's detector saw in the tray, look by look."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence

import numpy as np

from cell.interfaces.perception import PartDetection, PartsView
from cell.log.reader import Log
from learned.grasp.dataset import DetectionRecord, SceneRecord, StandingRecord

SAME_PLACE_M, SAME_HEADING_RAD = 0.010, math.radians(10)  # between looks at a part that nobody moved


def looks(log: Log) -> list[PartsView]:
    """Every answer of the part detector, once."""
    found: list[PartsView] = []
    for tick in log.ticks:
        view = tick.observation.parts
        if view is not None and (not found or view.sequence != found[-1].sequence):
            found.append(view)
    return found


def scene_records(views: Sequence[PartsView]) -> Iterator[SceneRecord]:
    """A scene for each look that shows parts.

    `truth` is the mean of all looks of this log at a part that nobody moved: better than one look, but not measured.
    """
    for view in views:
        if view.detections:
            yield SceneRecord(
                detections=tuple(DetectionRecord.of(part) for part in view.detections),
                truth=tuple(_standing(part, views) for part in view.detections),
            )


def _standing(part: PartDetection, views: Sequence[PartsView]) -> StandingRecord:
    same = [other for view in views for other in view.detections if _stood_still(part, other)]
    x, y, z = np.mean([other.world_from_part.position_m for other in same], axis=0)
    turns = [_turned(part, other) for other in same]
    yaw = part.world_from_part.yaw_rad + float(np.mean(turns))
    return StandingRecord(part=part.part, position_m=(float(x), float(y), float(z)), yaw_rad=yaw, size_m=part.size_m)


def _stood_still(part: PartDetection, other: PartDetection) -> bool:
    apart = math.dist(part.world_from_part.position_m, other.world_from_part.position_m)
    return part.part == other.part and apart <= SAME_PLACE_M and abs(_turned(part, other)) <= SAME_HEADING_RAD


def _turned(part: PartDetection, other: PartDetection) -> float:
    """Angle between two headings, in [-pi/2, pi/2): a box looks the same after half a turn."""
    difference = other.world_from_part.yaw_rad - part.world_from_part.yaw_rad
    return (difference + math.pi / 2) % math.pi - math.pi / 2
