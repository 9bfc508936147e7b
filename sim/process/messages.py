"""What controller and world say to each other; pickled, over a socket that only this user can open."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, Literal

import can

from cell.errors import CellError
from cell.interfaces.devices import TruthEvent
from cell.interfaces.observation import ArmState, GripperState, JointSamples
from cell.interfaces.operator import OperatorOrder
from cell.interfaces.perception import Frame

Pace = Literal["fast", "real"]
CanFrames = Mapping[str, tuple[can.Message, ...]]  # by channel


@dataclass(frozen=True)
class Hello:
    """A controller wants to work here.

    Attributes:
        pace: "fast": the world advances only when it is told to; "real": it keeps pace with the wall clock.
        cell: what the controller takes the cell for, by name; the world refuses another one.
    """

    pace: Pace
    cell: Mapping[str, str]


@dataclass(frozen=True)
class Ask:
    """Somebody wants to know which world this is, and goes again."""


@dataclass(frozen=True)
class Drawn:
    """What the world was drawn from."""

    seed: int
    goal: str


@dataclass(frozen=True)
class Refused:
    """No controller is let in, and why."""

    reason: str


@dataclass(frozen=True)
class Order:
    """Something to be done; nobody waits for an answer.

    Attributes:
        what: device and method, as in "arm.pace".
    """

    what: str
    arguments: tuple[Any, ...] = ()


@dataclass(frozen=True)
class Call:
    """Something to be done whose answer is waited for."""

    what: str
    arguments: tuple[Any, ...] = ()


@dataclass(frozen=True)
class Answer:
    """What a call came to: a value, None where it is what was given, or the error that it raised."""

    value: Any = None
    error: CellError | None = None


@dataclass(frozen=True)
class Advance:
    """Tell how things are; in lock-step after the world has advanced to `until_s`."""

    until_s: float | None = None


@dataclass(frozen=True)
class Snapshot:
    """How things are.

    Attributes:
        time_s: of the world, on the controller's clock.
        arm, gripper: their state, or why there is none.
        samples: what the arm measured since the last snapshot.
        frames: newest of each camera, where it is new.
        faults: of cameras that make no more frames.
        lost_s: how far the world fell behind the wall for good, so far.
    """

    time_s: float
    arm: ArmState | CellError
    gripper: GripperState | CellError
    samples: JointSamples | None
    frames: tuple[Frame, ...] = ()
    faults: Mapping[str, CellError] = field(default_factory=dict)
    pressed: tuple[OperatorOrder, ...] = ()
    truth: tuple[TruthEvent, ...] = ()
    can: CanFrames = field(default_factory=dict)
    lost_s: float = 0.0


@dataclass(frozen=True)
class Welcome:
    """A controller may work here.

    Attributes:
        epoch_s: what the machine's monotonic clock showed when the wall's time of this world was 0; None for a world
            that stands: it keeps pace with the wall clock once it is told to begin.
        hosts: detectors may run beside the frames.
    """

    epoch_s: float | None
    hosts: bool
    snapshot: Snapshot
