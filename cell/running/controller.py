"""The controller: a fixed-rate loop of observe, tick, act and record, and the safe stop at its end."""

from __future__ import annotations

import signal
import time
import traceback
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from types import FrameType
from typing import Protocol

from py_trees.common import Status

from cell.configuration import ControllerSettings
from cell.interfaces.command import Command
from cell.interfaces.devices import Camera, Devices, Gripper
from cell.interfaces.errors import CellError, DeviceFault
from cell.interfaces.journal import ListJournal
from cell.interfaces.observation import Observation
from cell.interfaces.perception import BenchView, Frame, PartsView
from cell.observer import End, Level, Observer, Outcome, SentCommand, TickRecord
from cell.running.inference import Executor
from trees.engine.node import StatusChange


class TickedTree(Protocol):
    """What the loop needs of a tree."""

    def tick(self) -> Status:
        """Tick the root once."""
        ...

    def halt(self) -> None:
        """Bring every running node to rest."""
        ...

    @property
    def status_changes(self) -> Sequence[StatusChange]:
        """Changes of the last tick or halt, in order."""
        ...


class TickServices(Protocol):
    """What the loop renews before every tick; nodes read and fill it."""

    observation: Observation
    command: Command


class CameraReader:
    """A camera and the detector that reads its frames; keeps the newest frame's number and the newest answer."""

    def __init__(self, camera: Camera) -> None:
        self.camera = camera
        self._sequence = -1

    def new_frame(self) -> Frame | None:
        """The camera's newest frame if it was not handed out before."""
        frame = self.camera.latest()
        if frame is None or frame.sequence <= self._sequence:
            return None
        self._sequence = frame.sequence
        return frame


class Controller:
    """Runs one tree on one cell until the tree ends, time is over, a signal comes or something fails.

    Attributes:
        journal: what nodes write their notes into.
    """

    def __init__(
        self,
        devices: Devices,
        gripper: Gripper,
        watcher: Executor[Frame, BenchView],
        finder: Executor[Frame, PartsView],
        settings: ControllerSettings,
        observers: Sequence[Observer] = (),
    ) -> None:
        self.journal = ListJournal()
        self._devices = devices
        self._clock = devices.clock
        self._gripper = gripper
        self._watcher = watcher
        self._finder = finder
        self._settings = settings
        self._observeres = tuple(observers)
        self._overhead = CameraReader(devices.overhead)
        self._wrist = CameraReader(devices.wrist)
        self._bench: BenchView | None = None
        self._parts: PartsView | None = None
        self._signal: str | None = None
        self._stopping = False
        self._ticks = 0
        self._overruns = 0

    def observe(self) -> Observation:
        """Read every device once."""
        for eye, executor in ((self._overhead, self._watcher), (self._wrist, self._finder)):
            if (frame := eye.new_frame()) is not None:
                for observer in self._observeres:
                    observer.frame(frame)
                if not executor.submit(frame):
                    self._say("warning", f"the detector of camera {frame.camera} is late: frame dropped")
        self._bench = self._watcher.poll() or self._bench
        self._parts = self._finder.poll() or self._parts
        return Observation(
            tick=self._ticks,
            time_s=self._clock.now_s(),
            arm=self._devices.arm.state(),
            gripper=self._gripper.state(),
            bench=self._bench,
            parts=self._parts,
        )

    def run(self, tree: TickedTree, services: TickServices) -> Outcome:
        """Run to the end and stop safely; raises nothing that a device, a node or a observer may raise."""
        began_s, wall_began_s = self._clock.now_s(), time.monotonic()
        detail = ""
        with self._signals():
            try:
                end, reason = self._loop(tree, services)
            except DeviceFault as fault:
                end, reason = "fault", str(fault)
            except KeyboardInterrupt:
                end, reason = "interrupted", "interrupted in mid-tick"
            except Exception as error:  # the outermost loop: whatever happened, arm and gripper stop first
                end, reason = "fault", describe(error)
                detail = traceback.format_exc()
            self._stopping = True
            problems = self._stop(tree, services)
        if problems := [problem for problem in problems if reason not in problem]:
            end, reason = "fault", "; ".join([reason, *problems])
        outcome = Outcome(
            end=end,
            reason=reason,
            ticks=self._ticks,
            overruns=self._overruns,
            sim_time_s=self._clock.now_s() - began_s,
            wall_time_s=time.monotonic() - wall_began_s,
            detail=detail,
        )
        return self._close(outcome)

    def _loop(self, tree: TickedTree, services: TickServices) -> tuple[End, str]:
        period_s = 1.0 / self._settings.tick_hz
        began_s = deadline_s = self._clock.now_s()
        while True:
            status = self._tick(tree, services, period_s)
            if status is Status.SUCCESS:
                return "finished", "the tree succeeded"
            if status is Status.FAILURE:
                return "failed", "the tree failed"
            if self._signal:
                return "interrupted", f"stopped by {self._signal}"
            if self._clock.now_s() - began_s >= self._settings.max_duration_s:
                return "timeout", f"not finished after {self._settings.max_duration_s:g} s"
            # After an overrun of whole periods the loop does not catch up in a burst of ticks.
            deadline_s = max(deadline_s + period_s, self._clock.now_s())
            self._clock.sleep_until(deadline_s)

    def _tick(self, tree: TickedTree, services: TickServices, period_s: float) -> Status:
        began_s = time.perf_counter()
        observation, joints = self.observe(), self._devices.arm.samples()
        services.observation, services.command = observation, Command()
        status, sent = None, SentCommand()
        try:
            status = tree.tick()
            sent = self._act(services.command)
        finally:  # a tick that failed is recorded too: it is the one that will be looked at
            wall_s = time.perf_counter() - began_s
            self._ticks += 1
            self._overruns += wall_s > period_s
            record = TickRecord(
                observation=observation,
                status=status.name if status is not None else "ERROR",
                changes=tuple(tree.status_changes),
                notes=self.journal.take(),
                command=services.command,
                sent=sent,
                wall_s=wall_s,
                overrun=wall_s > period_s,
                joints=joints,
            )
            for observer in self._observeres:
                observer.tick(record)
        return status

    def _act(self, command: Command) -> SentCommand:
        """Carry out a command; returns what the devices really sent."""
        trajectory = gripper = None
        if command.stop_arm:
            self._devices.arm.stop()
        elif command.follow is not None:
            trajectory = self._devices.arm.follow(command.follow)
        if command.activate_gripper:
            self._gripper.activate()
        if command.gripper is not None:
            gripper = self._gripper.command(command.gripper)
        if command.look:
            self._devices.wrist.trigger()
        if command.display is not None:
            self._devices.panel.show(command.display)
        return SentCommand(trajectory, gripper)

    def _stop(self, tree: TickedTree, services: TickServices) -> list[str]:
        """Controlled stop: arm, gripper, then the tree; what fails does not keep the others from stopping."""

        def halt_tree() -> None:
            services.command = Command()
            tree.halt()

        problems = []
        steps: tuple[tuple[str, Callable[[], None]], ...] = (
            ("the arm did not stop", self._devices.arm.stop),
            ("the gripper did not hold", self._gripper.hold),
            ("the tree did not halt", halt_tree),
            ("the arm did not come to rest", self._rest),
        )
        for what, step in steps:
            try:
                step()
            except Exception as error:  # the safe stop goes on with the other devices
                problems.append(f"{what}: {describe(error)}")
        return problems

    def _rest(self) -> None:
        """Wait until the arm stands, so that nothing moves once the program has ended."""
        deadline_s = self._clock.now_s() + self._settings.stop_timeout_s
        while self._devices.arm.state().moving:
            now_s = self._clock.now_s()
            if now_s >= deadline_s:
                raise DeviceFault("arm", f"still moving {self._settings.stop_timeout_s:g} s after the stop")
            self._clock.sleep_until(now_s + 1.0 / self._settings.tick_hz)

    def _close(self, outcome: Outcome) -> Outcome:
        level: Level = "error" if outcome.end == "fault" else "info"
        problems = []
        for observer in self._observeres:
            try:
                observer.message(self._clock.now_s(), level, f"{outcome.end}: {outcome.reason}")
                if outcome.detail:
                    observer.message(self._clock.now_s(), "error", outcome.detail)
                observer.close(outcome)
            except Exception as error:  # every observer is closed, whatever another one does
                problems.append(describe(error))
        if not problems:
            return outcome
        return Outcome(**{**vars(outcome), "end": "fault", "reason": "; ".join([outcome.reason, *problems])})

    def _say(self, level: Level, text: str) -> None:
        for observer in self._observeres:
            observer.message(self._clock.now_s(), level, text)

    @contextmanager
    def _signals(self) -> Iterator[None]:
        """SIGINT and SIGTERM end the loop after the tick under way; a second one interrupts that tick."""

        def remember(number: int, _: FrameType | None) -> None:
            again, self._signal = self._signal, signal.Signals(number).name
            if again and not self._stopping:
                raise KeyboardInterrupt

        before = {number: signal.signal(number, remember) for number in (signal.SIGINT, signal.SIGTERM)}
        try:
            yield
        finally:
            for number, handler in before.items():
                signal.signal(number, handler)


def describe(error: Exception) -> str:
    """One line about an error: our own in their words, others with their type."""
    if isinstance(error, CellError):
        return str(error)
    return f"{type(error).__name__}: {error}"
