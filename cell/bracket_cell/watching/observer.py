"""What the controller reports of a run, and to whom: recorder, progress display and contact sheet are observers."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from bracket_ground.interfaces.command import Command, GripperCommand, JointTrajectory
from bracket_ground.interfaces.faults import SafetyDecision
from bracket_ground.interfaces.frame import Frame
from bracket_ground.interfaces.notes import Topic
from bracket_ground.interfaces.observation import JointSamples, Observation
from btxml.engine.node import StatusChange
from btxml.engine.why import Reason

End = Literal["finished", "failed", "timeout", "interrupted", "fault"]
Level = Literal["info", "warning", "error"]
TRACEBACK = "Traceback"  # how a message begins that is for the log alone, as its error was said
EXIT_STATUS: dict[End, int] = {"finished": 0, "failed": 1, "timeout": 1, "interrupted": 1, "fault": 3}


@dataclass(frozen=True)
class SentCommand:
    """What the devices really sent for a command; None where nothing was asked."""

    trajectory: JointTrajectory | None = None
    gripper: GripperCommand | None = None


@dataclass(frozen=True)
class TickRecord:
    """One tick: what it knew, what changed in the tree, and what was done.

    Attributes:
        status: of the root, by name; "ERROR" where the tick raised, "STOPPING" where the tree was not ticked any more.
        notes: what nodes reported, in order.
        command: what the nodes asked for.
        wall_s: how long observe, tick and act took on this machine.
        overrun: that was longer than the period, together with `observers_s`.
        joints: what the arm measured since the tick before, at its own rate.
        judgement: what the supervisor allowed; None in tests that have none.
        unacknowledged: it waits until a person acknowledges what happened.
        observers_s: how long the observers took over the tick before.
    """

    observation: Observation
    status: str
    changes: tuple[StatusChange, ...]
    notes: tuple[tuple[Topic, dict[str, object]], ...]
    command: Command
    sent: SentCommand
    wall_s: float
    overrun: bool
    joints: JointSamples | None = None
    judgement: SafetyDecision | None = None
    observers_s: float = 0.0
    unacknowledged: bool = False


STANDING_CONDITIONS = ("the arm stands", "nothing has moved")  # begin of a condition in which it does


@dataclass(frozen=True)
class Outcome:
    """How a run ended.

    Attributes:
        detail: more than one line about an error inside the controller, for the log only.
        condition: how arm and gripper were left, in words.
        observer_problems: what observers raised; they do not change how the run ended.
        why: which node of the tree let it end so, where the tree did, or time was over.
    """

    end: End
    reason: str
    ticks: int
    overruns: int
    sim_time_s: float
    wall_time_s: float
    detail: str = ""
    condition: str = ""
    observer_problems: tuple[str, ...] = ()
    why: Reason | None = None

    @property
    def cause(self) -> str:
        """The same as one sentence, empty where there is none."""
        return "" if self.why is None else str(self.why)

    @property
    def arm_stands(self) -> bool:
        """Whether the arm is known to stand."""
        return self.condition.startswith(STANDING_CONDITIONS)

    @property
    def exit_status(self) -> int:
        return EXIT_STATUS[self.end]


class Observer:
    """Follows a run; called from the loop, so each call is short. A derived class overrides what it is about."""

    def frame(self, frame: Frame) -> None:
        """A camera frame arrived."""

    def tick(self, record: TickRecord) -> None:
        """A tick is done."""

    def message(self, time_s: float, level: Level, text: str) -> None:
        """The controller says something."""

    def close(self, outcome: Outcome) -> None:
        """The run is over; called once."""
