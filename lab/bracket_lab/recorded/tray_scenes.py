"""Scenes from a log: what the wrist camera's detector saw in the tray, look by look, and which grasps came off."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from bracket_cell.learned.grasp.records import DetectionRecord, SceneRecord, StandingRecord
from bracket_cell.log.read.reader import Log
from bracket_ground.interfaces.perception import PartDetection, PartsView

GRASP, PICK, ENDS = "grasp", "PickPart", ("success", "failure")
SAME_PLACE_M, SAME_HEADING_RAD = 0.010, math.radians(10)  # between looks at a part that nobody moved


@dataclass(frozen=True)
class Attempt:
    """A grasp that was tried on a part that the planner held for free.

    Attributes:
        view: what was seen before it.
        number: of the part in that view.
        graspable: probability that the planner gave.
        reason: what the skill said at its end.
    """

    view: PartsView
    number: int
    graspable: float
    succeeded: bool
    reason: str
    time_s: float

    def row(self, log: str, scene: int) -> dict[str, Any]:
        """As a line of grasps.jsonl."""
        return {
            "log": log,
            "scene": scene,
            "number": self.number,
            "part": self.view.detections[self.number].part,
            "graspable": self.graspable,
            "succeeded": self.succeeded,
            "reason": self.reason,
            "time_s": self.time_s,
        }


def attempts(log: Log) -> Iterator[Attempt]:
    """Grasps as they ended; those that were halted in between tell nothing of the part and are left out."""
    planned: tuple[PartsView, int, float] | None = None
    for tick in log.ticks:
        view = tick.observation.parts
        for topic, fields in tick.notes:
            if topic == "plan" and "required" in fields:
                free = fields["solution"] == GRASP and view is not None and fields["required"] < len(view.detections)
                planned = (view, fields["required"], fields["graspable"]) if free and view is not None else None
            elif topic == "skill" and fields["node"] == PICK and fields["status"] in ENDS and planned is not None:
                yield Attempt(*planned, fields["status"] == "success", fields["reason"], tick.time_s)
                planned = None


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
