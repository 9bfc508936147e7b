"""The controller: a fixed-rate loop of observe, judge, tick, act and record, with the safe stop at its end."""

from __future__ import annotations

import math
import time
import traceback
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Protocol

from bracket_cell.running.device_reader import DeviceReader, RobotPoseHistory, describe
from bracket_cell.running.device_writer import DeviceActor
from bracket_cell.running.inference import Executor
from bracket_cell.running.observers import Announcer, Observers
from bracket_cell.running.operator import OperatorChannel
from bracket_cell.running.safe_stop import Interrupted, await_rest, condition, failure, stop_orders
from bracket_cell.running.supervisor import Supervisor
from bracket_cell.running.watchdog import Watchdog
from bracket_cell.settings import ControllerSettings
from bracket_cell.trees.nodes.services import Tick
from bracket_cell.watching.observer import End, Observer, Outcome, SentCommand, TickRecord
from bracket_ground.files.words.message import Message
from bracket_ground.interfaces.command import Command
from bracket_ground.interfaces.devices import Devices
from bracket_ground.interfaces.faults import Action, SafetyDecision
from bracket_ground.interfaces.frame import Frame
from bracket_ground.interfaces.memory import Memory
from bracket_ground.interfaces.notes import ListJournal, Topic
from bracket_ground.interfaces.observation import JointSamples, Observation
from bracket_ground.interfaces.perception import BenchView, PartsView
from btxml.engine.causes import Causes, collecting
from btxml.engine.node import StatusChange
from btxml.engine.status import Status
from btxml.engine.why import Reason

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

    def why(self) -> Reason | None:
        """Why the root ended in the last tick, or goes on."""
        ...


class TickServices(Protocol):
    """What the loop shares with the nodes: it renews what they see and ask for, before every tick."""

    now: Tick
    memory: Memory


@dataclass(frozen=True)
class _Ending:
    """Why the loop ended."""

    end: End
    reason: str
    detail: str = ""
    why: Reason | None = None


class Controller:
    """Runs one tree on one cell until the tree ends, time is over, a signal comes or the supervisor stops it.

    Attributes:
        journal: what nodes write their notes into.
    """

    def __init__(
        self,
        devices: Devices,
        watcher: Executor[Frame, BenchView],
        finder: Executor[Frame, PartsView],
        settings: ControllerSettings,
        supervisor: Supervisor,
        observers: Sequence[Observer] = (),
        operator: OperatorChannel | None = None,
        own_body: RobotPoseHistory | None = None,
        watchdog: Watchdog | None = None,
    ) -> None:
        self.journal = ListJournal()
        self._causes = Causes()
        self._devices = devices
        self._clock = devices.clock
        self._gripper = devices.gripper
        self._settings = settings
        self._supervisor = supervisor
        self._period_s = 1.0 / settings.tick_hz
        self._observers = Observers(observers, devices.clock)
        self._reader = DeviceReader(
            devices, watcher, finder, self._observers.frame, lambda text: self._observers.say("warning", text), own_body
        )
        self._watchdog = watchdog or Watchdog()
        self._signals = self._watchdog.signals
        self._judgement = SafetyDecision()
        self._announcer = Announcer()
        self._operator = operator or OperatorChannel()
        self._actor = DeviceActor(devices, self._operator, self._reader.refused)
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
        asked = self._supervisor.unacknowledged
        operator = self._operator.take(seen.time_s, self._devices.pressed(), asked=asked)
        acknowledged = self._operator.acknowledged
        worked_s = 0.0 if self._seen is None else self._seen.worked_s
        gone_s = 0.0 if self._seen is None else seen.time_s - self._seen.time_s
        worked_s += self._judgement.speed_scale * gone_s
        return replace(seen, late_s=late_s, acknowledged=acknowledged, operator=operator, work_s=worked_s)

    def run(self, tree: TickedTree, services: TickServices) -> Outcome:
        """Run to the end and stop safely; raises nothing that a device, a node or an observer may raise."""
        began_s, wall_began_s = self._clock.now_s(), time.monotonic()
        self._scheduled_s = self._deadline_s = began_s
        with self._watchdog.watching(), self._signals.heard():  # no signal raises in here, but in a step of a tick
            with self._watchdog.ticks(self._devices.arm.stop), collecting(self._causes):
                ending = self._until_end(tree, services)
                condition, problems = self._stop(tree, services)
            self._watchdog.left = condition
            self._watchdog.step("closing the log")
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
                why=ending.why,
            )
            return self._close(outcome)

    def _until_end(self, tree: TickedTree, services: TickServices) -> _Ending:
        try:
            return self._loop(tree, services)
        except (Interrupted, KeyboardInterrupt) as interrupted:  # the latter from what watches the run
            return _Ending("interrupted", str(interrupted) or "interrupted")
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
                return _Ending("failed", "the tree failed", why=tree.why())
            if self._operator.stopped:
                return _Ending("interrupted", "stopped by the operator")
            if self._signals.name:
                return _Ending("interrupted", Message("stopped by {name}", name=self._signals.name))
            if self._clock.now_s() - began_s >= self._settings.max_duration_s:
                words = Message("not finished after {limit_s} s", limit_s=f"{self._settings.max_duration_s:g}")
                return _Ending("timeout", words, why=tree.why())
            self._sleep()

    def _tick(self, tree: TickedTree, services: TickServices) -> Status | None:
        """One tick; None where the supervisor stops the run before the tree is asked."""
        began_s, doing = time.perf_counter(), self._watchdog.step
        doing("reading the devices")
        seen, joints = self._signals.interruptible(self._look)
        services.now.observation, services.now.command = seen, Command()
        asked, status, sent = Command(), None, SentCommand()
        changes: Sequence[StatusChange] = ()
        name = "ERROR"
        try:
            if self._judgement.action is Action.STOP:
                name = STOPPED
                return None
            doing("the tick of the tree")
            status = self._signals.interruptible(tree.tick)
            name, asked = status.name, replace(services.now.command)
            self._judgement = self._supervisor.judge_command(seen, services.now.command)
            doing("writing to the devices")
            sent = self._signals.interruptible(partial(self._actor.act, services.now.command, seen, self._judgement))
        finally:  # a tick that failed is recorded too: it is the one that will be looked at
            if name != STOPPED:
                changes = tree.status_changes
            asked = services.now.command if name == "ERROR" else asked
            doing("recording")
            self._record(seen, name, changes, asked, sent, joints, began_s)
        return status

    def _look(self, stopping: bool = False) -> tuple[Observation, JointSamples | None]:
        """Observe, and let the supervisor judge; the observation says what it allows."""
        self._watchdog.tick()
        seen, joints = self.observe(), self._reader.samples()
        self._judgement = made = self._supervisor.judge(seen, stopping)
        self._seen = self._actor.seen(replace(seen, speed_scale=made.speed_scale, holding_faults=made.holding_faults))
        if seen.acknowledged:
            paused = seen.operator.pause == "now"
            words = "acknowledged by the operator" if paused else "the operator says that it may go on"
            self._observers.say("info", words)
        self._announce(seen.time_s)
        return self._seen, joints

    def _announce(self, time_s: float) -> None:
        """Tell people what the supervisor does, and what waits for them, when that changes."""
        while self._operator.jobs.news:
            self._observers.say("warning", self._operator.jobs.news.pop(0))
        while self._watchdog.news:
            self._observers.say("error", self._watchdog.news.pop(0))
        unacknowledged = self._supervisor.unacknowledged
        if (news := self._announcer.news(self._judgement, time_s, unacknowledged)) is not None:
            self._observers.say(*news)
        if (alarm := self._announcer.alarm(self._judgement, unacknowledged)) is not None:
            self._actor.alarm(alarm)

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
        wall_s, observers_s = time.perf_counter() - began_s, self._observers.took_s
        overrun = wall_s + observers_s > self._period_s
        self._ticks += 1
        self._overruns += overrun
        causes: list[tuple[Topic, dict[str, object]]] = [("cause", cause.plain()) for cause in self._causes.take()]
        notes = (*self.journal.take(), *causes)
        self._observers.tick(
            TickRecord(
                observation=seen,
                status=status,
                changes=tuple(changes),
                notes=notes,
                command=command,
                sent=sent,
                wall_s=wall_s,
                overrun=overrun,
                joints=joints,
                judgement=self._judgement,
                observers_s=observers_s,
                unacknowledged=self._supervisor.unacknowledged,
            )
        )

    def _sleep(self) -> None:
        """To the next deadline; periods that are over are left out, so that ticks never come in a burst."""
        self._scheduled_s = self._deadline_s + self._period_s
        missed = max(0, math.floor((self._clock.now_s() - self._scheduled_s) / self._period_s))
        self._deadline_s = self._scheduled_s + missed * self._period_s
        self._watchdog.step("the wait for the next tick")
        self._clock.sleep_until(self._deadline_s)

    def _stop(self, tree: TickedTree, services: TickServices) -> tuple[str, list[str]]:
        """The safe stop, ticked and recorded until the arm stands; how things are at its end, and what went wrong."""
        halted = Command()

        def halt_tree() -> None:
            services.now.command = halted
            tree.halt()

        self._watchdog.stopping()
        orders = stop_orders(self._devices, self._gripper, self._seen)
        last = {"the tree did not halt": halt_tree}
        problems = {what: text for what, order in [*orders.items(), *last.items()] if (text := failure(order))}
        changes = [tuple(tree.status_changes)]

        def tick() -> Observation | None:
            self._sleep()
            return self._stopping_tick(services, changes.pop() if changes else ())

        timeout_s, gone = self._settings.stop_timeout_s, self._devices.gone
        seen = await_rest(orders, problems, tick, self._clock.now_s, timeout_s, gone)
        return condition(seen, services.memory.held_part), [f"{what}: {text}" for what, text in problems.items()]

    def _stopping_tick(self, services: TickServices, changes: Sequence[StatusChange]) -> Observation | None:
        """One tick without the tree: see, keep the devices alive, record."""
        began_s = time.perf_counter()
        try:
            self._watchdog.step("reading the devices")
            seen, joints = self._signals.interruptible(partial(self._look, stopping=True))
            self._judgement = SafetyDecision(Action.STOP, 0.0, self._judgement.reasons)
            services.now.observation = seen
            self._actor.pace(0.0)
            self._record(seen, STOPPING, changes, Command(), SentCommand(), joints, began_s)
        except (Exception, SystemExit):  # nothing may keep the loop from trying again until its time is over
            return None
        return seen

    def _close(self, outcome: Outcome) -> Outcome:
        self._observers.say("error" if outcome.end == "fault" else "info", f"{outcome.end}: {outcome.reason}")
        if outcome.cause:
            self._observers.say("info", f"why: {outcome.cause}")
        self._observers.say("info", outcome.condition)
        if outcome.detail:
            self._observers.say("error", outcome.detail)
        self._observers.close(outcome)
        return replace(outcome, observer_problems=tuple(self._observers.problems))
