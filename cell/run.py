"""Wires a whole run together: configuration, devices, detectors, planners, tree, observers, controller."""

from __future__ import annotations

import hashlib
import importlib
import inspect
import json
import os
from collections.abc import Callable, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, field
from datetime import datetime
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import yaml
from rich.console import Console

from cell.configuration import (
    DEFAULT_CONFIGURATION,
    DEFAULT_TREE,
    LEARNED_KINDS,
    Configuration,
    LogSettings,
    load_configuration,
    load_faults,
    load_product,
    located,
    simulated,
)
from cell.interfaces.can_bus import open_bus
from cell.interfaces.clock import PacedClock, WakingClock
from cell.interfaces.devices import Devices
from cell.interfaces.errors import InputError, Place, Problem, SettingError
from cell.interfaces.files import shipped
from cell.interfaces.judgement import FaultTable
from cell.interfaces.product import Product
from cell.interfaces.truth import TruthEvent
from cell.observer import Level, Observer, Outcome
from cell.recording.identity import identity
from cell.recording.parts import parts_of
from cell.recording.recorder import Heading, McapRecorder
from cell.recording.scene import CellModel
from cell.running.controller import Controller
from cell.running.detectors import check_detectors, lock_step, worker_processes
from cell.running.finished import FinishedBrackets
from cell.running.injection import Injection, Injections
from cell.running.node_library import node_registry
from cell.running.reload import WatchedTree
from cell.running.services import Planners, TickClock, load_planners, make_services
from cell.running.statistics import RunStatistics
from cell.running.supervisor import make_supervisor
from cell.viewing.contact_sheet import ContactSheet
from cell.viewing.progress import LiveProgress
from cell.viewing.run_summary import run_summary
from skills.can_gripper import CanGripper, Tap
from skills.gripper_database import SHIPPED, load_gripper_database, read_frames
from skills.planner import MotionPlanner
from trees.engine.tree import Tree
from trees.files.loader import load_tree

if TYPE_CHECKING:
    from cell.viewing.live_server import LiveServer
    from cell.viewing.monitor import Monitor

Pace = Literal["fast", "real"]
LAYOUT = shipped("config", "foxglove_layout.json")


@dataclass(frozen=True)
class RunOptions:
    """What `cell run` was asked for.

    Attributes:
        log: file to write; None for a new one in the configured folder.
        monitor_port: where Groot2 and other monitors may ask; None for no monitor.
        monitor_hooks: let them put breakpoints and overrides on nodes.
        watch: take over edits of the tree file while it runs.
        live_port: where Foxglove and other viewers may connect; None for no server.
        overwrite: replace a log that is there.
        inject: FAULT@STATE, a fault that is put in when the work comes to a state; None for none.
        person: a simulated person's name or file; None for the configuration's.
        look: what the simulated cell looks like, a preset or a file; None for what the configuration says.
        nodes: files and packages with further nodes.
        beside: further tree files, and folders with them, whose trees may be named.
        entries: of the main tree, set before the first tick.
    """

    tree: Path = DEFAULT_TREE
    configuration: Path = DEFAULT_CONFIGURATION
    goal: str = "random"
    seed: int = 0
    pace: Pace = "fast"
    log: Path | None = None
    monitor_port: int | None = None
    monitor_hooks: bool = False
    watch: bool = False
    live_port: int | None = None
    overwrite: bool = False
    person: str | None = None
    inject: str | None = None
    look: str | None = None
    nodes: tuple[str, ...] = ()
    beside: tuple[Path, ...] = ()
    entries: Mapping[str, Any] = field(default_factory=dict)

    def load(self, product: Product) -> Tree:
        """The tree as it stands in its files now."""
        return load_tree(self.tree, node_registry(product, self.nodes), None, self.entries, self.beside)


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


@dataclass(frozen=True)
class Files:
    """Everything that was read before any device was opened."""

    configuration: Configuration
    product: Product
    tree: Tree
    planners: Planners
    faults: FaultTable


def run(options: RunOptions, console: Console) -> RunResult:
    """Run one tree on one cell.

    Raises:
        InputError: nothing has moved, and no file was touched.
        DeviceFault: a device could not be opened.
    """
    configuration = simulated(load_configuration(options.configuration), options.look, options.person)
    if options.inject is not None:
        Injection.parse(options.inject)
    with located(options.configuration, configuration):
        product = load_product(configuration, options.configuration)
        tree = options.load(product)
        log = _log_path(options, configuration.log)
        check_detectors(configuration.bench, product, configuration.perception)
        return _run(
            options,
            Files(configuration, product, tree, load_planners(configuration, product), load_faults(configuration)),
            log,
            console,
        )


def _run(options: RunOptions, files: Files, log: Path, console: Console) -> RunResult:
    configuration, product = files.configuration, files.product
    motion = MotionPlanner(product, configuration.bench, configuration.motion)
    with ExitStack() as stack:

        def alarm(time_s: float, level: Level, text: str) -> None:
            progress.message(time_s, level, text)
            trouble = text if level == "error" else ""
            progress.alarm(trouble)
            devices.panel.alarm(trouble)

        def blackboard() -> Mapping[str, object]:
            return (ticked.tree if isinstance(ticked, WatchedTree) else ticked).blackboard.values()

        devices = _open_devices(options, files, lambda: recorder.settle())
        stack.callback(devices.close)

        def truth() -> Sequence[TruthEvent]:
            return devices.truth()

        model = CellModel(product, configuration.bench, motion)

        def result() -> Mapping[str, object]:
            return {**devices.report(), **statistics.report(), "last_failure": str(statistics.cause)}

        heading = _heading(options, files)
        recorder = McapRecorder(log, configuration.log, heading, model, alarm, blackboard, truth, result)
        stack.callback(recorder.abandon)
        live = _open_live_server(options, recorder)
        if live is not None:
            stack.callback(live.abandon)
            console.print(f"live: ws://127.0.0.1:{live.port} (layout: {LAYOUT})", highlight=False)
        statistics, sheet = RunStatistics(), ContactSheet(log.with_suffix(".png"))
        progress = LiveProgress(console, 1.0 / configuration.controller.tick_hz)
        observers: tuple[Observer, ...] = (recorder, progress, sheet, statistics)
        monitor = _open_monitor(
            options, files.tree, lambda kind, body: recorder.hooked(kind, body, devices.clock.now_s())
        )
        if monitor is not None:
            stack.callback(monitor.abandon)
            observers = (*observers, monitor)
        if live is not None:
            observers = (*observers, live)
        if (goals := configuration.planners.semantic.goals) is not None:
            observers = (*observers, FinishedBrackets(goals, files.product))
        ticked = _watched(options, product, files.tree, observers, recorder, monitor) if options.watch else files.tree
        injection = None if options.inject is None else Injection.parse(options.inject)
        outcome = drive(files, devices, motion, observers, recorder.can_frame, options.pace, ticked, injection)
        summary = _summary(options, files, outcome, statistics, devices, recorder, sheet.path)
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
) -> Outcome:
    """Run the tree on devices that are open, to its end and a safe stop; with a fault where one is to be tried."""
    configuration, tree = files.configuration, tree or files.tree
    with ExitStack() as stack:
        can_settings = configuration.gripper_can
        bus = open_bus(can_settings.interface, can_settings.channel, can_settings.bitrate)
        if injection is not None:
            bus = injection.bus(bus, load_gripper_database(can_settings.database or SHIPPED))
            devices, observers = injection.devices(devices), (*observers, injection)
        gripper = CanGripper(
            bus,
            devices.clock,
            can_settings,
            can_tap,
        )
        stack.callback(gripper.close)
        detectors = (configuration.bench, files.product, configuration.perception)
        executors = worker_processes(*detectors) if pace == "real" else lock_step(*detectors, devices)
        for executor in executors:
            stack.callback(executor.close)
        supervisor = make_supervisor(files.faults, motion)
        controller = Controller(devices, gripper, *executors, configuration.controller, supervisor, observers)
        services = make_services(
            configuration,
            files.planners,
            motion,
            devices.clock,
            controller.journal,
            controller.observe(),
        )
        tree.setup(services, TickClock(services))
        return controller.run(tree, services)


def _open_monitor(options: RunOptions, tree: Tree, hooked: Callable[[str, Any], None]) -> Monitor | None:
    if options.monitor_port is None:
        return None
    from cell.viewing.monitor import Monitor

    return Monitor(tree, node_registry(more=options.nodes), options.monitor_port, options.monitor_hooks, hooked)


def _open_live_server(options: RunOptions, recorder: McapRecorder) -> LiveServer | None:
    if options.live_port is None:
        return None
    from cell.viewing.live_server import LiveServer

    return LiveServer(recorder.context, recorder.scene, options.live_port)


def _watched(
    options: RunOptions,
    product: Product,
    tree: Tree,
    observers: Sequence[Observer],
    recorder: McapRecorder,
    monitor: Monitor | None,
) -> WatchedTree:
    """A tree whose edits take over; the log keeps the text of each, a monitor shows it."""

    def swapped(tree: Tree, time_s: float) -> None:
        recorder.edited(_texts(tree), time_s)
        if monitor is not None:
            monitor.watch(tree)

    return WatchedTree(tree, lambda: options.load(product), options.tree, observers, swapped)


def _open_devices(options: RunOptions, files: Files, awake: Callable[[], None]) -> Devices:
    """The devices; each tick begins once the one before is on the disk."""
    configuration = files.configuration
    can_settings = configuration.gripper_can
    arguments = (
        files.product,
        configuration.bench,
        configuration.devices.simulation,
        can_settings.interface,
        can_settings.channel,
        options.seed,
        options.goal,
    )
    devices = _factory(configuration.devices.factory, arguments)(*arguments)
    clock = PacedClock(devices.clock) if options.pace == "real" else devices.clock
    return Devices(**{**vars(devices), "clock": WakingClock(clock, awake)})


def _factory(dotted: str, arguments: tuple[Any, ...]) -> Callable[..., Devices]:
    """The function that opens the devices, by its name in the configuration.

    Raises:
        SettingError: there is none, or it does not take these arguments.
    """
    where = ("devices", "factory")
    module, _, function = dotted.partition(":")
    try:
        factory: Callable[..., Devices] = getattr(importlib.import_module(module), function)
        inspect.signature(factory).bind(*arguments)
    except (ImportError, AttributeError) as error:
        raise SettingError((where, f"no such factory: {error}")) from None
    except (TypeError, ValueError) as error:
        raise SettingError((where, f"{dotted} opens no devices: {error}")) from None
    return factory


def _heading(options: RunOptions, files: Files) -> Heading:
    """What a log needs to be run again: files as attachments, the rest as metadata."""
    assert files.configuration.faults is not None
    attachments = {
        "configuration.yaml": ("application/yaml", options.configuration.read_bytes()),
        "faults.yaml": ("application/yaml", files.configuration.faults.read_bytes()),
        "product.yaml": ("application/yaml", files.configuration.product.read_bytes()),
        "gripper.dbc": ("text/plain", read_frames(files.configuration.gripper_can.database or SHIPPED).encode()),
        "simulation.json": ("application/json", files.configuration.devices.simulation.model_dump_json().encode()),
    }
    look = files.configuration.devices.simulation.look.draw(options.seed)
    attachments["look.yaml"] = ("application/yaml", yaml.safe_dump(look.model_dump(mode="json")).encode())
    semantic, folder = files.configuration.planners.semantic, options.configuration.resolve().parent
    for path in (semantic.goals, semantic.confusions):
        if path is not None and path.exists() and path.resolve().is_relative_to(folder):
            attachments[str(path.resolve().relative_to(folder))] = ("text/plain", path.read_bytes())
    for name, text in _texts(files.tree).items():
        attachments[name] = ("application/xml", text.encode())
    values = {
        "seed": str(options.seed),
        "goal": options.goal,
        "product": files.product.name,
        "pace": options.pace,
        "person": options.person or "as configured",
        "tree": options.tree.resolve().relative_to(_common_folder(files.tree)).as_posix(),
        "perception": files.configuration.perception.words,
        "look": files.configuration.devices.simulation.look.name,
    }
    for name in LEARNED_KINDS:
        if files.configuration.perception.chosen(name).kind != "classical":
            values |= _weights(name, files.configuration.perception.weights(name))
    for name, planner in files.configuration.planners:
        values[f"planner.{name}"] = planner.kind
        if planner.weights is not None and planner.weights.exists():
            values |= _weights(name, planner.weights)
    if options.entries:
        values["entries"] = json.dumps(dict(options.entries))
    return Heading({**values, **identity()}, attachments)


def _weights(name: str, file: Path) -> dict[str, str]:
    """Which weights a planner or detector has."""
    digest = hashlib.sha256(file.read_bytes()).hexdigest()
    return {f"weights.{name}.file": str(file), f"weights.{name}.sha256": digest}


def _texts(tree: Tree) -> dict[str, str]:
    """Files of a tree by their names in the log: below the folder that holds all of them."""
    folder = _common_folder(tree)
    return {f"tree/{path.resolve().relative_to(folder).as_posix()}": text for path, text in tree.texts.items()}


def _common_folder(tree: Tree) -> Path:
    return Path(os.path.commonpath([path.resolve().parent for path in tree.texts]))


def _log_path(options: RunOptions, settings: LogSettings) -> Path:
    """Where the log goes; a file that is there stays, unless it was said otherwise.

    Raises:
        InputError: the name is no log's, or a log or its contact sheet has it already.
    """
    path = options.log or _new_log(settings.folder, options.seed)
    if path.suffix != ".mcap":
        raise InputError(Problem(Place(path), "the name of a log ends in .mcap", f"try {path.with_suffix('.mcap')}"))
    taken = next((file for file in (path, *parts_of(path), path.with_suffix(".png")) if file.exists()), None)
    if taken is not None and not options.overwrite:
        raise InputError(Problem(Place(taken), "exists already", "choose another --log, or add --overwrite"))
    return path


def _new_log(folder: Path, seed: int) -> Path:
    """A name that no log in the folder has yet."""
    stem = f"{datetime.now():%Y%m%d-%H%M%S}-seed{seed}"
    names = (f"{stem}{suffix}.mcap" for suffix in ("", *(f"-{count}" for count in range(2, 1000))))
    return next(folder / name for name in names if not (folder / name).exists())


def _summary(
    options: RunOptions,
    files: Files,
    outcome: Outcome,
    statistics: RunStatistics,
    devices: Devices,
    recorder: McapRecorder,
    sheet: Path,
) -> dict[str, object]:
    speed = outcome.sim_time_s / outcome.wall_time_s if outcome.wall_time_s > 0 else 0.0
    return {
        "finished": outcome.end == "finished",
        "end": outcome.end,
        "reason": outcome.reason,
        "cause": str(statistics.cause) if outcome.end == "failed" else "",
        "condition": outcome.condition,
        "observer_problems": list(outcome.observer_problems),
        **devices.report(),
        **statistics.report(),
        "ticks": outcome.ticks,
        "overruns": outcome.overruns,
        "sim_time_s": round(outcome.sim_time_s, 3),
        "wall_time_s": round(outcome.wall_time_s, 3),
        "real_time_factor": round(speed, 2),
        "perception": files.configuration.perception.words,
        "seed": options.seed,
        "log": str(recorder.path),
        "log_parts": recorder.parts,
        "log_complete": recorder.complete,
        "log_shortfall": recorder.shortfall,
        "contact_sheet": str(sheet),
    }
