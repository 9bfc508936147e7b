"""The parts of one run: devices, log, counts, observers and viewers, and what they ask of each other."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np
from rich.console import Console

from bracket_cell.configuration import Configuration
from bracket_cell.plant.bits import PlantBits
from bracket_cell.production.bookkeeper import Bookkeeper
from bracket_cell.recording.recorder import McapRecorder
from bracket_cell.recording.scene import CellModel
from bracket_cell.running.operator import OperatorChannel
from bracket_cell.running.supervisor import Supervisor
from bracket_cell.running.work_orders import WorkOrders
from bracket_cell.runs.heading import Counts, heading
from bracket_cell.runs.options import Files, RunOptions
from bracket_cell.runs.viewers import Viewers, open_viewers
from bracket_cell.simulator import simulator
from bracket_cell.skills.motion.kinematics import Kinematics
from bracket_cell.skills.motion.planner import MotionPlanner
from bracket_cell.trees.nodes.services import Services
from bracket_cell.viewing.instruction import OperatorGuide
from bracket_cell.viewing.moments import Moments
from bracket_cell.viewing.progress import LiveProgress
from bracket_cell.watching.lateness import Lateness
from bracket_cell.watching.observer import Level, Observer
from bracket_cell.watching.statistics import FinishedBrackets, Fluency, RunStatistics
from bracket_cell.watching.why_now import WhyNow
from bracket_cell.wiring.detectors import detectors_of
from bracket_cell.wiring.devices import Drivers, attached
from bracket_cell.wiring.reload import WatchedTree
from bracket_cell.wiring.run_state import state_of
from bracket_ground.files.words.catalogue import catalogue
from bracket_ground.interfaces.clock import PacedClock, WakingClock
from bracket_ground.interfaces.devices import Devices, TruthEvent
from bracket_ground.interfaces.observation import Observation
from bracket_ground.interfaces.product import Product
from btxml.engine.tree import Tree


class RunParts:
    """All that a run needs beside its controller; what is opened is closed by the stack.

    Attributes:
        ticked: the tree, or one whose edits take over.

    Raises:
        DeviceFault: a device could not be opened.
        InputError: a port of a viewer is taken.
    """

    def __init__(
        self,
        options: RunOptions,
        files: Files,
        motion: MotionPlanner,
        drivers: Drivers,
        keeper: Bookkeeper,
        log: Path,
        console: Console,
        stack: ExitStack,
    ) -> None:
        self._files, configuration, product = files, files.configuration, files.product
        self.ticked: Tree | WatchedTree = files.tree
        self.devices = _opened(options, files, drivers, stack, lambda: self.recorder.settle())
        model = CellModel(product, configuration.bench, motion)
        self.recorder = self._recorder(options, log, model, stack)
        lateness = _lateness(files, self.devices, self._alarm)
        missing = keeper.missing(len(self.devices.finished()))
        self.counts = Counts(
            RunStatistics(), lateness, Fluency(partial(tool_on_bench_m, motion.kinematics)), keeper, missing
        )
        self.moments, why_now, words = Moments(), WhyNow(self._tree), catalogue(configuration.page.language)
        self._progress = LiveProgress(
            console, 1.0 / configuration.controller.tick_hz, OperatorGuide(product, self._tree), words, why_now
        )
        titles = {goal: product.goal_title(goal) for goal in product.goals}
        jobs = WorkOrders(titles, options.work_orders, keeper.book)
        self.operator = _operator(options, product, jobs)
        now_s = self.devices.clock.now_s
        lost = partial(console.print, "MQTT:")
        press = self.operator.press
        viewers = open_viewers(options, files, self.recorder, press, lost, now_s, stack, model, keeper)
        for line in viewers.addresses:
            console.print(line, highlight=False, soft_wrap=True)
        self.observers = self._observers(why_now, viewers)
        if options.await_monitor and viewers.monitor is not None:
            viewers.monitor.await_view()
        if options.watch:
            self.ticked = _watched(options, files, self.observers, viewers.edited)

    def say_unsafe(self) -> None:
        """Tell every observer where table or separation do less than the shipped ones."""
        for observer in self.observers if self._files.unsafe else ():
            observer.message(self.devices.clock.now_s(), "error", f"UNSAFE: {'; '.join(self._files.unsafe)}")

    def begun(self, services: Services, supervisor: Supervisor) -> None:
        """Let each part of the log begin with the state of the run."""
        self.recorder.state = lambda: state_of(self._tree(), services, supervisor)

    def _recorder(self, options: RunOptions, log: Path, model: CellModel, stack: ExitStack) -> McapRecorder:
        told, in_step = heading(options, self._files), options.pace == "fast"
        recorder = McapRecorder(
            log,
            self._files.configuration.log,
            told,
            model,
            self._alarm,
            self._blackboard,
            self._truth,
            self._result,
            in_step,
            options.overwrite,
        )
        stack.callback(recorder.abandon)
        return recorder

    def _observers(self, why_now: WhyNow, viewers: Viewers) -> tuple[Observer, ...]:
        goals = self._files.configuration.planners.semantic.goals
        finished = () if goals is None else (FinishedBrackets(goals, self._files.product),)
        self.recorder.why = lambda: why_now().plain()
        first = (why_now, self.recorder, self._progress, self.moments)
        bits, signals = self._files.configuration.plant.bits, self.devices.signals
        plant = () if signals is None else (PlantBits(bits, signals, self._files.product, self.operator.press),)
        return (*first, *self.counts.observers, *viewers.observers, *finished, *plant)

    def _alarm(self, time_s: float, level: Level, text: str) -> None:
        self._progress.message(time_s, level, text)
        trouble = text if level == "error" else ""
        self._progress.alarm(trouble)
        self.devices.panel.alarm(trouble)

    def _tree(self) -> Tree:
        return self.ticked.tree if isinstance(self.ticked, WatchedTree) else self.ticked

    def _blackboard(self) -> Mapping[str, object]:
        return self._tree().blackboard.values()

    def _truth(self) -> Sequence[TruthEvent]:
        return self.devices.truth()

    def _result(self) -> Mapping[str, object]:
        return self.counts.job(self.devices)


def tool_on_bench_m(kinematics: Kinematics, seen: Observation) -> tuple[float, float]:
    """Where the tool is above the bench, (x, y); far from everything where the arm does not tell."""
    joints = seen.arm.known_rad(kinematics.count)
    x, y, _ = [math.inf] * 3 if joints is None else kinematics.position_m(np.array(joints)).tolist()
    return x, y


def _operator(options: RunOptions, product: Product, jobs: WorkOrders) -> OperatorChannel:
    shift = options.brackets is not None
    return OperatorChannel(product.goals, options.attended, options.brackets or None, shift, jobs, product.fastenings)


def _lateness(files: Files, devices: Devices, say: Callable[[float, Level, str], None]) -> Lateness:
    """Counts how late ticks begin, and asks the clock why."""
    period_s, clock = 1.0 / files.configuration.controller.tick_hz, devices.clock
    return Lateness(period_s, lambda: getattr(clock, "delays", {}), devices.lost_s, say)


def _watched(
    options: RunOptions, files: Files, observers: Sequence[Observer], edited: Callable[[Tree, float], None]
) -> WatchedTree:
    """A tree whose edits take over."""

    def again() -> Tree:
        return options.load(files.product, files.configuration)

    return WatchedTree(files.tree, again, options.tree, observers, edited)


def _opened(
    options: RunOptions, files: Files, drivers: Drivers, stack: ExitStack, awake: Callable[[], None]
) -> Devices:
    """The devices; in simulated time each tick begins once the one before is on the disk, the wall's does not wait."""
    configuration, product, simulated = files.configuration, files.product, options.devices
    if simulated is None and configuration.devices.simulated:
        simulated = _simulated(options, configuration, product)
        stack.callback(simulated.close)
    devices = stack.enter_context(attached(configuration, product, simulated, drivers, options.slower))
    return devices if options.pace == "real" else replace(devices, clock=WakingClock(devices.clock, awake))


def _simulated(options: RunOptions, configuration: Configuration, product: Product) -> Devices:
    """The simulator's devices: of a world that is there, of a world of their own, or of this process."""
    world = simulator()
    if options.world is not None:
        return world.connected(configuration, product, options.world, options.pace)
    if options.pace == "real" and options.pixels and options.slower == 1.0:
        return world.own_world(configuration, product, options.seed, options.goal)
    detect = partial(detectors_of, configuration.bench, product, configuration.perception)
    devices = world.opened(configuration, product, options.seed, options.goal, options.pixels, detect)
    return replace(devices, clock=PacedClock(devices.clock, options.slower)) if options.pace == "real" else devices
