"""Device protocols: real drivers and the simulator implement the same ones."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Protocol, runtime_checkable

from bracket_ground.interfaces.clock import Clock
from bracket_ground.interfaces.command import Display, GripperCommand, JointTrajectory
from bracket_ground.interfaces.frame import Frame
from bracket_ground.interfaces.observation import ArmState, GripperState, JointSamples, ObjectStatus
from bracket_ground.interfaces.operator import OperatorOrder
from bracket_ground.interfaces.perception import BenchView, PartsView


@dataclass(frozen=True)
class TruthEvent:
    """Something that happened at the bench.

    Attributes:
        kind: "action" (of the hand: begins or ends), "act" (of the person, a mistake or a habit), "contact" (of
            person and robot), "resting" (of a part in the tray as the run begins).
        fields: what else is known, with units in the names.
    """

    time_s: float
    kind: str
    fields: Mapping[str, object] = field(default_factory=dict)


class Signals(Protocol):
    """Inputs and outputs by their names in the configuration."""

    def read(self) -> Mapping[str, bool]:
        """All inputs as last told, and all outputs as last set; raises DeviceFault when the module is silent."""
        ...

    def write(self, name: str, value: bool) -> None:
        """Set an output; it keeps its value until it is set again, also after the run."""
        ...

    def close(self) -> None:
        """Let go of the bus."""
        ...


ROLES = ("arm", "gripper", "overhead", "wrist", "panel", "signals")  # of the devices of a cell
KEEP_ALIVE_S = 0.2  # an arm that hears nothing for this long stands still on its path


@dataclass(frozen=True)
class DeviceCheck:
    """One thing that was looked at on a device, without moving it.

    Attributes:
        what: in words.
        remedy: what to do; empty where all is well.
    """

    what: str
    remedy: str = ""


class Camera(Protocol):
    """A camera whose intrinsics and mount the bench file gives."""

    def trigger(self) -> None:
        """Ask for one frame; a free-running camera needs none and ignores it."""
        ...

    def latest(self) -> Frame | None:
        """The newest frame, or None before the first; never waits. Raises DeviceFault when no more will come."""
        ...


class Arm(Protocol):
    """An arm that follows joint trajectories in its own control periods."""

    def state(self) -> ArmState:
        """Joints as last measured, with the arm's mode; old ones, or DeviceFault, where the arm does not answer."""
        ...

    def follow(self, trajectory: JointTrajectory) -> JointTrajectory:
        """Start now, replacing what was followed; returns what was really sent, within the joint limits."""
        ...

    def stop(self) -> None:
        """Controlled stop within the limits, which also gives up the trajectory; harmless when standing."""
        ...

    def pace(self, share: float) -> None:
        """Follow the trajectory at this share of its speed, 0 to 1; 0 stands still on it and can be resumed.

        Called in every tick: an arm that was not called for KEEP_ALIVE_S slows down to 0 by itself.
        """
        ...

    def acknowledge(self) -> None:
        """Somebody at the cell acknowledged a protective stop: unlock it, if the arm can be; harmless otherwise."""
        ...

    def samples(self) -> JointSamples | None:
        """What was measured since the last call, a faulted arm included; None from an arm that keeps nothing."""
        ...


@runtime_checkable
class Loaded(Protocol):
    """An arm whose controller must know what hangs on its flange."""

    def carry(self, held: bool) -> None:
        """A part is held, or is not any more; never waits, never raises."""
        ...


class Gripper(Protocol):
    """What holds parts: two fingers, or a cup, whose opening is 0 while it is on."""

    def state(self) -> GripperState:
        """Last status; raises DeviceFault when no heartbeat came for 1.5 periods, LatchedFault for a latched fault."""
        ...

    def activate(self) -> None:
        """Begin activation (a full open and close); `state().activated` says when it is done."""
        ...

    def command(self, command: GripperCommand) -> GripperCommand:
        """Start a motion; returns what was really sent, rounded to the register's steps."""
        ...

    def hold(self) -> None:
        """Stop the fingers where they are and keep the grip."""
        ...

    def close(self) -> None:
        """Let go of the bus."""
        ...


class NoGripper:
    """Implements `Gripper` where the arm has none: it is where it was told to be, and holds nothing."""

    def __init__(self, clock: Clock) -> None:
        self._clock, self._opening_m = clock, 0.0

    def state(self) -> GripperState:
        """Of now."""
        at = ObjectStatus.AT_POSITION
        return GripperState(self._clock.now_s(), True, at, self._opening_m, 0.0, 0, "operational")

    def activate(self) -> None:
        """It is."""

    def command(self, command: GripperCommand) -> GripperCommand:
        """Nothing moves."""
        self._opening_m = command.opening_m
        return command

    def hold(self) -> None:
        """Nothing moves."""

    def close(self) -> None:
        """Nothing is there."""


class Panel(Protocol):
    """What the person at the bench sees and hears."""

    def show(self, display: Display) -> None:
        """Replace what is shown."""
        ...

    def alarm(self, text: str) -> None:
        """Show a trouble of the cell beside it until another text comes; an empty one takes it away."""
        ...


class EmptyPanel:
    """A panel without a reader."""

    def show(self, display: Display) -> None:
        """Nothing happens."""

    def alarm(self, text: str) -> None:
        """Nothing happens."""

    def close(self) -> None:
        """Nothing to let go of."""


class DetectorHost(Protocol):
    """Detectors next to what makes a simulated cell's frames, beside the controller."""

    def await_ready(self) -> None:
        """Until the detectors are made; raises CellError where one cannot be."""
        ...

    def begin(self, frame: Frame, /) -> Callable[[], BenchView | PartsView]:
        """Send a frame of this cell to the detector of its camera.

        Returns:
            what waits for the answer.

        Raises:
            CellError: a detector could not be made, or its process has failed; what is returned raises it, too.
        """
        ...


@dataclass(frozen=True, kw_only=True)
class Devices:
    """All devices of a cell.

    Attributes:
        signals: None where the cell has none.
        images: frames show what the cameras see; without, detectors answer from a simulator's truth.
        host: where detectors run in lock-step beside a simulation; None: in the controller's process.
        gone: whether a simulation is gone for good: nobody need wait for its arm.
        lost_s: how far a simulation that goes with the wall's time fell behind it for good.
        free_running: told whether time is the wall's: then a simulation leaves out what is not done in time.
        report: how the finished assembly is judged, by keys of `cell run --json`; empty if it cannot be judged.
        close: lets go of the simulator; drivers are closed by who opened them.
        pressed: what was said or pressed at the bench itself since the last call.
        finished: how brackets that were taken away were judged, in order, by the keys of `report`.
        truth: what really happened since the last call, for the log alone; empty if unknown.
        upset: lets something of this name go wrong on a simulated bench; None where the bench is real.
    """

    clock: Clock
    arm: Arm
    gripper: Gripper
    overhead: Camera
    wrist: Camera
    panel: Panel
    signals: Signals | None = None
    report: Callable[[], dict[str, object]] = dict
    close: Callable[[], None] = lambda: None
    truth: Callable[[], Sequence[TruthEvent]] = tuple
    pressed: Callable[[], Sequence[OperatorOrder]] = tuple
    finished: Callable[[], Sequence[dict[str, object]]] = tuple
    images: bool = True
    host: DetectorHost | None = None
    free_running: Callable[[bool], None] = lambda _: None
    lost_s: Callable[[], float] = lambda: 0.0
    gone: Callable[[], bool] = lambda: False
    upset: Callable[[str], None] | None = None
