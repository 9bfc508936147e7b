"""Places that are entered from a side: a straight way in to above a spot, and the same way out again."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from bracket_cell.skills.grasping.phases import Move, Phase
from bracket_cell.skills.motion.motions import FreeWay, Line
from bracket_cell.skills.motion.planner import Load, MotionPlanner
from bracket_ground.files.words.message import Message
from bracket_ground.interfaces.places import BenchPlace
from bracket_ground.interfaces.pose import Array, Pose


@dataclass(frozen=True, eq=False)
class Entry:
    """How a place is entered.

    Attributes:
        name: of the place, for messages.
        offset_m: (3,) in the world, from above a spot to where the tool comes from.
    """

    planner: MotionPlanner = field(repr=False)
    name: str
    offset_m: Array

    @staticmethod
    def of(planner: MotionPlanner, name: str, place: BenchPlace) -> Entry | None:
        """Of a place; None for one that is entered from above."""
        if place.enter_from_m is None:
            return None
        return Entry(planner, name, place.pose.rotation @ np.array(place.enter_from_m))

    def wrap(
        self, phases: Sequence[Phase], above_rad: Array, leaves: Pose, loads: tuple[Load, Load], held: tuple[str, str]
    ) -> list[Phase] | str:
        """Phases with the way in before and the way out after them, or why there is no way in.

        Args:
            above_rad: joints (6,) of the tool above the spot.
            leaves: world_from_tool when the way out begins.
            loads: what the ways in and out are checked with.
            held: type of the part that is held on the way in, and on the way out; empty for none.
        """
        planner, kinematics, (before, after) = self.planner, self.planner.kinematics, loads
        above = kinematics.forward(above_rad)
        outside_rad = kinematics.follow(self._aside(above), above_rad)
        if outside_rad is None:
            return Message("cannot enter {place}: out of the arm's reach beside it", place=self.name)
        if isinstance(way := planner.straight_move(outside_rad, above, before), str):
            return Message("cannot enter {place}: {way}", place=self.name, way=way)
        beside, into = Message("going beside {place}", place=self.name), Message("entering {place}", place=self.name)
        leaving = Line(planner, self._aside(leaves), after)
        return [
            Move(beside, FreeWay(planner, outside_rad, before), holding=held[0] or None),
            Move(into, Line(planner, above, before), holding=held[0] or None),
            *phases,
            Move(Message("leaving {place}", place=self.name), leaving, holding=held[1] or None),
        ]

    def _aside(self, tool: Pose) -> Pose:
        x, y, z = (float(value) for value in np.add(tool.position_m, self.offset_m))
        return Pose((x, y, z), tool.quaternion_wxyz)
