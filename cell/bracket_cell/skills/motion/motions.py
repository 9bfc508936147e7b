"""What a skill wants of the arm, as data: a log keeps it, and it is planned where the arm stands when it begins."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from bracket_cell.skills.motion.near_hand import way_out
from bracket_cell.skills.motion.planner import Load, Looking, MotionPlanner, Plan, at_height
from bracket_ground.interfaces.command import JointTrajectory
from bracket_ground.interfaces.faults import HAND_TOO_NEAR
from bracket_ground.interfaces.observation import Observation
from bracket_ground.interfaces.pose import Array, Pose

SAME_RAD = 0.02  # a way that was approved is still the same where no joint differs by more


@dataclass(frozen=True, eq=False)
class Motion:
    """One motion of the arm; a subclass says which.

    Attributes:
        planner: that plans it.
    """

    planner: MotionPlanner = field(repr=False)

    def plan(self, start_rad: Array) -> Plan | Looking:
        """How to go from joints (n,), why there is no way, or what looks for one over many ticks."""
        raise NotImplementedError


@dataclass(frozen=True, eq=False)
class Rise(Motion):
    """The tool straight up to a height.

    Attributes:
        opening_m: of the fingers.
    """

    height_m: float
    opening_m: float

    def plan(self, start_rad: Array) -> Plan:
        return self.planner.rise(start_rad, self.height_m, self.opening_m)


@dataclass(frozen=True, eq=False)
class Line(Motion):
    """The tool on a straight line to a pose.

    Attributes:
        speed_m_s: the settings' by default.
    """

    world_from_tool: Pose
    load: Load
    speed_m_s: float | None = None

    def plan(self, start_rad: Array) -> Plan:
        return self.planner.straight_move(start_rad, self.world_from_tool, self.load, self.speed_m_s)


@dataclass(frozen=True, eq=False)
class StepDown(Motion):
    """The tool a step straight down, without a look at what is there, as that is felt.

    Attributes:
        lowest_m: height of the tool below which nothing can be.
    """

    step_m: float
    lowest_m: float
    opening_m: float

    def plan(self, start_rad: Array) -> Plan:
        tool = self.planner.kinematics.forward(start_rad)
        down = at_height(tool, max(tool.position_m[2] - self.step_m, self.lowest_m))
        alone = Load(self.opening_m, close=True)
        return self.planner.straight_move(start_rad, down, alone, self.planner.settings.close_speed_m_s)


@dataclass(frozen=True, eq=False)
class Blind(Motion):
    """The tool on a straight line to a pose without a look at what is in the way."""

    world_from_tool: Pose
    speed_m_s: float

    def plan(self, start_rad: Array) -> Plan:
        return self.planner.blind_move(start_rad, self.world_from_tool, self.speed_m_s)


@dataclass(frozen=True, eq=False)
class FreeWay(Motion):
    """To joints (n,) by a free way."""

    goal_rad: Array
    load: Load

    def plan(self, start_rad: Array) -> Plan | Looking:
        return self.planner.free_way(start_rad, self.goal_rad, self.load)


@dataclass(frozen=True, eq=False)
class WayOut(FreeWay):
    """To joints by a way that leads away from a near hand all along, or not at all.

    Attributes:
        seen: where the hand is.
    """

    seen: Observation

    def plan(self, start_rad: Array) -> Looking:
        return way_out(self.planner, self.seen, start_rad, self.goal_rad, self.load)


@dataclass(frozen=True, eq=False)
class WayOutOrFree(WayOut):
    """To joints by a free way; where a near hand holds the arm, by one that leads away from it, if there is one."""

    def plan(self, start_rad: Array) -> Looking:
        ways_out = super().plan(start_rad) if HAND_TOO_NEAR in self.seen.holding_faults else ()
        yield from (found for found in ways_out if not isinstance(found, str))
        found = FreeWay.plan(self, start_rad)
        yield from (found,) if isinstance(found, JointTrajectory | str) else found


@dataclass(frozen=True, eq=False)
class SameWay(FreeWay):
    """As planned before, with what is seen now; not at all where the way has become another one.

    Attributes:
        approved: what somebody has seen and approved.
    """

    approved: JointTrajectory

    def plan(self, start_rad: Array) -> Looking:
        found = super().plan(start_rad)
        for now in (found,) if isinstance(found, JointTrajectory | str) else found:
            yield now if now is None else self._same(now)

    def _same(self, now: Plan) -> Plan:
        if isinstance(now, str):
            return now
        shares = np.linspace(0.0, 1.0, 50)
        before, after = (trajectory.along(shares * trajectory.duration_s) for trajectory in (self.approved, now))
        same = np.abs(before - after).max() <= SAME_RAD
        return now if same else "the way is not the one that was planned; plan again"


@dataclass(frozen=True, eq=False)
class WayAndLine(FreeWay):
    """To joints by a free way, and on a line from there, as one motion.

    Attributes:
        line: from there on.
        most: as in `MotionPlanner.way_and_line`.
    """

    line: Line
    most: float = 0.4

    def onto(self, start_rad: Array, onto: Callable[[float], None]) -> Plan | Looking:
        """The plan; `onto` is told how long the way takes before only the line is followed [s]."""
        planner, above_rad = self.planner, self.goal_rad
        return planner.way_and_line(start_rad, above_rad, self.load, self.line.plan(above_rad), onto, self.most)
