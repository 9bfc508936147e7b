"""The controller: a fixed-rate loop of observe, judge, tick, act and record, and the safe stop at its end."""

from __future__ import annotations

import math
import time
import traceback
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Protocol, TypeVar

from py_trees.common import Status

from cell.interfaces.command import Command
from cell.interfaces.devices import Devices, Gripper
from cell.interfaces.journal import ListJournal
from cell.interfaces.judgement import Action, Judgement
from cell.interfaces.observation import JointSamples, Observation
from cell.interfaces.perception import BenchView, Frame, PartsView
from cell.interfaces.signals import Signals
from cell.observer import End, Observer, Outcome, SentCommand, TickRecord
from cell.running.announcing import Announcer
from cell.running.audience import Audience
from cell.running.inference import Executor
from cell.running.operator import OperatorChannel
from cell.running.reading import DeviceReader, HeldFingers, describe
from cell.running.signals import Interrupted, StopSignals
from cell.running.supervisor import Supervisor
from cell.settings import ControllerSettings
from trees.engine.node import StatusChange

Answer = TypeVar("Answer")
RESTARTED = "gripper_restarted_empty"
STOPPED = "STOPPED"  # status of the root in a tick in which the supervisor stops the run before the tree is asked
STOPPING = "STOPPING"  # ... and in the ticks of the safe stop


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
    held_part: str | None


@dataclass(frozen=True)
class _Ending:
    """Why the loop ended."""

    end: End
    reason: str
    detail: str = ""


class Controller:
    """Runs one tree on one cell until the tree ends, time is over, a signal comes or the supervisor stops it.

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
        supervisor: Supervisor,
        observers: Sequence[Observer] = (),
        operator: OperatorChannel | None = None,
        signals: Signals | None = None,
    ) -> None:
        self._module = signals
        self.journal = ListJournal()
        self._devices = devices
        self._clock = devices.clock
        self._gripper = gripper
        self._settings = settings
        self._supervisor = supervisor
        self._period_s = 1.0 / settings.tick_hz
        self._audience = Audience(observers, devices.clock)
        self._reader = DeviceReader(
            devices,
            gripper,
            watcher,
            finder,
            self._audience.frame,
            lambda text: self._audience.say("warning", text),
            signals,
        )
        self._fingers = HeldFingers(gripper)
        self._signals = StopSignals()
        self._judgement = Judgement()
        self._announcer = Announcer()
        self._operator = operator or OperatorChannel()
        self._seen: Observation | None = None
        self._scheduled_s = self._deadline_s = 0.0
        self._ticks = 0
        self._overruns = 0

    def observe(self) -> Observation:
        """Read every device once, without a judgement.

        Raises:
            DeviceFault: arm or gripper cannot be read and never could.
        """
        seen = self._reader.observe(self._ticks)
        late_s = max(0.0, seen.time_s - self._scheduled_s)
        operator = self._operator.take(seen.time_s, self._devices.pressed())
        acknowledged = self._operator.acknowledged
        worked_s = 0.0 if self._seen is None else self._seen.worked_s
        gone_s = 0.0 if self._seen is None else seen.time_s - self._seen.time_s
        worked_s += self._judgement.share * gone_s
        return replace(seen, late_s=late_s, acknowledged=acknowledged, operator=operator, work_s=worked_s)

    def run(self, tree: TickedTree, services: TickServices) -> Outcome:
        """Run to the end and stop safely; raises nothing that a device, a node or an observer may raise."""
        began_s, wall_began_s = self._clock.now_s(), time.monotonic()
        self._scheduled_s = self._deadline_s = began_s
        with self._signals.heard():  # no signal raises in here, but in a tick of the tree
            ending = self._until_end(tree, services)
            condition, problems = self._stop(tree, services)
            end, reason = ending.end, ending.reason
            if problems:
                end, reason = "fault", "; ".join([reason, *problems])
            outcome = Outcome(
                end=end,
                reason=reason,
                ticks=self._ticks,
                overruns=self._overruns,
                sim_time_s=self._clock.now_s() - began_s,
                wall_time_s=time.monotonic() - wall_began_s,
                detail=ending.detail,
                condition=condition,
            )
            return self._close(outcome)

    def _until_end(self, tree: TickedTree, services: TickServices) -> _Ending:
        try:
            return self._loop(tree, services)
        except Interrupted as interrupted:
            return _Ending("interrupted", str(interrupted))
        except BaseException as error:  # the outermost loop: whatever happened, arm and gripper stop first
            return _Ending("fault", describe(error), traceback.format_exc())

    def _loop(self, tree: TickedTree, services: TickServices) -> _Ending:
        began_s = self._clock.now_s()
        while True:
            status = self._tick(tree, services)
            if self._judgement.action is Action.STOP:
                return _Ending("fault", self._judgement.reasons[0][1])
            if status is Status.SUCCESS:
                return _Ending("finished", "the tree succeeded")
            if status is Status.FAILURE:
                return _Ending("failed", "the tree failed")
            if self._operator.stopped:
                return _Ending("interrupted", "stopped by the operator")
            if self._signals.name:
                return _Ending("interrupted", f"stopped by {self._signals.name}")
            if self._clock.now_s() - began_s >= self._settings.max_duration_s:
                return _Ending("timeout", f"not finished after {self._settings.max_duration_s:g} s")
            self._sleep()

    def _tick(self, tree: TickedTree, services: TickServices) -> Status | None:
        """One tick; None where the supervisor stops the run before the tree is asked."""
        began_s = time.perf_counter()
        seen, joints = self._look()
        services.observation, services.command = seen, Command()
        asked, status, sent = Command(), None, SentCommand()
        changes: Sequence[StatusChange] = ()
        name = "ERROR"
        try:
            if self._judgement.action is Action.STOP:
                name = STOPPED
                return None
            status = self._signals.interruptible(tree.tick)
            name, asked = status.name, replace(services.command)
            self._judgement = self._supervisor.judge_command(seen, services.command)
            sent = self._act(services.command, seen)
        finally:  # a tick that failed is recorded too: it is the one that will be looked at
            if name != STOPPED:
                changes = tree.status_changes
            asked = services.command if name == "ERROR" else asked
            self._record(seen, name, changes, asked, sent, joints, began_s)
        return status

    def _look(self) -> tuple[Observation, JointSamples | None]:
        """Observe, and let the supervisor judge; the observation says what it allows."""
        seen, joints = self.observe(), self._reader.samples()
        self._judgement = self._supervisor.judge(seen)
        self._seen = self._fingers.seen(replace(seen, share=self._judgement.share))
        if (news := self._announcer.news(self._judgement)) is not None:
            self._audience.say(*news)
        return self._seen, joints

    def _act(self, command: Command, seen: Observation) -> SentCommand:
        """Carry out a command as far as the supervisor lets it; returns what the devices really sent."""
        held = self._judgement.action >= Action.HOLD
        trajectory = gripper = None
        if held:
            withhold(command)
        self._command("arm", lambda: self._devices.arm.pace(self._judgement.share))
        self._recover(seen)
        self._command("gripper", lambda: self._fingers.keep(seen, held))
        if command.stop_arm:
            self._command("arm", self._devices.arm.stop)
        elif (follow := command.follow) is not None:
            trajectory = self._command("arm", lambda: self._devices.arm.follow(follow))
        if command.activate_gripper:
            self._command("gripper", self._gripper.activate)
        if (goal := command.gripper) is not None:
            gripper = self._command("gripper", lambda: self._gripper.command(goal))
            self._fingers.sent(goal)
        if self._module is not None:
            for name, value in command.signals.items():
                self._command("signals", partial(self._module.write, name, value))
        if command.look:
            self._command("camera wrist", self._devices.wrist.trigger)
        if (display := command.display) is not None:
            self._operator.shown(display)
            self._command("panel", lambda: self._devices.panel.show(display))
        return SentCommand(trajectory, gripper)

    def _recover(self, seen: Observation) -> None:
        """Somebody acknowledged: unlock an arm that stopped by itself, activate a gripper that restarted empty."""
        if not seen.acknowledged:
            return
        self._command("arm", self._devices.arm.acknowledge)
        if any(signal == RESTARTED for signal, _ in self._judgement.reasons) and not seen.gripper.activated:
            self._command("gripper", self._gripper.activate)

    def _command(self, device: str, order: Callable[[], Answer]) -> Answer | None:
        try:
            return order()
        except Exception as error:  # the next observation tells the supervisor
            self._reader.refused(device, error)
            return None

    def _record(
        self,
        seen: Observation,
        status: str,
        changes: Sequence[StatusChange],
        command: Command,
        sent: SentCommand,
        joints: JointSamples | None,
        began_s: float,
    ) -> None:
        wall_s, observers_s = time.perf_counter() - began_s, self._audience.took_s
        overrun = wall_s + observers_s > self._period_s
        self._ticks += 1
        self._overruns += overrun
        notes = self.journal.take()
        self._audience.tick(
            TickRecord(
                seen,
                status,
                tuple(changes),
                notes,
                command,
                sent,
                wall_s,
                overrun,
                joints,
                self._judgement,
                observers_s,
            )
        )

    def _sleep(self) -> None:
        """To the next deadline; periods that are over are left out, so that ticks never come in a burst."""
        self._scheduled_s = self._deadline_s + self._period_s
        missed = max(0, math.floor((self._clock.now_s() - self._scheduled_s) / self._period_s))
        self._deadline_s = self._scheduled_s + missed * self._period_s
        self._clock.sleep_until(self._deadline_s)

    def _stop(self, tree: TickedTree, services: TickServices) -> tuple[str, list[str]]:
        """The safe stop, ticked and recorded until the arm stands; how things are at its end, and what went wrong."""
        emergency = self._seen is not None and self._seen.arm.mode == "emergency_stop"
        halted = Command()

        def halt_tree() -> None:
            services.command = halted
            tree.halt()

        orders: list[tuple[str, Callable[[], None]]] = [("the arm did not stop", self._devices.arm.stop)]
        if not emergency:
            orders.append(("the gripper did not hold", self._gripper.hold))
        problems = {what: text for what, order in orders if (text := _failure(order))}
        problem = _failure(halt_tree)
        if problem:
            problems["the tree did not halt"] = problem
        changes: Sequence[StatusChange] = tuple(tree.status_changes)
        until_s = self._clock.now_s() + self._settings.stop_timeout_s
        while True:
            self._sleep()
            began_s = time.perf_counter()
            seen = self._stopping_tick(services, changes, began_s)
            changes = ()
            if seen is not None and _at_rest(seen):
                break
            if self._clock.now_s() >= until_s:
                unknown = seen is None or any(trouble.device == "arm" for trouble in seen.troubles)
                what = "not known to stand" if unknown else "still moving"
                problems["the arm did not come to rest"] = f"{what} {self._settings.stop_timeout_s:g} s after the stop"
                break
            for what, order in orders:  # what was refused is ordered again
                if what in problems and not _failure(order):
                    del problems[what]
        return _condition(seen, services.held_part), [f"{what}: {text}" for what, text in problems.items()]

    def _stopping_tick(
        self, services: TickServices, changes: Sequence[StatusChange], began_s: float
    ) -> Observation | None:
        """One tick without the tree: see, keep the devices alive, record."""
        try:
            seen, joints = self._look()
            words = self._judgement.reasons
            self._judgement = Judgement(Action.STOP, 0.0, words)
            services.observation = seen
            self._command("arm", lambda: self._devices.arm.pace(0.0))
            self._record(seen, STOPPING, changes, Command(), SentCommand(), joints, began_s)
        except Exception:  # nothing may keep the loop from trying again until its time is over
            return None
        return seen

    def _close(self, outcome: Outcome) -> Outcome:
        self._audience.say("error" if outcome.end == "fault" else "info", f"{outcome.end}: {outcome.reason}")
        self._audience.say("info", outcome.condition)
        if outcome.detail:
            self._audience.say("error", outcome.detail)
        self._audience.close(outcome)
        return replace(outcome, observer_problems=tuple(self._audience.problems))


def withhold(command: Command) -> None:
    """Take out of a command what would begin to move; nodes see it and begin again."""
    command.follow, command.gripper, command.activate_gripper = None, None, False
    command.signals = {}


def _failure(order: Callable[[], object]) -> str:
    """What an order raised, in words; empty for nothing."""
    try:
        order()
    except Exception as error:  # the safe stop goes on with the other devices
        return describe(error)
    return ""


def _at_rest(seen: Observation) -> bool:
    """The arm answered in this tick, gave up its trajectory, and no joint moves."""
    answered = not any(trouble.device == "arm" for trouble in seen.troubles)
    return answered and not seen.arm.moving and seen.arm.stands


def _condition(seen: Observation | None, part: str | None) -> str:
    """How the cell was left, for people."""
    if seen is None:
        return "nothing is known of arm and gripper"
    arm = "the arm stands" if _at_rest(seen) else "the arm is not known to stand"
    if any(trouble.device == "gripper" for trouble in seen.troubles):
        return f"{arm}, nothing is known of the gripper"
    holds = f"holds {part or 'a part'}" if seen.gripper.holding else "holds nothing"
    return f"{arm}, the gripper {holds}"
