"""Wires a whole run together: configuration, devices, detectors, planners, tree, observers, controller."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

import numpy as np
from rich.console import Console

from cell.configuration import (
    Configuration,
    for_shift,
    load_configuration,
    load_faults,
    load_product,
    located,
    simulated,
    weaknesses,
)
from cell.device_settings import PagePanel
from cell.errors import InputError, LogError, Place, Problem
from cell.faults.injection import Injection, Injections
from cell.files.words.catalogue import catalogue
from cell.interfaces.clock import PacedClock, WakingClock
from cell.interfaces.devices import Devices, TruthEvent
from cell.interfaces.faults import FaultTable
from cell.interfaces.observation import Observation
from cell.interfaces.product import Product
from cell.interfaces.resume import ResumeState
from cell.log.read.resume import read_resume_state, world_of
from cell.recording.recorder import McapRecorder
from cell.recording.scene import CellModel
from cell.running.controller import Controller
from cell.running.device_reader import RobotPoseHistory
from cell.running.operator import OperatorChannel
from cell.running.supervisor import Supervisor, make_supervisor
from cell.running.watchdog import TICK_S, Watchdog
from cell.running.work_orders import WorkOrders
from cell.runs.heading import Counts, heading, log_path, summary_of
from cell.runs.options import Files, Pace, RunOptions
from cell.runs.viewers import open_viewers
from cell.viewing.gate import Address
from cell.viewing.moments import Moments
from cell.viewing.progress import LiveProgress
from cell.viewing.run_summary import run_summary
from cell.watching.brackets import BracketTally, FinishedBrackets
from cell.watching.lateness import Lateness
from cell.watching.observer import End, Level, Observer, Outcome
from cell.watching.statistics import Fluency, RunStatistics
from cell.watching.why_now import WhyNow
from cell.wiring.bench_checks import refuse_blocked
from cell.wiring.detectors import check_detectors, detectors_of, fitted, lock_step, worker_processes
from cell.wiring.devices import Drivers, attached, find_drivers
from cell.wiring.no_render_host import without_pixels
from cell.wiring.reload import WatchedTree
from cell.wiring.run_state import state_of
from cell.wiring.services import TickClock, load_planners, make_services
from sim.process import pacing as real_time
from sim.process.opening import connect, drawn_from, is_there, open_simulation, own_world
from skills.drivers.can_gripper import CanGripper, Tap
from skills.drivers.checked_arm import CheckedArm
from skills.motion.planner import MotionPlanner
from trees.engine.tree import Tree
from trees.nodes.services import Services


@dataclass(frozen=True)
class RunResult:
    """How a run ended.

    Attributes:
        summary: the keys of `cell run --json`.
        rows: the same for people.
    """

    outcome: Outcome
    summary: dict[str, object]
    rows: dict[str, str]

    @property
    def end(self) -> End:
        return self.outcome.end

    @property
    def reason(self) -> str:
        return self.outcome.reason


def run(options: RunOptions, console: Console) -> RunResult:
    """Run one tree on one cell.

    Raises:
        InputError: nothing has moved, and no file was touched.
        DeviceFault: a device could not be opened.
        KeyboardInterrupt: a signal ended it before its first tick or after its last one.
    """
    with Watchdog().watching() as watchdog:
        return _read_and_run(options, console, watchdog)


def _read_and_run(options: RunOptions, console: Console, watchdog: Watchdog) -> RunResult:
    configuration = load_configuration(options.configuration)
    if isinstance(panel := configuration.devices.panel, PagePanel) and options.page is None:
        options = replace(options, page=panel.at)
    for text, option in ((options.page, "--page"), (options.opcua, "--opcua")):
        if text is not None:
            Address.parse(text, option)  # before a file is touched
    options.refuse_simulated(configuration)
    configuration = simulated(configuration, options.look, options.person)
    if options.brackets is not None:
        configuration = for_shift(configuration, options.brackets)
    configuration = options.adjusted(configuration)
    if options.inject is not None:
        Injection.parse(options.inject)
    with located(options.configuration, configuration):
        product = load_product(configuration, options.configuration)
        tree = options.load(product, configuration)
        configuration, told = fitted(configuration, product)
        if told:
            console.print(told, highlight=False)
        check_detectors(configuration.bench, product, configuration.perception)
        drivers = find_drivers(configuration) if options.devices is None else {}
        if options.devices is None and any(driver.on_the_wall for driver in drivers.values()):
            options = replace(options, pace="real")
        tally = BracketTally()
        left_off = ResumeState()
        if options.resume is not None:
            left_off = read_resume_state(options.resume, product, lambda tick: tally.add(tick.time_s, tick.notes))
            console.print(f"goes on with {options.resume}: {left_off.told}", highlight=False)
            world = options.world or world_of(options.resume)
            if options.world is None and world is not None and not is_there(world):
                console.print(f"the world at {world} is gone: this is another one", highlight=False)
                world = None
            options = replace(options, world=world)
        if options.world is not None:
            drawn = drawn_from(options.world)
            options = replace(options, seed=drawn.seed, goal=drawn.goal)
        log = log_path(options, configuration.log)
        refuse_blocked(motion := MotionPlanner(product, configuration.bench, configuration.motion))
        planners, faults = load_planners(configuration, product), load_faults(configuration)
        unsafe = _allowed_weaknesses(options, configuration, faults)
        files = Files(configuration, product, tree, planners, faults, left_off, unsafe)
        return _run(options, files, motion, drivers, tally, log, console, watchdog)


def _run(
    options: RunOptions,
    files: Files,
    motion: MotionPlanner,
    drivers: Drivers,
    tally: BracketTally,
    log: Path,
    console: Console,
    watchdog: Watchdog,
) -> RunResult:
    configuration, product = files.configuration, files.product
    with ExitStack() as stack:

        def alarm(time_s: float, level: Level, text: str) -> None:
            progress.message(time_s, level, text)
            trouble = text if level == "error" else ""
            progress.alarm(trouble)
            devices.panel.alarm(trouble)

        def running() -> Tree:
            return ticked.tree if isinstance(ticked, WatchedTree) else ticked

        def blackboard() -> Mapping[str, object]:
            return running().blackboard.values()

        devices = _opened(options, files, drivers, stack, lambda: recorder.settle())

        def truth() -> Sequence[TruthEvent]:
            return devices.truth()

        model = CellModel(product, configuration.bench, motion)

        def result() -> Mapping[str, object]:
            return counts.job(devices)

        told, in_step = heading(options, files), options.pace == "fast"
        recorder = McapRecorder(
            log, configuration.log, told, model, alarm, blackboard, truth, result, in_step, options.overwrite
        )
        stack.callback(recorder.abandon)
        moments, fluency = Moments(), Fluency(lambda seen: _tool_on_bench_m(motion, seen))
        lateness = _lateness(files, devices, alarm)
        counts = Counts(RunStatistics(), lateness, fluency, tally, tally.missing(len(devices.finished())))
        words = catalogue(configuration.page.language)
        why_now = WhyNow(running)
        progress = LiveProgress(console, 1.0 / configuration.controller.tick_hz, product, words, why_now)
        jobs = WorkOrders(product.goals, options.work_orders)
        shift = options.brackets is not None
        operator = OperatorChannel(product.goals, options.attended, options.brackets or None, shift, jobs)
        if options.orders is not None:
            options.orders(operator.put, lambda: operator.questions, console.print)
        viewers = open_viewers(options, files, recorder, operator.press, devices.clock.now_s, stack, model)
        for line in viewers.addresses:
            console.print(line, highlight=False, soft_wrap=True)
        observers: tuple[Observer, ...] = (
            *(recorder, why_now, progress, moments, jobs),
            *(*counts.observers, *viewers.observers),
        )
        if (goals := configuration.planners.semantic.goals) is not None:
            observers = (*observers, FinishedBrackets(goals, product))
        ticked = _watched(options, files, observers, viewers.edited) if options.watch else files.tree
        injection = None if options.inject is None else Injection.parse(options.inject)
        for observer in observers if files.unsafe else ():
            observer.message(devices.clock.now_s(), "error", f"UNSAFE: {'; '.join(files.unsafe)}")
        stack.enter_context(real_time.preferred(options.pace == "real"))

        def begun(services: Services, supervisor: Supervisor) -> None:
            recorder.state = lambda: state_of(running(), services, supervisor)

        outcome = drive(
            files,
            devices,
            motion,
            observers,
            recorder.can_frame,
            options.pace,
            ticked,
            injection,
            operator,
            watchdog,
            begun=begun,
        )
        watchdog.step("the contact sheet")
        sheet, outcome = _sheet(options, log, recorder, moments, outcome)
        watchdog.step("the summary")
        summary = summary_of(options, files, outcome, counts, devices, recorder, sheet)
        return RunResult(outcome, summary, run_summary(summary, product, configuration.controller.tick_hz))


def drive(
    files: Files,
    devices: Devices,
    motion: MotionPlanner,
    observers: Sequence[Observer] = (),
    can_tap: Tap | None = None,
    pace: Pace = "fast",
    tree: Tree | WatchedTree | None = None,
    injection: Injection | Injections | None = None,
    operator: OperatorChannel | None = None,
    watchdog: Watchdog | None = None,
    supervised: Callable[[FaultTable, MotionPlanner], Supervisor] = make_supervisor,
    begun: Callable[[Services, Supervisor], None] = lambda *_: None,
) -> Outcome:
    """Run the tree on devices that are open, to its end and a safe stop; with a fault where one is to be tried."""
    configuration, tree = files.configuration, tree or files.tree
    with ExitStack() as stack:
        if injection is not None:
            devices, observers = injection.devices(devices), (*observers, injection)
        devices = replace(devices, arm=CheckedArm(devices.arm, configuration.robot))
        if can_tap is not None and isinstance(devices.gripper, CanGripper):
            devices.gripper.tap(can_tap)
        detectors = (configuration.bench, files.product, configuration.perception)
        slower: float = getattr(devices.clock, "slower", 1.0)
        if pace == "real":
            arm, gone = devices.arm, devices.gone
            executors = stack.enter_context(worker_processes(*detectors, lambda: gone() and arm.state(), slower))
        else:
            executors = lock_step(*detectors, devices)
        supervisor = supervised(files.faults, motion)
        own_body = RobotPoseHistory(motion.separation.outline, motion.kinematics.forward)
        watchdog = watchdog or Watchdog()
        watchdog.limit_s = TICK_S * slower if pace == "real" else None
        controller = Controller(
            devices, *executors, configuration.controller, supervisor, observers, operator, own_body, watchdog
        )
        journal, seen = controller.journal, controller.observe()
        services = make_services(configuration, files.planners, motion, journal, seen, files.left_off)
        tree.setup(services, TickClock(services))
        begun(services, supervisor)
        return controller.run(tree, services)


def _allowed_weaknesses(options: RunOptions, configuration: Configuration, table: FaultTable) -> tuple[str, ...]:
    """Where table or separation do less than the shipped ones.

    Raises:
        InputError: that is so, and nobody said that it may be.
    """
    found = weaknesses(configuration, table)
    if found and not (options.unsafe_table or configuration.unsafe_table):
        way = "unsafe_table: true in the configuration, or `cell lab run --unsafe-table`, takes it all the same"
        path = configuration.faults or options.configuration
        raise InputError(*(Problem(Place(path), f"weaker than the shipped table: {what}", way) for what in found))
    return tuple(found)


def _lateness(files: Files, devices: Devices, say: Callable[[float, Level, str], None]) -> Lateness:
    """Counts how late ticks begin, and asks the clock why."""
    period_s, clock = 1.0 / files.configuration.controller.tick_hz, devices.clock
    return Lateness(period_s, lambda: getattr(clock, "delays", {}), devices.lost_s, say)


def _tool_on_bench_m(motion: MotionPlanner, seen: Observation) -> tuple[float, float]:
    """Where the tool is above the bench, (x, y)."""
    x, y, _ = motion.kinematics.position_m(np.array(seen.arm.positions_rad)).tolist()
    return x, y


def _sheet(
    options: RunOptions, log: Path, recorder: McapRecorder, moments: Moments, outcome: Outcome
) -> tuple[str, Outcome]:
    """The contact sheet beside the log, empty where there is none; what went wrong is reported with the outcome."""
    from cell.log.report.contact_sheet import write_sheet  # only now: a run begins without it

    sheet = log.with_suffix(".png")
    try:
        made = options.images and write_sheet(recorder.path, moments, outcome.reason, sheet)
    except (LogError, OSError) as error:
        problem = f"no contact sheet: {error}"
        return "", replace(outcome, observer_problems=(*outcome.observer_problems, problem))
    return str(sheet) if made else "", outcome


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
    if options.world is not None:
        return connect(configuration, product, options.world, options.pace).devices
    if options.pace == "real" and options.pixels:
        return own_world(configuration, product, options.seed, options.goal).devices
    detect = partial(detectors_of, configuration.bench, product, configuration.perception)
    cell = open_simulation(configuration, product, options.seed, options.goal, options.pixels, detect)
    devices = cell.devices if options.pixels else without_pixels(cell, configuration, product)
    return replace(devices, clock=PacedClock(devices.clock)) if options.pace == "real" else devices
