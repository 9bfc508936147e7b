"""Ticks the tree of a log on what the log says that it saw, and compares what it decides; no devices, no simulator."""

from __future__ import annotations

import json
import tempfile
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from cell.configuration import Configuration, load_configuration, load_faults, load_product
from cell.errors import InputError, LogError
from cell.files.yaml_file import load_yaml
from cell.interfaces.command import Command
from cell.interfaces.faults import Action, FaultTable, Judgement
from cell.interfaces.notes import ListJournal
from cell.interfaces.product import Product
from cell.interfaces.resume import ResumeState
from cell.log.read.reader import Log, LoggedTick
from cell.log.replay.compare import Comparison, Decisions, Difference, decided, differences, logged, remembers
from cell.log.replay.logged_tree import recorded_table, write_files
from cell.recording.identity import what_changed
from cell.running.controller import STOPPED, STOPPING
from cell.running.device_writer import withhold
from cell.running.safe_stop import failure
from cell.running.supervisor import make_supervisor
from cell.wiring.detectors import fitted
from cell.wiring.reload import take_over
from cell.wiring.services import Planners, TickClock, load_planners, make_services
from learned.inference.onnx_model import digest_of
from skills.motion.planner import MotionPlanner
from trees.engine.hooks import ORDERS, Hooks
from trees.engine.node import StatusChange
from trees.engine.outside import LoggedAnswers
from trees.engine.tree import Tree
from trees.files.build.registry import Registry
from trees.files.loader import load_tree
from trees.node_library import node_registry
from trees.nodes.files import LoggedFiles

PLANNERS = ("semantic", "grasp")
ENDS = ("SUCCESS", "FAILURE", "ERROR")
MID_TICK = "interrupted in mid-tick"


@dataclass(frozen=True)
class Changes:
    """What is to be other than in the log.

    Attributes:
        weights: ONNX file by planner, "semantic" or "grasp".
        nodes: files and packages with further nodes.
        beside: further files, and folders with them, whose trees `tree` may name.
    """

    tree: Path | None = None
    configuration: Path | None = None
    weights: Mapping[str, Path] = field(default_factory=dict)
    nodes: tuple[str, ...] = ()
    beside: tuple[Path, ...] = ()


@dataclass(frozen=True)
class Step:
    """One tick, as it was and as it is when replayed.

    Attributes:
        blackboard: of the main tree after the replayed tick.
        differences: empty where both are the same.
    """

    logged: LoggedTick
    now: Decisions
    blackboard: Mapping[str, Any]
    differences: list[Difference]


class Replay:
    """The tree of a log, or a changed one, ready to be ticked again.

    Edits that took over during the run and what a monitor did to nodes are done again in the ticks in which they were.

    Attributes:
        remarks: what of the log was not replayed, and why, for people; whole after `run`.

    Raises:
        LogError: the log lacks what a replay needs, or was recorded with other weights than these.
        InputError, ModelError: a changed file cannot be used.
    """

    def __init__(self, log: Log, changes: Changes | None = None) -> None:
        changes = changes or Changes()
        _refuse_without_beginning(log)
        self.log = log
        self.remarks: list[str] = []
        self._by_name, self._memory = changes.tree is not None, remembers(log)
        self._nodes = changes.nodes
        self.remarks += [f"recorded with other versions: {line}" for line in what_changed(log.metadata)]
        configuration, product, planners, self.tree, faults = _load(log, changes)
        self._configured = configuration.nodes
        motion = MotionPlanner(product, configuration.bench, configuration.motion)
        self._supervisor = make_supervisor(faults, motion)
        self._halted = False
        self._journal = ListJournal()
        self._services = make_services(
            configuration,
            planners,
            motion,
            self._journal,
            log.ticks[0].observation,
            ResumeState.of(json.loads(log.metadata["left_off"])) if "left_off" in log.metadata else ResumeState(),
            LoggedFiles(_notes(log, "file")),
            LoggedAnswers(_notes(log, "outside")),
        )
        self._clock = TickClock(self._services)
        self.tree.setup(self._services, self._clock)
        self._hooks = Hooks(self.tree, _nobody)

    def run(
        self,
        from_s: float = 0.0,
        until_s: float = float("inf"),
        watch: Callable[[Step], bool | None] = lambda _: None,
    ) -> Comparison:
        """Tick all logged ticks up to a time, comparing from another time on; once for each Replay.

        Args:
            watch: sees every compared tick; ends the replay by answering False.
        """
        comparison = Comparison()
        for place, tick in enumerate(self.log.ticks):
            if tick.time_s > until_s or self._cut_short(place, tick):
                break
            now = self._tick(tick)
            if tick.time_s >= from_s:
                found = differences(tick.number, tick.time_s, logged(tick), now, self._by_name, self._memory)
                comparison.add(found)
                if watch(Step(tick, now, self.tree.blackboard.values(), found)) is False:
                    break
            if (now.status in ENDS or tick.status in ENDS) and not self._stops_next(place):
                break
        return comparison

    def _stops_next(self, place: int) -> bool:
        """Whether the next tick of the log is one of the safe stop."""
        following = self.log.ticks[place + 1 : place + 2]
        return bool(following) and following[0].status == STOPPING

    def _cut_short(self, place: int, tick: LoggedTick) -> bool:
        """Not to be compared: what follows missing ticks, and a last tick that a second signal stopped anywhere."""
        if tick.number != place:
            gap = self.log.gaps[0]
            self.remarks.append(f"{gap}: the replay ends before, as nodes remember what they saw")
            return True
        return tick.status == "ERROR" and self.log.outcome.get("reason") == MID_TICK

    def _tick(self, tick: LoggedTick) -> Decisions:
        self._services.now.observation, self._services.now.command = tick.observation, Command()
        judgement = self._supervisor.judge(tick.observation)
        if tick.status == STOPPED:
            return decided(STOPPED, (), (), Command(), judgement)
        if tick.status == STOPPING:
            return self._stopping_tick(judgement)
        for kind, fields in tick.inputs:
            self._take(kind, fields, tick)
        error = ""
        command = self._services.now.command
        try:
            status = self.tree.tick().name
            asked = replace(command)
            judgement = self._supervisor.judge_command(tick.observation, command)
            if judgement.action >= Action.HOLD and tick.judgement is not None:  # older logs were not judged
                withhold(command, judgement)
        except (Exception, SystemExit) as problem:  # as in the controller's loop: what is raised is compared
            status, error, asked = "ERROR", f"{type(problem).__name__}: {problem}", command
        return decided(status, self.tree.status_changes, self._journal.take(), asked, judgement, error)

    def _stopping_tick(self, judgement: Judgement) -> Decisions:
        """A tick of the safe stop: the supervisor goes on judging, and the tree is halted once."""
        changes: Sequence[StatusChange] = ()
        if not self._halted:
            self._halted = True
            failure(self.tree.halt)  # as in the safe stop: what nodes raise there ends nothing
            changes = self.tree.status_changes
        stopped = Judgement(Action.STOP, 0.0, judgement.reasons)
        return decided(STOPPING, changes, self._journal.take(), Command(), stopped)

    def _take(self, kind: str, fields: Mapping[str, Any], tick: LoggedTick) -> None:
        """Do again what came from outside, where nodes are those of the log."""
        if self._by_name:
            what = "an edit" if kind == "edit" else "an order of a monitor"
            self.remarks.append(f"{what} at {tick.time_s:.2f} s is left out, as another tree is replayed")
        elif kind == "edit":
            self._exchange(fields["files"])
        else:
            try:
                ORDERS[fields["order"]](self._hooks, fields["body"])
            except (ValueError, KeyError, TypeError) as error:
                raise LogError(self.log.path, f"an order of a monitor cannot be repeated: {error!r}") from None

    def _exchange(self, texts: Mapping[str, str]) -> None:
        """Let an edited tree take over as it did in the run."""
        with tempfile.TemporaryDirectory(prefix="cell-replay-") as folder:
            write_files(self.log, {name: text.encode() for name, text in texts.items()}, Path(folder))
            following = _tree(self.log, Path(folder), node_registry(more=(*self._nodes, *self._configured)))
        take_over(self.tree, following, self._services, self._clock)
        self.tree, self._hooks = following, Hooks(following, _nobody)


def _refuse_without_beginning(log: Log) -> None:
    if not log.ticks:
        raise LogError(log.path, "holds no tick that could be replayed")
    if first := log.ticks[0].number:
        what = f"begins with tick {first}; nodes remember what they saw, so a replay needs the run from tick 0 on"
        raise LogError(log.path, f"{what}: name the first part")


def _notes(log: Log, about: str) -> list[dict[str, Any]]:
    return [fields for tick in log.ticks for topic, fields in tick.notes if topic == about]


def _nobody(_: int) -> None:
    """Nobody waits for news of breakpoints."""


def _load(log: Log, changes: Changes) -> tuple[Configuration, Product, Planners, Tree, FaultTable]:
    with tempfile.TemporaryDirectory(prefix="cell-replay-") as name:
        folder = Path(name)
        _unpack(log, folder)
        if changes.configuration is None:
            configuration = load_configuration(folder / "configuration.yaml")
            product = load_yaml(folder / "product.yaml", Product)
        else:
            configuration = load_configuration(changes.configuration)
            product = load_product(configuration, changes.configuration)
        registry = node_registry(product, changes.nodes, configuration)
        tree = (
            load_tree(changes.tree, registry, None, {}, changes.beside)
            if changes.tree
            else _tree(log, folder, registry)
        )
        recorded = folder / "faults.yaml"
        own = changes.configuration is None and recorded.exists()
        faults = recorded_table(recorded.read_text("utf-8")) if own else load_faults(configuration)
        configuration, _ = fitted(configuration, product)  # as the run had it
        configuration = _with_weights(log, configuration, changes)
        return configuration, product, load_planners(configuration, product), tree, faults


def _tree(log: Log, folder: Path, registry: Registry) -> Tree:
    """The tree of a log whose files are unpacked in a folder; with the entries and the further files of its run."""
    files, entries = folder / "tree", json.loads(log.metadata.get("entries", "{}"))
    return load_tree(files / log.metadata["tree"], registry, None, entries, (files,))


def _unpack(log: Log, folder: Path) -> None:
    if "tree" not in log.metadata:
        raise LogError(log.path, "does not name the tree that ran")
    for needed in ("configuration.yaml", "product.yaml", f"tree/{log.metadata['tree']}"):
        if needed not in log.attachments:
            raise LogError(log.path, f"has no attachment {needed}; it has: {', '.join(log.attachments) or 'none'}")
    write_files(log, log.attachments, folder)


def _with_weights(log: Log, configuration: Configuration, changes: Changes) -> Configuration:
    """The configuration with weights as asked; where nothing else was asked, they must be those of the log."""
    if unknown := sorted(set(changes.weights) - set(PLANNERS)):
        raise InputError(f"--weights names unknown planners {unknown}; legal: {', '.join(PLANNERS)}")
    updates = {}
    for name, planner in configuration.planners:
        weights = changes.weights.get(name)
        if weights is None and changes.configuration is None:
            weights = recorded_weights(log, name, planner.weights)
        updates[name] = planner if weights is None else planner.model_copy(update={"weights": weights})
    return configuration.model_copy(update={"planners": configuration.planners.model_copy(update=updates)})


def recorded_weights(log: Log, name: str, found: Path | None) -> Path | None:
    """A file with the weights that the log was recorded with; None where that planner had none."""
    expected = log.metadata.get(f"weights.{name}.sha256")
    if expected is None:
        return None
    recorded = log.metadata.get(f"weights.{name}.file")
    candidates = [path for path in (found, recorded and Path(recorded)) if path and path.is_file()]
    hashes = {path: digest_of(path.read_bytes()) for path in candidates}
    for path, sha256 in hashes.items():
        if sha256 == expected:
            return path
    here = ", ".join(f"{path} is {sha256[:12]}" for path, sha256 in hashes.items()) or "there is no such file here"
    what = f"was recorded with other {name} weights: {expected[:12]}, but {here}"
    raise LogError(log.path, f"{what}; name a file to see what it would have done: --weights {name}=FILE")
