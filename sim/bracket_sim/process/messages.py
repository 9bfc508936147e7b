"""What controller and world say to each other: one type for each thing that is asked, and for each answer."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Literal

import can

from bracket_cell.remote.channel import Failure, Message
from bracket_cell.remote.detecting import Bench, Tray
from bracket_ground.interfaces.command import Display, GripperCommand, JointTrajectory
from bracket_ground.interfaces.devices import TruthEvent
from bracket_ground.interfaces.frame import Frame
from bracket_ground.interfaces.observation import ArmState, GripperState, JointSamples
from bracket_ground.interfaces.operator import OperatorOrder
from bracket_ground.interfaces.pose import Array

Pace = Literal["fast", "real"]
Camera = Literal["overhead", "wrist"]
CanFrames = Mapping[str, Sequence[can.Message]]  # by channel


class Hello(Message, frozen=True):
    """A controller wants to work here.

    Attributes:
        pace: "fast": the world advances only when it is told to; "real": it keeps pace with the wall clock.
        cell: what the controller takes the cell for, by name; the world refuses another one.
    """

    pace: Pace
    cell: Mapping[str, str]


class Ask(Message, frozen=True):
    """Somebody wants to know which world this is, and goes again."""


class Drawn(Message, frozen=True):
    """What the world was drawn from."""

    seed: int
    goal: str


class Refused(Message, frozen=True):
    """No controller is let in, and why."""

    reason: str


class Follow(Message, frozen=True):
    """The arm is to follow a trajectory; answered by Sent."""

    trajectory: JointTrajectory


class Grip(Message, frozen=True):
    """The gripper has a new goal; answered by Sent."""

    command: GripperCommand


class Sent(Message, frozen=True):
    """What was really sent to a device."""

    trajectory: JointTrajectory | None = None
    command: GripperCommand | None = None


class Stop(Message, frozen=True):
    """The arm is to stop; this and the following orders have no answer."""


class Share(Message, frozen=True):
    """The arm goes on at this share of its speed."""

    share: float


class Acknowledge(Message, frozen=True):
    """The arm is to be unlocked."""


class Activate(Message, frozen=True):
    """The gripper is to be activated."""


class Hold(Message, frozen=True):
    """The gripper is to hold what it has."""


class Trigger(Message, frozen=True):
    """A camera is to take a frame."""

    camera: Camera


class Show(Message, frozen=True):
    """The panel shows this."""

    display: Display


class Alarm(Message, frozen=True):
    """The panel shows a trouble."""

    text: str


class Upset(Message, frozen=True):
    """Something goes wrong on the bench, by its name."""

    name: str


class Can(Message, frozen=True):
    """What was sent on the CAN buses."""

    frames: CanFrames


class Detect(Message, frozen=True):
    """A frame is to be answered next to what made it; its answer is asked for by Answer."""

    camera: Camera
    sequence: int
    robot_m: Array | None = None


class Answer(Message, frozen=True):
    """The answer to a camera's oldest frame that was to be answered: Bench or Tray."""

    camera: Camera


class Begin(Message, frozen=True):
    """A world that stands goes with the wall's time from now on; answered by Begun."""


class Begun(Message, frozen=True):
    """What the machine's monotonic clock showed when the wall's time of this world was 0."""

    epoch_s: float


class Report(Message, frozen=True):
    """How is the assembly judged? Answered by Judged."""


class Finished(Message, frozen=True):
    """How were the brackets judged that were taken away? Answered by Judged."""


class Judged(Message, frozen=True):
    """Rows of a summary."""

    rows: Sequence[dict[str, object]]


class Advance(Message, frozen=True):
    """Tell how things are; in lock-step after the world has advanced to `until_s`. Answered by a Snapshot."""

    until_s: float | None = None


class Snapshot(Message, frozen=True):
    """How things are.

    Attributes:
        time_s: of the world, on the controller's clock.
        arm, gripper: their state; None where there is none.
        faults: of arm, gripper and cameras, why there is nothing.
        samples: what the arm measured since the last snapshot.
        frames: newest of each camera, where it is new.
        lost_s: how far the world fell behind the wall for good, so far.
    """

    time_s: float
    arm: ArmState | None
    gripper: GripperState | None
    faults: Mapping[str, Failure]
    samples: JointSamples | None
    frames: tuple[Frame, ...] = ()
    pressed: tuple[OperatorOrder, ...] = ()
    truth: tuple[TruthEvent, ...] = ()
    can: CanFrames = {}  # noqa: RUF012 - msgspec copies it
    lost_s: float = 0.0


class Welcome(Message, frozen=True):
    """A controller may work here.

    Attributes:
        epoch_s: as in Begun; None for a world that stands: it goes with the wall's time once it is told to begin.
        detects: frames may be answered there.
    """

    epoch_s: float | None
    detects: bool
    snapshot: Snapshot


Order = Stop | Share | Acknowledge | Activate | Hold | Trigger | Show | Alarm | Upset | Can | Detect
Call = Follow | Grip | Answer | Begin | Report | Finished | Advance
FromNewcomer = Hello | Ask
FromController = Order | Call
ToNewcomer = Welcome | Refused | Drawn | Failure
ToController = Sent | Bench | Tray | Begun | Judged | Snapshot | Failure
