"""The gripper by itself: open, close, hold with another force."""

from __future__ import annotations

from cell.interfaces.command import GripperCommand
from cell.interfaces.skill import Skill
from trees.engine.errors import NodeError
from trees.engine.ports import InputPort
from trees.nodes.poses import near_bracket, tool_pose
from trees.nodes.skill_node import SkillNode

OPENING_M, SPEED_M_S, FORCE_N = (0.0, 0.085), (0.02, 0.15), (20.0, 235.0)  # of the 2F-85


class OpenGripper(SkillNode):
    """Open the fingers; a part that is held is let go, though never over the bracket, where PlacePart does that."""

    claims = ("gripper",)

    opening_m = InputPort(float, "distance between the fingers in [m]", default=OPENING_M[1])
    speed_m_s = InputPort(float, "speed of the fingers in [m/s]", default=0.1)

    def make_skill(self) -> Skill:
        from skills.fingers import MoveFingers

        services = self.services
        opening = _within("opening_m", self.opening_m.get(), OPENING_M)
        speed = _within("speed_m_s", self.speed_m_s.get(), SPEED_M_S)
        if services.observation.gripper.holding and near_bracket(services, tool_pose(services)):
            raise NodeError("a part would be let go over the bracket; PlacePart does that, behind its guard")
        goal = GripperCommand(opening, speed)
        return MoveFingers(services.motion.settings, goal, f"opening the fingers to {opening * 1000:.0f} mm")


class CloseGripper(SkillNode):
    """Close the fingers; fails where they close on nothing, unless nothing is expected."""

    claims = ("gripper",)

    force_n = InputPort(float, "force of the fingers in [N]", default=60.0)
    speed_m_s = InputPort(float, "speed of the fingers in [m/s]", default=0.1)
    on_something = InputPort(bool, "fail where nothing is between the fingers", default=True)

    def make_skill(self) -> Skill:
        from skills.fingers import MoveFingers

        force = _within("force_n", self.force_n.get(), FORCE_N)
        goal = GripperCommand(0.0, _within("speed_m_s", self.speed_m_s.get(), SPEED_M_S), force)
        settings, must_hold = self.services.motion.settings, self.on_something.get()
        return MoveFingers(settings, goal, f"closing the fingers with {force:.0f} N", must_hold=must_hold)


class SetGripForce(SkillNode):
    """Hold what is held with another force; fails where nothing is held."""

    claims = ("gripper",)

    force_n = InputPort(float, "force of the fingers in [N]")

    def make_skill(self) -> Skill:
        from skills.fingers import MoveFingers

        force = _within("force_n", self.force_n.get(), FORCE_N)
        if not self.services.observation.gripper.holding:
            raise NodeError("the gripper holds nothing")
        goal = GripperCommand(0.0, SPEED_M_S[0], force)
        return MoveFingers(self.services.motion.settings, goal, f"holding with {force:.0f} N", must_hold=True)


def _within(name: str, value: float, limits: tuple[float, float]) -> float:
    low, high = limits
    if not low <= value <= high:
        raise NodeError(f"{name} is {value:g}; the gripper takes {low:g} to {high:g}")
    return value
