"""Taking a part whose height is seen less well than its place: where the fingers close on nothing, they go lower."""

from __future__ import annotations

from cell.files.words.message import Message
from cell.interfaces.command import Command, GripperCommand
from cell.interfaces.observation import ObjectStatus, Observation
from cell.interfaces.pose import Array
from cell.interfaces.skill import Progress, SkillStatus
from skills.grasping.contact import meets_something
from skills.grasping.phases import Move, Phase, SetGripper, done
from skills.motion.planner import Load, MotionPlanner, Plan, at_height

STEP_M = 0.018
GENTLE_M_S = 0.05  # of fingers that close on a stack, which may topple


class TakeLower:
    """A phase: close the fingers; while nothing is between them, open them, feel a step down, and close again."""

    def __init__(self, name: str, planner: MotionPlanner, opening_m: float, lowest_m: float, steps: int) -> None:
        """Args:
        name: type of the part.
        opening_m: of the fingers on the way down.
        lowest_m: height of the tool below which nothing can be.
        steps: down, at most.
        """
        self._name, self._planner = name, planner
        self._opening_m, self._lowest_m, self._steps, self._left = opening_m, lowest_m, steps, steps
        self._phases: list[Phase] = [self._close()]

    def poll(self, observation: Observation, command: Command) -> Progress:
        """Close, and where that was in vain, go down."""
        phase = self._phases[0]
        progress = phase.poll(observation, command)
        lowers = phase if isinstance(phase, Move) and progress.status is SkillStatus.RUNNING else None
        if lowers is not None and meets_something(self._planner, lowers, observation):
            command.follow, command.stop_arm = None, True
            progress = done(Message("the fingers feel what {name} lies on", name=self._name))
        if progress.status is SkillStatus.SUCCESS and self._phases[1:]:
            self._phases.pop(0)
        elif self._left and self._closed_in_vain(progress, observation):
            self._left -= 1
            self._phases = [self._gripper("opening the fingers", self._opening_m), self._lower(), self._close()]
        else:
            return progress
        return Progress(SkillStatus.RUNNING, progress.reason)

    def _closed_in_vain(self, progress: Progress, observation: Observation) -> bool:
        closed = not self._phases[1:] and observation.gripper.object_status is not ObjectStatus.MOVING
        return closed and progress.status is SkillStatus.FAILURE

    def _close(self) -> SetGripper:
        return self._gripper(Message("grasping {name}", name=self._name), 0.0, must_hold=True)

    def _gripper(self, doing: str, opening_m: float, *, must_hold: bool = False) -> SetGripper:
        settings = self._planner.settings
        speed_m_s = min(settings.gripper_speed_m_s, GENTLE_M_S) if self._steps else settings.gripper_speed_m_s
        goal = GripperCommand(opening_m, speed_m_s, settings.grip_force_n)
        return SetGripper(doing, goal, settings, must_hold=must_hold)

    def _lower(self) -> Move:
        planner = self._planner

        def plan(start_rad: Array) -> Plan:
            tool = planner.kinematics.forward(start_rad)
            down = at_height(tool, max(tool.position_m[2] - STEP_M, self._lowest_m))
            alone = Load(self._opening_m, close=True)  # what is there is felt
            return planner.straight_move(start_rad, down, alone, planner.settings.close_speed_m_s)

        return Move(Message("reaching lower for {name}", name=self._name), plan, planner.settings)
