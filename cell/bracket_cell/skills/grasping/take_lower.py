"""Taking a part whose height is seen less well than its place: where the fingers close on nothing, they go lower."""

from __future__ import annotations

from dataclasses import dataclass, field

from bracket_cell.skills.grasping.contact import meets_something
from bracket_cell.skills.grasping.phases import Move, Phase, SetGripper, done
from bracket_cell.skills.motion.motions import StepDown
from bracket_cell.skills.motion.planner import MotionPlanner
from bracket_ground.files.words.message import Message
from bracket_ground.interfaces.command import Command, GripperCommand
from bracket_ground.interfaces.observation import ObjectStatus, Observation
from bracket_ground.interfaces.skill import Progress, SkillStatus

STEP_M = 0.018
GENTLE_M_S = 0.05  # of fingers that close on a stack, which may topple


@dataclass(eq=False)
class TakeLower:
    """A phase: close the fingers; while nothing is between them, open them, feel a step down, and close again.

    Attributes:
        name: type of the part.
        opening_m: of the fingers on the way down.
        lowest_m: height of the tool below which nothing can be.
        steps: down, at most.
    """

    name: str
    planner: MotionPlanner = field(repr=False)
    opening_m: float
    lowest_m: float
    steps: int
    _left: int = field(init=False)
    _phases: list[Phase] = field(init=False)

    def __post_init__(self) -> None:
        self._left, self._phases = self.steps, [self._close()]

    def poll(self, observation: Observation, command: Command) -> Progress:
        """Close, and where that was in vain, go down."""
        phase = self._phases[0]
        progress = phase.poll(observation, command)
        lowers = phase if isinstance(phase, Move) and progress.status is SkillStatus.RUNNING else None
        if lowers is not None and meets_something(self.planner, lowers, observation):
            command.follow, command.stop_arm = None, True
            progress = done(Message("the fingers feel what {name} lies on", name=self.name))
        if progress.status is SkillStatus.SUCCESS and self._phases[1:]:
            self._phases.pop(0)
        elif self._left and self._closed_in_vain(progress, observation):
            self._left -= 1
            self._phases = [self._gripper("opening the fingers", self.opening_m), self._lower(), self._close()]
        else:
            return progress
        return Progress(SkillStatus.RUNNING, progress.reason)

    def _closed_in_vain(self, progress: Progress, observation: Observation) -> bool:
        closed = not self._phases[1:] and observation.gripper.object_status is not ObjectStatus.MOVING
        return closed and progress.status is SkillStatus.FAILURE

    def _close(self) -> SetGripper:
        return self._gripper(Message("grasping {name}", name=self.name), 0.0, must_hold=True)

    def _gripper(self, doing: str, opening_m: float, *, must_hold: bool = False) -> SetGripper:
        settings = self.planner.settings
        speed_m_s = min(settings.gripper_speed_m_s, GENTLE_M_S) if self.steps else settings.gripper_speed_m_s
        goal = GripperCommand(opening_m, speed_m_s, settings.grip_force_n)
        return SetGripper(doing, goal, settings, must_hold=must_hold)

    def _lower(self) -> Move:
        step = StepDown(self.planner, STEP_M, self.lowest_m, self.opening_m)
        return Move(Message("reaching lower for {name}", name=self.name), step)
