"""Insert: lower a peg into its hole by feel; where it meets the rim, try again a little beside."""

from __future__ import annotations

from cell.interfaces.command import Command
from cell.interfaces.observation import Observation
from cell.interfaces.pose import Pose
from cell.interfaces.skill import Progress, SkillStatus
from skills.grasping.contact import meets_something, tool_height_m
from skills.grasping.phases import Move, done, failed
from skills.motion.planner import Load, MotionPlanner

RESTS_M = 0.005  # contact this near to the goal is the body on the plate, not the peg on the rim


class Insert:
    """A phase: slow descents, each ended by the goal or by contact, until one goes all the way.

    The error of a grasp lies along the tool's y: along its x the fingers have centred the part between them.
    """

    def __init__(self, name: str, planner: MotionPlanner, goal: Pose, depth_m: float, load: Load) -> None:
        """Args:
        name: type of the held part.
        goal: world_from_tool when it is let go.
        depth_m: the descents start this far above the goal.
        """
        self._name, self._planner, self._goal, self._depth_m, self._load = name, planner, goal, depth_m, load
        self._shifts_m = [0.0, *planner.settings.search_shifts_m]
        self._descending = True
        self._move = self._descent()

    def poll(self, observation: Observation, command: Command) -> Progress:
        """Lower, feel, and go back up where there was contact."""
        progress = self._move.poll(observation, command)
        if not self._descending:
            if progress.status is SkillStatus.SUCCESS:
                self._descending, self._move = True, self._descent()
                return self._move.poll(observation, command)
            return progress
        if progress.status is SkillStatus.FAILURE or not meets_something(self._planner, self._move, observation):
            return progress
        command.follow, command.stop_arm = None, True
        if tool_height_m(self._planner, observation) - self._goal.position_m[2] < RESTS_M:
            return done(f"{self._name} rests on the bracket")
        self._shifts_m.pop(0)
        if not self._shifts_m:
            return failed(f"the peg of {self._name} does not find its hole")
        self._descending, self._move = False, self._way_back()
        return Progress(SkillStatus.RUNNING, f"{self._name} met the rim")

    def _descent(self) -> Move:
        return self._line(f"lowering {self._name}", 0.0, self._planner.settings.insertion_speed_m_s)

    def _way_back(self) -> Move:
        return self._line(f"trying {self._name} {self._shifts_m[0] * 1000:+.1f} mm beside", self._depth_m, None)

    def _line(self, doing: str, rise_m: float, speed_m_s: float | None) -> Move:
        shifted = self._goal @ Pose((0.0, self._shifts_m[0], -rise_m))
        planner, load = self._planner, self._load
        return Move(
            doing,
            lambda start: planner.straight_move(start, shifted, load, speed_m_s),
            planner.settings,
            holding=self._name,
        )
