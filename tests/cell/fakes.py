"""Fake devices, tree and observer for tests of the controller."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

import numpy as np

from bracket_cell.configuration import load_configuration, load_faults
from bracket_cell.running.controller import Controller
from bracket_cell.running.fault_checks import CHECKS, arm_checks, tick_checks
from bracket_cell.running.inference import LockStep
from bracket_cell.running.operator import OperatorChannel
from bracket_cell.running.supervisor import Supervisor
from bracket_cell.settings import ControllerSettings
from bracket_cell.skills.motion.arm_monitor import ArmMonitor, StopLimits
from bracket_cell.trees.nodes.services import Tick
from bracket_cell.watching.observer import Level, Observer, Outcome, TickRecord
from bracket_ground.interfaces.clock import ManualClock
from bracket_ground.interfaces.command import Display, GripperCommand, JointTrajectory
from bracket_ground.interfaces.devices import Devices
from bracket_ground.interfaces.frame import Frame
from bracket_ground.interfaces.memory import Memory
from bracket_ground.interfaces.observation import ArmMode, ArmState, GripperState, JointSamples, ObjectStatus
from bracket_ground.interfaces.perception import Action, BenchView, PartsView
from bracket_ground.interfaces.pose import Pose
from bracket_ground.interfaces.robot import default_robot
from btxml.engine.node import StatusChange
from btxml.engine.status import Status
from btxml.engine.why import Reason

PARKED = (0.0,) * 6
FAULTS = load_faults(load_configuration())
OF_CAMERAS = ("bench_stale", "bench_in_the_future", "camera_unhealthy", "hand_unknown")  # most fakes have no frames


def arm_monitor() -> ArmMonitor:
    """Of an arm whose tool is where its first three joints say."""
    return ArmMonitor(default_robot(), 0.078, StopLimits(), lambda joints: joints[:3], lambda _: 1.0)


def frame(sequence: int, time_s: float = 0.0, camera: str = "overhead") -> Frame:
    """A grey image of 8 x 6 pixels."""
    return Frame(camera, sequence, time_s, np.full((6, 8, 3), 128, np.uint8), Pose((0.0, 0.0, 1.0)))


@dataclass
class FakeCamera:
    """Hands out what a test put there."""

    clock: ManualClock
    newest: Frame | None = None
    triggers: int = 0

    def trigger(self) -> None:
        self.triggers += 1

    def latest(self) -> Frame | None:
        return self.newest


@dataclass
class FakeArm:
    """Notes what it was told; after a stop it moves on for `coast_polls` readings."""

    clock: ManualClock
    calls: list[str] = field(default_factory=list)
    coast_polls: int = 0
    swing_polls: int = 0
    stop_error: Exception | None = None
    shares: list[float] = field(default_factory=list)
    mode: ArmMode = "normal"
    positions_rad: tuple[float, ...] = PARKED

    def state(self) -> ArmState:
        moving = "stop" in self.calls and self.coast_polls > 0
        self.coast_polls -= moving
        swings = "stop" in self.calls and self.swing_polls > 0
        self.swing_polls -= swings
        return ArmState(self.clock.now_s(), self.positions_rad, (0.1 * swings, *PARKED[1:]), moving, self.mode)

    def follow(self, trajectory: JointTrajectory) -> JointTrajectory:
        self.calls.append("follow")
        return trajectory

    def stop(self) -> None:
        self.calls.append("stop")
        if self.stop_error is not None:
            raise self.stop_error

    def pace(self, share: float) -> None:
        self.shares.append(share)

    def acknowledge(self) -> None:
        self.calls.append("acknowledge")

    def samples(self) -> JointSamples | None:
        return None


@dataclass
class FakeGripper:
    """Notes what it was told; sends whole millimetres only."""

    clock: ManualClock
    calls: list[str] = field(default_factory=list)
    fault: Exception | None = None

    def state(self) -> GripperState:
        if self.fault is not None:
            raise self.fault
        return GripperState(self.clock.now_s(), True, ObjectStatus.AT_POSITION, 0.085, 0.0, 0)

    def activate(self) -> None:
        self.calls.append("activate")

    def command(self, command: GripperCommand) -> GripperCommand:
        self.calls.append("command")
        return GripperCommand(round(command.opening_m, 3), command.speed_m_s, command.force_n)

    def hold(self) -> None:
        self.calls.append("hold")

    def close(self) -> None:
        self.calls.append("close")


@dataclass
class FakePanel:
    """Keeps what it was shown."""

    shown: list[Display] = field(default_factory=list)
    alarms: list[str] = field(default_factory=list)

    def show(self, display: Display) -> None:
        self.shown.append(display)

    def alarm(self, text: str) -> None:
        self.alarms.append(text)


@dataclass
class FakeServices:
    """What the loop renews, and a memory."""

    now: Tick
    memory: Memory = field(default_factory=Memory)


@dataclass
class FakeTree:
    """Calls `act` in each tick and answers what it returns."""

    act: Callable[[int], Status]
    ticks: int = 0
    halts: int = 0
    status_changes: Sequence[StatusChange] = ()

    def tick(self) -> Status:
        status = self.act(self.ticks)
        self.ticks += 1
        return status

    def halt(self) -> None:
        self.halts += 1

    def why(self) -> Reason | None:
        """Nobody knows."""
        return None


@dataclass
class FakeObserver(Observer):
    """Keeps what it was told."""

    records: list[TickRecord] = field(default_factory=list)
    frames: list[Frame] = field(default_factory=list)
    messages: list[str] = field(default_factory=list)
    outcomes: list[Outcome] = field(default_factory=list)

    def frame(self, frame: Frame) -> None:
        self.frames.append(frame)

    def tick(self, record: TickRecord) -> None:
        self.records.append(record)

    def message(self, time_s: float, level: Level, text: str) -> None:
        self.messages.append(f"{time_s:.2f} {level}: {text}")

    def close(self, outcome: Outcome) -> None:
        self.outcomes.append(outcome)


def idle_view(seen: Frame) -> BenchView:
    """An answer that nothing goes on."""
    return BenchView(seen.sequence, seen.time_s, None, {}, Action("idle", 1.0))


def no_parts(seen: Frame) -> PartsView:
    """An answer that the tray is empty."""
    return PartsView(seen.sequence, seen.time_s, ())


class Rig:
    """A controller among fakes.

    Attributes:
        services: what a test's tree reads and fills.
    """

    def __init__(
        self,
        settings: ControllerSettings | None = None,
        latency_s: float = 0.1,
        observers: Sequence[Observer] = (),
        gripper: Callable[[ManualClock], FakeGripper] | None = None,
    ) -> None:
        self.clock = ManualClock()
        self.overhead, self.wrist = FakeCamera(self.clock), FakeCamera(self.clock)
        self.arm, self.panel = FakeArm(self.clock), FakePanel()
        self.gripper = (gripper or FakeGripper)(self.clock)
        self.observer, self.operator = FakeObserver(), OperatorChannel()
        self.devices = Devices(
            clock=self.clock,
            arm=self.arm,
            gripper=self.gripper,
            overhead=self.overhead,
            wrist=self.wrist,
            panel=self.panel,
        )
        self.controller = Controller(
            self.devices,
            LockStep(idle_view, self.clock, latency_s),
            LockStep(no_parts, self.clock, latency_s),
            settings or ControllerSettings(),
            Supervisor(
                [fault for fault in FAULTS.faults if fault.signal not in OF_CAMERAS],
                {**CHECKS, **arm_checks(arm_monitor()), **tick_checks(0.04)},
            ),
            [self.observer, *observers],
            self.operator,
        )
        self.services = FakeServices(Tick(self.controller.observe()))

    def run(self, act: Callable[[int], Status]) -> tuple[Outcome, FakeTree]:
        """Run a tree that calls `act`."""
        tree = FakeTree(act)
        return self.controller.run(tree, self.services), tree
