"""MoveAside: take a blocking part and stand it where the tray is free (Alg. 2, "move b")."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from bracket_cell.skills.grasping.handling import (
    bracket_boxes,
    choose_grasp,
    joints_of,
    put_phases,
    seen_in_holes,
    slips_m,
    take_phases,
    tray_boxes,
    why_not_empty,
)
from bracket_cell.skills.grasping.phases import Phase, PhasedSkill
from bracket_cell.skills.motion.planner import MotionPlanner
from bracket_cell.skills.motion.settings import MotionSettings
from bracket_ground.files.words.message import Message
from bracket_ground.interfaces.bench import Tray
from bracket_ground.interfaces.observation import Observation
from bracket_ground.interfaces.perception import PartDetection
from bracket_ground.interfaces.pose import Array, Pose
from bracket_ground.interfaces.product import PartType

GRID_M = 0.01
ENOUGH_M = 0.060  # more room than this is no better
SPOTS = 5


@dataclass(eq=False)
class MoveAside(PhasedSkill):
    """Pick a part and put it down on a free spot of the tray, away from all others.

    Attributes:
        part: the part that is in the way.
        others: all other parts seen in the tray, the one that it blocks among them.
    """

    planner: MotionPlanner = field(repr=False)
    part: PartDetection
    others: Sequence[PartDetection]

    def prepare(self, observation: Observation) -> Sequence[Phase] | str:
        """Find a spot, then a grasp."""
        if (full := why_not_empty(observation)) is not None:
            return Message("cannot take {part}: {full}", part=self.part.part, full=full)
        planner, part = self.planner, self.part
        kind = planner.product.parts[part.part]
        near = joints_of(observation)
        carry_m = self._carry_m(kind)
        chosen = choose_grasp(planner, part, self.others, near)
        if isinstance(chosen, str):
            return chosen
        placed = bracket_boxes(planner, seen_in_holes(observation))
        take = take_phases(planner, part, self.others, chosen, carry_m, placed=placed)
        if isinstance(take, str):
            return take
        obstacles = tray_boxes(planner, self.others)
        reason: str = Message("no free spot in the tray for {part}", part=part.part)
        for target in free_spots(part, kind, self.others, planner.bench.tray, planner.settings):
            put = put_phases(
                planner, part.part, chosen[0].hold, target, obstacles, near, carry_m, slipped_m=slips_m(kind)
            )
            if not isinstance(put, str):
                return [*take, *put]
            reason = put
        return reason

    @property
    def done(self) -> str:
        """What the skill has achieved, in words."""
        return Message("{part} moved aside", part=self.part.part)

    def _carry_m(self, kind: PartType) -> float:
        """Height of the carried body's bottom that clears all other parts in the tray."""
        bench = self.planner.bench.tray
        floor = bench.centre_m[2]
        tops = [other.world_from_part.position_m[2] + other.size_m[2] for other in self.others]
        return max([floor + bench.wall_m, *tops]) + kind.peg_length_m + self.planner.settings.carry_gap_m


def free_spots(
    part: PartDetection, kind: PartType, others: Sequence[PartDetection], tray: Tray, settings: MotionSettings
) -> list[Pose]:
    """Poses (part frame) in the tray where a part stands clear of all others, best first; at most five.

    Best has the widest gap to the nearest part, up to ENOUGH_M; among equals the nearest spot.
    """
    start, headings = part.world_from_part.position_m[:2], (part.world_from_part.yaw_rad, 0.0, math.pi / 2)
    bottom = tray.centre_m[2] + kind.peg_length_m
    centres = free_centres(kind.size_m, start, headings, others, tray, settings)
    return [Pose.from_yaw((x, y, bottom), yaw) for x, y, yaw in centres[:SPOTS]]


def free_centres(
    size_m: Sequence[float],
    start_m: Sequence[float],
    headings_rad: Sequence[float],
    others: Sequence[PartDetection],
    tray: Tray,
    settings: MotionSettings,
    each: int = SPOTS,
) -> list[tuple[float, float, float]]:
    """Where a box (length, width, ...) has room in the tray: (x, y) and heading, best first, a few of each
    heading.

    Args:
        start_m: (x, y) of where it is now.
    """
    start, half = np.array(start_m), np.array(size_m[:2]) / 2
    ranked: list[tuple[float, float, float, float, float]] = []
    for yaw in headings_rad:
        centres = _grid(yaw, half, tray, settings.rim_gap_m)
        gaps = np.full(len(centres), ENOUGH_M)
        for other in others:
            gaps = np.minimum(gaps, _gaps_m(centres, yaw, half, other))
        distances = np.linalg.norm(centres - start, axis=1)
        roomy = gaps >= settings.part_gap_m
        rows = zip(-gaps[roomy], distances[roomy], *centres[roomy].T, strict=True)
        found = sorted((float(gap), float(distance), float(x), float(y), yaw) for gap, distance, x, y in rows)
        ranked += found[:each]
    ranked.sort()
    return [(x, y, yaw) for _, _, x, y, yaw in ranked]


def _grid(yaw_rad: float, half_m: Array, tray: Tray, margin_m: float) -> Array:
    """Centres (n, 2) on a grid for which a body lies inside the tray, a margin away from its rim."""
    c, s = abs(math.cos(yaw_rad)), abs(math.sin(yaw_rad))
    reach = np.array([[c, s], [s, c]]) @ half_m
    room = np.maximum(np.array(tray.size_m) / 2 - margin_m - reach, 0.0)
    x, y = (GRID_M * np.arange(-int(extent / GRID_M), int(extent / GRID_M) + 1) for extent in room)
    offsets = np.stack(np.meshgrid(x, y, indexing="ij"), axis=-1).reshape(-1, 2)
    centres: Array = np.array(tray.centre_m[:2]) + offsets
    return centres


def _gaps_m(centres_m: Array, yaw_rad: float, half_m: Array, other: PartDetection) -> Array:
    """Widest gap (n,) along any side direction between a body at each centre and another part."""
    other_yaw = other.world_from_part.yaw_rad
    other_half = np.array(other.size_m[:2]) / 2
    own, foreign = _sides(yaw_rad), _sides(other_yaw)
    axes = np.concatenate([own, foreign])
    extent = np.abs(axes @ own.T) @ half_m + np.abs(axes @ foreign.T) @ other_half
    offsets = centres_m - np.array(other.world_from_part.position_m[:2])
    gaps: Array = (np.abs(offsets @ axes.T) - extent).max(axis=1)
    return gaps


def _sides(yaw_rad: float) -> Array:
    """Directions (2, 2) of a body's length and width."""
    c, s = math.cos(yaw_rad), math.sin(yaw_rad)
    return np.array([[c, s], [-s, c]])
