"""What a replay ticks on: tree, configuration, planners and faults of a log, or changed ones."""

from __future__ import annotations

from collections.abc import Mapping
from contextlib import ExitStack
from dataclasses import dataclass, field
from pathlib import Path

from bracket_cell.configuration import Configuration, load_configuration, load_faults, load_product, with_rest
from bracket_cell.kinds import DETECTORS, PLANNERS, KindSettings, files_of
from bracket_cell.learned.inference.onnx_model import digest_of
from bracket_cell.log.read.reader import Log, json_of
from bracket_cell.log.read.ticks import holding
from bracket_cell.log.replay.logged_tree import nodes_missing, recorded_table, unpacked
from bracket_cell.trees.loading import load_tree
from bracket_cell.trees.node_library import node_registry
from bracket_cell.wiring.detectors import with_detectors_for
from bracket_cell.wiring.services import Planners, load_planners
from bracket_ground.errors import InputError, LogError
from bracket_ground.files.yaml_file import load_yaml
from bracket_ground.interfaces.faults import FaultTable
from bracket_ground.interfaces.product import Product
from btxml.engine.tree import Tree
from btxml.files.compile.registry import Registry


@dataclass(frozen=True)
class Changes:
    """What is to be other than in the log.

    Attributes:
        weights: ONNX file by planner, "semantic" or "grasp".
        nodes: files and packages with further nodes.
        beside: further files, and folders with them, whose trees `tree` may name.
        perception: a kind of detectors, or a folder with their weights: they see the recorded images again.
    """

    tree: Path | None = None
    configuration: Path | None = None
    weights: Mapping[str, Path] = field(default_factory=dict)
    nodes: tuple[str, ...] = ()
    beside: tuple[Path, ...] = ()
    perception: str | None = None


def load(
    log: Log, changes: Changes, edited: Mapping[str, str], files: ExitStack
) -> tuple[Configuration, Product, Planners, Tree, FaultTable]:
    """Everything that a replay ticks on.

    Args:
        edited: files of the tree that took over in the run, by name.
        files: unpacked of the log; the arm's meshes are read for as long as it is open.

    Raises:
        LogError: the log lacks some of it, was recorded with other weights, or with nodes that are not here.
        InputError, ModelError: a changed file cannot be used.
    """
    _is_whole(log)
    try:
        own = unpacked(log, {**log.attachments, **{file: text.encode() for file, text in edited.items()}})
        with ExitStack() as stack:
            found = _load(log, changes, stack.enter_context(own))
            files.callback(stack.pop_all().close)
        return found
    except InputError as error:
        if not (missing := nodes_missing(log, changes.nodes)):
            raise
        way = f"it holds {', '.join(missing)}: `cell lab files` writes them; read them, then name them with --with"
        raise LogError(log.path, f"was recorded with nodes of the user's own; {way}\n{error}") from None


def _load(log: Log, changes: Changes, folder: Path) -> tuple[Configuration, Product, Planners, Tree, FaultTable]:
    if changes.configuration is None:
        path = folder / "configuration.yaml"
        product = load_yaml(folder / "product.yaml", Product)
        configuration = with_rest(load_configuration(path, rested=False), product, path)
        _refuse_classes(log, configuration)
    else:
        configuration = load_configuration(changes.configuration)
        product = load_product(configuration, changes.configuration)
    registry = node_registry(product, changes.nodes, configuration)
    tree = (
        load_tree(changes.tree, registry, None, {}, changes.beside)
        if changes.tree
        else recorded_tree(log, folder, registry)
    )
    recorded = folder / "faults.yaml"
    own = changes.configuration is None and recorded.exists()
    with holding(log.path, "its table of faults"):
        faults = recorded_table(recorded.read_text("utf-8")) if own else load_faults(configuration)
    configuration, _ = with_detectors_for(configuration, product)  # as the run had it
    configuration = _with_weights(log, configuration, changes)
    return configuration, product, load_planners(configuration, product), tree, faults


def _refuse_classes(log: Log, configuration: Configuration) -> None:
    """A log is data: what it names is not loaded, but for kinds that are installed.

    Raises:
        LogError: it names a class of the user's own.
    """
    chosen = {name: configuration.perception.chosen(name).kind for name in DETECTORS}
    chosen |= {name: planner.kind for name, planner in configuration.planners}
    if own := [f"{name} {kind}" for name, kind in chosen.items() if ":" in kind]:
        what = f"was recorded with classes of the user's own, {', '.join(own)}"
        raise LogError(log.path, f"{what}; where you have them, name a configuration that does, too: --config FILE")


def recorded_tree(log: Log, folder: Path, registry: Registry) -> Tree:
    """The tree of a log whose files are unpacked in a folder; with the entries and the further files of its run."""
    files, entries = folder / "tree", json_of(log.path, log.metadata, "entries", dict) or {}
    return load_tree(files / log.metadata["tree"], registry, None, entries, (files,))


def _is_whole(log: Log) -> None:
    if "tree" not in log.metadata:
        raise LogError(log.path, "does not name the tree that ran")
    for needed in ("configuration.yaml", "product.yaml", f"tree/{log.metadata['tree']}"):
        if needed not in log.attachments:
            raise LogError(log.path, f"has no attachment {needed}; it has: {', '.join(log.attachments) or 'none'}")


def _with_weights(log: Log, configuration: Configuration, changes: Changes) -> Configuration:
    """The configuration with weights as asked; where nothing else was asked, they must be those of the log."""
    if unknown := sorted(set(changes.weights) - set(PLANNERS)):
        raise InputError(f"--weights names unknown planners {unknown}; legal: {', '.join(PLANNERS)}")
    updates = {}
    for name, planner in configuration.planners:
        weights = changes.weights.get(name)
        if weights is None and changes.configuration is None:
            weights = recorded_weights(log, name, planner)
        updates[name] = planner if weights is None else planner.model_copy(update={"weights": weights})
    return configuration.model_copy(update={"planners": configuration.planners.model_copy(update=updates)})


def recorded_weights(log: Log, name: str, planner: KindSettings) -> Path | None:
    """A file with the weights that the log was recorded with; None where that planner had none."""
    expected = log.metadata.get(f"weights.{name}.sha256")
    if expected is None:
        return None
    recorded = log.metadata.get(f"weights.{name}.file")
    found = None if ":" in planner.kind else next(iter(files_of(name, planner).values()), None)
    candidates = [path for path in (found, recorded and Path(recorded)) if path and path.is_file()]
    hashes = {path: digest_of(path.read_bytes()) for path in candidates}
    for path, sha256 in hashes.items():
        if sha256 == expected:
            return path
    here = ", ".join(f"{path} is {sha256[:12]}" for path, sha256 in hashes.items()) or "there is no such file here"
    what = f"was recorded with other {name} weights: {expected[:12]}, but {here}"
    raise LogError(log.path, f"{what}; name a file to see what it would have done: --weights {name}=FILE")
