"""Wires a whole run together: configuration, devices, detectors, planners, tree, observers, controller."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from functools import partial
from pathlib import Path

from rich.console import Console

from bracket_cell.configuration import (
    Configuration,
    for_shift,
    load_configuration,
    load_faults,
    load_product,
    located,
    simulated,
    unnamed_calibration,
    weaknesses,
)
from bracket_cell.device_settings import PagePanel
from bracket_cell.log.read.resume import read_resume_state, world_of
from bracket_cell.production.book import Book, RunRow
from bracket_cell.production.bookkeeper import Bookkeeper, moment_of
from bracket_cell.recording.recorder import McapRecorder
from bracket_cell.remote import priority
from bracket_cell.running.controller import Controller
from bracket_cell.running.device_reader import RobotPoseHistory
from bracket_cell.running.inference import FaultInjection
from bracket_cell.running.operator import OperatorChannel
from bracket_cell.running.policy_device import PolicyDevice
from bracket_cell.running.supervisor import Supervisor, make_supervisor
from bracket_cell.running.watchdog import TICK_S, Watchdog
from bracket_cell.runs.assembled import RunParts
from bracket_cell.runs.heading import log_path, summary_of
from bracket_cell.runs.options import Files, Pace, RunOptions
from bracket_cell.runs.signing import moves_something, required_signature
from bracket_cell.simulator import simulator
from bracket_cell.skills.drivers.can_gripper import CanGripper, Tap
from bracket_cell.skills.drivers.checked_arm import CheckedArm
from bracket_cell.skills.motion.planner import MotionPlanner
from bracket_cell.trees.nodes.services import Services
from bracket_cell.viewing.gate import Address
from bracket_cell.viewing.moments import Moments
from bracket_cell.viewing.run_summary import run_summary
from bracket_cell.watching.observer import End, Observer, Outcome
from bracket_cell.wiring.bench_checks import refuse_blocked
from bracket_cell.wiring.detectors import check_detectors, lock_step, with_detectors_for, worker_processes
from bracket_cell.wiring.devices import find_drivers
from bracket_cell.wiring.reload import WatchedTree
from bracket_cell.wiring.ruled import RuledTree
from bracket_cell.wiring.services import TickClock, load_planners, make_services
from bracket_ground.errors import InputError, LogError, Place, Problem, SettingError, words_of
from bracket_ground.interfaces.devices import Devices
from bracket_ground.interfaces.faults import FaultTable
from bracket_ground.interfaces.product import Product
from bracket_ground.interfaces.resume import ResumeState
from btxml.engine.tree import Tree


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
    named = "--page"
    if isinstance(panel := configuration.devices.panel, PagePanel) and options.page is None:
        options, named = replace(options, page=panel.at), f"{options.configuration}: devices.panel.at"
    Address.parse(options.page or "0", named)  # before a file is touched
    options.refuse_simulated(configuration)
    configuration = simulated(configuration, options.look, options.person)
    if options.brackets is not None:
        configuration = for_shift(configuration, options.brackets)
    configuration = options.adjusted(configuration)
    injection: FaultInjection | None = None
    if options.inject is not None:  # before a file is touched
        injection = simulator().injected(options.inject, len(configuration.robot.joints))
    with located(options.configuration, configuration):
        product = load_product(configuration, options.configuration)
        tree = options.load(product, configuration)
        configuration, notice = with_detectors_for(configuration, product)
        if notice and (options.pixels or not configuration.devices.simulated):  # else the truth sees
            console.print(notice, highlight=False)
        if notice := unnamed_calibration(options.configuration, configuration):
            console.print(notice, highlight=False, soft_wrap=True)
        check_detectors(configuration.bench, product, configuration.perception)
        drivers = find_drivers(configuration) if options.devices is None else {}
        if options.devices is None and any(driver.on_the_wall for driver in drivers.values()):
            options = replace(options, pace="real")
        log = log_path(options, configuration.log)
        keeper, left_off = _keeper(options, configuration, product, log), ResumeState()
        if options.resume is not None:
            options, left_off = _resumed(options, options.resume, product, keeper, console)
        if options.world is not None:
            drawn = simulator().drawn_from(options.world)
            options = replace(options, seed=drawn.seed, goal=drawn.goal)
        refuse_blocked(motion := MotionPlanner(product, configuration.bench, configuration.motion))
        planners, faults = load_planners(configuration, product), load_faults(configuration)
        unsafe = _allowed_weaknesses(options, configuration, faults)
        files = Files(configuration, product, tree, planners, faults, left_off, unsafe, rules=options.load_rules(tree))
        if moves_something(drivers.values()):
            files = replace(files, signature=required_signature(options.configuration, files.safety))
        console.print(f"safety configuration {files.signed}", highlight=False, soft_wrap=True)
        assemble = partial(RunParts, options, files, motion, drivers, keeper, log, console)
        return _run(assemble, options, files, motion, log, watchdog, injection)


def _keeper(options: RunOptions, configuration: Configuration, product: Product, log: Path) -> Bookkeeper:
    """What writes the run into its book; a run that goes on with another is one run with it."""
    production = configuration.production
    if unknown := [name for name in production.ideal_cycle_s if name not in product.goals]:
        what = f"no variant of {product.name!r}; legal: {', '.join(product.goals)}"
        raise SettingError(*((("production", "ideal_cycle_s", name), what) for name in unknown))
    row = RunRow(
        str(options.resume or log),
        product.name,
        options.tree.name,
        options.operator,
        began_utc=datetime.now(UTC).isoformat(timespec="milliseconds"),
        ideal_s=production.ideal_cycle_s,
        planned_day_s=production.planned_day_s,
    )
    return Bookkeeper(Book(options.book), row)


def _resumed(
    options: RunOptions, log: Path, product: Product, keeper: Bookkeeper, console: Console
) -> tuple[RunOptions, ResumeState]:
    """What a log left off with, and the options with its world, where that is still there.

    Args:
        keeper: takes the brackets of the log.

    Raises:
        InputError, LogError: the log cannot be gone on with.
    """
    left_off = read_resume_state(log, product, lambda tick: keeper.take(moment_of(tick)))
    console.print(f"goes on with {log}: {left_off.summary}", highlight=False)
    if options.world is not None:
        return options, left_off
    world = world_of(log)
    if world is not None and not simulator().is_there(world):
        console.print(f"the world at {world} is gone: this is another one", highlight=False)
        world = None
    return replace(options, world=world), left_off


def _run(
    assemble: Callable[[ExitStack], RunParts],
    options: RunOptions,
    files: Files,
    motion: MotionPlanner,
    log: Path,
    watchdog: Watchdog,
    injection: FaultInjection | None,
) -> RunResult:
    with ExitStack() as stack:
        parts = assemble(stack)
        parts.say_unsafe()
        stack.enter_context(priority.preferred(options.pace == "real"))
        outcome = run_controller(
            files,
            parts.devices,
            motion,
            parts.observers,
            parts.recorder.can_frame,
            options.pace,
            parts.ticked,
            injection,
            parts.operator,
            watchdog,
            begun=parts.begun,
        )
        watchdog.step("the contact sheet")
        sheet, outcome = _sheet(options, log, parts.recorder, parts.moments, outcome)
        watchdog.step("the summary")
        summary = summary_of(options, files, outcome, parts.counts, parts.devices, parts.recorder, sheet)
        if injection is not None:
            summary["injected"] = injection.told
        rows = run_summary(summary, files.product, files.configuration.controller.tick_hz)
        return RunResult(outcome, summary, rows)


def run_controller(
    files: Files,
    devices: Devices,
    motion: MotionPlanner,
    observers: Sequence[Observer] = (),
    can_tap: Tap | None = None,
    pace: Pace = "fast",
    tree: Tree | WatchedTree | None = None,
    injection: FaultInjection | None = None,
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
        if pace == "real" and devices.host is None:
            arm, gone = devices.arm, devices.gone
            executors = stack.enter_context(worker_processes(*detectors, lambda: gone() and arm.state(), slower))
        else:
            executors = lock_step(*detectors, devices)
        if injection is not None:
            executors = injection.detectors(*executors)
        supervisor = supervised(files.faults, motion)
        own_body = RobotPoseHistory(motion.separation.outline, motion.kinematics.forward)
        watchdog = watchdog or Watchdog()
        watchdog.limit_s = TICK_S * slower if pace == "real" else None
        policies = PolicyDevice(devices, motion.kinematics.count, beside=pace == "real")
        observers = (*observers, policies)
        controller = Controller(
            devices, *executors, configuration.controller, supervisor, observers, operator, own_body, watchdog
        )
        journal, seen = controller.journal, controller.observe()
        services = make_services(
            configuration, files.planners, motion, journal, seen, files.left_off, policies=policies
        )
        ruled = RuledTree(tree, files.rules.rules, motion.kinematics)
        ruled.setup(services, TickClock(services))
        begun(services, supervisor)
        return controller.run(ruled, services)


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


def _sheet(
    options: RunOptions, log: Path, recorder: McapRecorder, moments: Moments, outcome: Outcome
) -> tuple[str, Outcome]:
    """The contact sheet beside the log, empty where there is none; what went wrong is reported with the outcome."""
    from bracket_cell.log.report.contact_sheet import write_sheet  # only now: a run begins without it

    sheet = log.with_suffix(".png")
    try:
        made = options.images and write_sheet(recorder.path, moments, outcome.reason, sheet)
    except (LogError, OSError) as error:
        problem = f"no contact sheet: {words_of(error)}"
        return "", replace(outcome, observer_problems=(*outcome.observer_problems, problem))
    return str(sheet) if made else "", outcome
