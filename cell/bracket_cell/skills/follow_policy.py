"""Let a trained policy lead the arm, a motion at a time, as far as zone, collisions and the supervisor allow."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from bracket_cell.skills.grasping.handling import joints_of
from bracket_cell.skills.grasping.phases import failed
from bracket_cell.skills.motion.planner import Load
from bracket_cell.skills.move_to import FreeMove
from bracket_ground.errors import ModelError
from bracket_ground.interfaces.command import Command
from bracket_ground.interfaces.observation import Observation
from bracket_ground.interfaces.pose import Array
from bracket_ground.interfaces.skill import Progress, SkillStatus

SETTLED_RAD = 0.01  # a policy that wants the arm no farther than this from where it stands is done
Zone = tuple[float, float, float, float, float, float]  # least and largest x, y, z of the tool in the world [m]


@dataclass(eq=False)
class FollowPolicy(FreeMove):
    """Ask the policy, move there by a free way, and ask again, until it wants the arm where it stands.

    Attributes:
        wants: the policy's answer to what is seen, six joints in [rad]; raises ModelError.
        zone: the tool never goes out of it.
        steps: motions at most.
    """

    to: str = field(default="where the policy wants it", init=False)
    wants: Callable[[Observation], Array] = field(kw_only=True)
    zone: Zone = field(kw_only=True)
    steps: int = field(kw_only=True)

    def goal(self, observation: Observation, load: Load) -> Array | str:  # noqa: ARG002
        try:
            joints = self.wants(observation)
        except ModelError as error:
            return str(error)
        robot = self.planner.settings.robot
        if not robot.within(joints).all():
            legal = " to ".join(str(np.round(side, 3).tolist()) for side in robot.limits_rad)
            return f"the policy wants joints {np.round(joints, 3).tolist()} rad; legal: {legal}"
        tool_m = self.planner.kinematics.position_m(joints)
        least, most = np.array(self.zone).reshape(3, 2).T
        if (tool_m < least).any() or (tool_m > most).any():
            return f"the policy wants the tool at {np.round(tool_m, 3).tolist()} m, outside of its zone"
        return joints

    def poll(self, observation: Observation, command: Command) -> Progress:
        progress = super().poll(observation, command)
        if progress.status is not SkillStatus.SUCCESS:
            return progress
        wanted = self.goal(observation, Load(0.0))
        if isinstance(wanted, str):
            return self._finish(failed(wanted))
        if np.abs(wanted - joints_of(observation)).max() <= SETTLED_RAD:
            return progress
        self.steps -= 1
        if self.steps <= 0:
            return self._finish(failed("the policy did not come to rest in the motions that it may make"))
        self._phases = self._end = None
        return Progress(SkillStatus.RUNNING, "asking the policy again")
