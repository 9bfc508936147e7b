"""MoveAside: take a blocking part and stand it where the tray is free (Alg. 2, "move b")."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence

import numpy as np

from cell.interfaces.bench import Tray
from cell.interfaces.observation import Observation
from cell.interfaces.perception import PartDetection
from cell.interfaces.pose import Array, Pose
from cell.interfaces.product import PartType
from skills.grasp_pose import footprint, gap_m, rectangle
from skills.handling import joints_of, put_phases, take_phases, tray_boxes
from skills.phases import Phase, PhasedSkill
from skills.planner import MotionPlanner
from skills.settings import MotionSettings

GRID_M = 0.01
ENOUGH_M = 0.060  # more room than this is no better


class MoveAside(PhasedSkill):
    """Pick a part and put it down on a free spot of the tray, away from all others."""

    def __init__(self, planner: MotionPlanner, part: PartDetection, others: Sequence[PartDetection]) -> None:
        """Args:
        part: the part that is in the way.
        others: all other parts seen in the tray, the one that it blocks among them.
        """
        super().__init__()
        self._planner, self._part, self._others = planner, part, tuple(others)

    def prepare(self, observation: Observation) -> Sequence[Phase] | str:
        """Find a spot, then a grasp."""
        planner, part = self._planner, self._part
        kind = planner.product.parts[part.part]
        near = joints_of(observation)
        carry_m = self._carry_m(kind)
        take = take_phases(planner, part, self._others, near, carry_m)
        if isinstance(take, str):
            return take
        obstacles = tray_boxes(planner, self._others)
        reason = f"no free spot in the tray for {part.part}"
        for target in free_spots(part, kind, self._others, planner.bench.tray, planner.settings):
            put = put_phases(planner, part.part, target, obstacles, near, carry_m, into_hole=False)
            if not isinstance(put, str):
                return [*take, *put]
            reason = put
        return reason

    @property
    def done(self) -> str:
        """What the skill has achieved, in words."""
        return f"{self._part.part} moved aside"

    def _carry_m(self, kind: PartType) -> float:
        """Height of the carried body's bottom that clears all other parts in the tray."""
        bench = self._planner.bench.tray
        floor = bench.centre_m[2]
        tops = [other.world_from_part.position_m[2] + other.size_m[2] for other in self._others]
        return max([floor + bench.wall_m, *tops]) + kind.peg_length_m + self._planner.settings.carry_gap_m


def free_spots(
    part: PartDetection, kind: PartType, others: Sequence[PartDetection], tray: Tray, settings: MotionSettings
) -> list[Pose]:
    """Poses (part frame) in the tray where a part stands clear of all others, best first; at most five.

    Best has the widest gap to the nearest part, up to ENOUGH_M; among equals the nearest spot.
    """
    start = np.array(part.world_from_part.position_m[:2])
    obstacles = [footprint(other) for other in others]
    ranked = []
    for number, (centre, yaw) in enumerate(_candidates(part, tray)):
        body = rectangle(centre, yaw, np.array(kind.size_m[:2]) / 2)
        if not _inside(body, tray, settings.rim_gap_m):
            continue
        gap = min([gap_m(body, other) for other in obstacles], default=ENOUGH_M)
        if gap >= settings.part_gap_m:
            ranked.append((-min(gap, ENOUGH_M), float(np.linalg.norm(centre - start)), number, centre, yaw))
    ranked.sort(key=lambda entry: entry[:3])
    bottom = tray.centre_m[2] + kind.peg_length_m
    return [Pose.from_yaw((centre[0], centre[1], bottom), yaw) for *_, centre, yaw in ranked[:5]]


def _candidates(part: PartDetection, tray: Tray) -> Iterator[tuple[Array, float]]:
    """Spots on a grid over the tray, in three headings."""
    middle, half = np.array(tray.centre_m[:2]), np.array(tray.size_m) / 2
    steps = np.floor(half / GRID_M).astype(int)
    for yaw in (part.world_from_part.yaw_rad, 0.0, math.pi / 2):
        for i in range(-steps[0], steps[0] + 1):
            for j in range(-steps[1], steps[1] + 1):
                yield middle + GRID_M * np.array([i, j]), yaw


def _inside(body: Array, tray: Tray, margin_m: float) -> bool:
    return bool(np.all(np.abs(body - np.array(tray.centre_m[:2])) <= np.array(tray.size_m) / 2 - margin_m))
