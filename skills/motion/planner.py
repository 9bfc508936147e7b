"""Motion planner: inverse kinematics, collision checks and limits behind three questions that skills ask."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from cell.files.words.message import Message
from cell.interfaces.bench import Bench
from cell.interfaces.command import JointTrajectory
from cell.interfaces.pose import Array, Pose
from cell.interfaces.product import Product
from skills.motion.collision import Box, CollisionChecker
from skills.motion.grip import Hold
from skills.motion.kinematics import Kinematics
from skills.motion.lying_grasp import LyingHold
from skills.motion.outline import Shape
from skills.motion.separation import SeparationMonitor
from skills.motion.settings import MotionSettings
from skills.motion.trajectory import joint_move, line_move


@dataclass(frozen=True)
class Load:
    """What a motion is checked with.

    Attributes:
        opening_m: widest opening of the fingers on the way.
        obstacles: parts and other boxes to keep clear of, beside the bench.
        held: boxes carried along, in the tool frame.
        close: keep no margin, for the last way down to a part among others or into a hole.
    """

    opening_m: float
    obstacles: tuple[Box, ...] = ()
    held: tuple[Box, ...] = ()
    close: bool = False


Plan = JointTrajectory | str  # a trajectory, or why there is none, in words for an operator
Planning = Callable[[Array], Plan]  # from the joints (6,) at which the arm stands


class MotionPlanner:
    """Plans motions that keep the joint limits and touch nothing.

    Attributes:
        product, bench, settings: what it plans for.
        kinematics: of the arm with its tool.
        separation: of the arm from the person.
        hold: how the part is held that was taken last; None where this planner has not seen to one.
        lying: how it is held if it was taken as it lay; None for a part that stood.
    """

    def __init__(self, product: Product, bench: Bench, settings: MotionSettings | None = None) -> None:
        self.product, self.bench = product, bench
        self.settings = settings or MotionSettings()
        self.hold: Hold | None = None
        self.lying: LyingHold | None = None
        self.kinematics = Kinematics(self.settings)
        self._checker = CollisionChecker(self.kinematics, product, bench, self.settings)
        self.separation = SeparationMonitor(self._checker, bench, self.settings)

    @property
    def robot_shapes(self) -> tuple[Shape, ...]:
        """Arm and gripper with closed fingers, as collisions are checked."""
        return self._checker.shapes

    def reach(self, poses: Sequence[Pose], near_rad: Array, load: Load) -> tuple[Pose, Array] | str:
        """The tool pose with the shortest way there and its joints; or why none of them can be reached."""
        reason = "out of the arm's reach"
        candidates: list[tuple[float, int, Pose, Array]] = []
        for pose in poses:
            joints = self.kinematics.inverse(pose, near_rad)
            if joints is None:
                continue
            contact = self._contact(joints[None], load)
            if contact is not None:
                reason = contact
                continue
            candidates.append((self._travel(joints - near_rad), len(candidates), pose, joints))
        if not candidates:
            return reason
        _, _, pose, joints = min(candidates, key=lambda entry: entry[:2])
        return pose, joints

    def free_move(self, start_rad: Array, goal_rad: Array, load: Load) -> Plan:
        """To joints; where the direct way is blocked, straight up first and down again at the end."""
        direct = joint_move(start_rad, goal_rad, self.settings)
        contact = self._contact(direct.positions_rad, load)
        if contact is None:
            return direct
        start, goal = self.kinematics.forward(start_rad), self.kinematics.forward(goal_rad)
        height = max(start.position_m[2], goal.position_m[2]) + self.settings.transit_lift_m
        up = self.rise(start_rad, height, load.opening_m)
        down = line_move(self.kinematics, goal_rad, at_height(goal, height), self.settings)
        if isinstance(up, str) or down is None:
            return Message("no free way: {contact}", contact=contact)
        across = joint_move(up.positions_rad[-1], down.positions_rad[-1], self.settings)
        rest = joined([across, _reversed(down)])
        still = self._contact(rest.positions_rad, load)
        return joined([up, rest]) if still is None else Message("no free way: {still}", still=still)

    def rise(self, start_rad: Array, height_m: float, opening_m: float) -> Plan:
        """The tool straight up, which takes it away from all that stands beside or below it."""
        pose = at_height(self.kinematics.forward(start_rad), height_m)
        return self.straight_move(start_rad, pose, Load(opening_m, close=True))

    def straight_move(
        self, start_rad: Array, world_from_tool: Pose, load: Load, speed_m_s: float | None = None
    ) -> Plan:
        """The tool on a straight line to a pose, at the settings' speed by default."""
        settings = self.settings
        if speed_m_s is not None:
            settings = settings.model_copy(update={"line_speed_m_s": speed_m_s})
        line = line_move(self.kinematics, start_rad, world_from_tool, settings)
        if line is None:
            return "the arm cannot follow a straight line there"
        contact = self._contact(line.positions_rad, load)
        return line if contact is None else Message("no free way: {contact}", contact=contact)

    def blind_move(self, start_rad: Array, world_from_tool: Pose, speed_m_s: float) -> Plan:
        """The tool on a straight line without a look at what is in the way, as that is to be felt."""
        settings = self.settings.model_copy(update={"line_speed_m_s": speed_m_s})
        return line_move(self.kinematics, start_rad, world_from_tool, settings) or "the arm cannot follow that line"

    def _contact(self, positions_rad: Array, load: Load) -> str | None:
        margin_m = 0.0 if load.close else self.settings.collision_margin_m
        return self._checker.first_contact(positions_rad, load.opening_m, load.obstacles, load.held, margin_m)

    def _travel(self, difference_rad: Array) -> float:
        """Time that the slowest joint needs at full speed."""
        return float(np.max(np.abs(difference_rad) / np.array(self.settings.speed_limits_rad_s)))


def at_height(pose: Pose, height_m: float) -> Pose:
    """The same pose straight above or below."""
    return Pose((pose.position_m[0], pose.position_m[1], height_m), pose.quaternion_wxyz)


def _reversed(trajectory: JointTrajectory) -> JointTrajectory:
    return JointTrajectory(trajectory.duration_s - trajectory.times_s[::-1], trajectory.positions_rad[::-1])


def joined(legs: Sequence[JointTrajectory]) -> JointTrajectory:
    """One trajectory out of legs that each start where the last one ends."""
    times, positions, offset = [np.zeros(1)], [legs[0].positions_rad[:1]], 0.0
    for leg in legs:
        times.append(leg.times_s[1:] + offset)
        positions.append(leg.positions_rad[1:])
        offset += leg.duration_s
    return JointTrajectory(np.concatenate(times), np.concatenate(positions))
