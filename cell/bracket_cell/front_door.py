"""Load a cell, run a tree on it, replay the log: for scripts and notebooks, in the words of the command line."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from rich.console import Console

from bracket_cell.configuration import (
    DEFAULT_CONFIGURATION,
    DEFAULT_TREE,
    Configuration,
    load_configuration,
    load_product,
)
from bracket_cell.log.read.reader import read_log
from bracket_cell.log.replay.compare import Difference
from bracket_cell.log.replay.loading import Changes
from bracket_cell.log.replay.replay import Replay, Step
from bracket_cell.runs import run as runs
from bracket_cell.runs.options import RunOptions
from bracket_ground.interfaces.devices import Devices
from bracket_ground.interfaces.product import Product

Name = str | os.PathLike[str]


@dataclass(frozen=True)
class LoadedCell:
    """A cell whose files were read and found right; nothing has been opened yet.

    Attributes:
        path: of its configuration.
        devices: open already; None for those that the configuration names.
    """

    path: Path
    configuration: Configuration
    product: Product
    devices: Devices | None = None


def load_cell(configuration: Name = DEFAULT_CONFIGURATION, devices: Devices | None = None) -> LoadedCell:
    """Read the files of a cell.

    Args:
        devices: opened and closed by the caller, in place of those that the configuration names.

    Raises:
        InputError: everything that is wrong with them, with file and line.
    """
    path = Path(configuration)
    loaded = load_configuration(path)
    return LoadedCell(path, loaded, load_product(loaded, path), devices)


def run(
    cell: LoadedCell,
    tree: Name = DEFAULT_TREE,
    log: Name | None = None,
    goal: str = "random",
    seed: int = 0,
    real_time: bool = False,
    nodes: Sequence[str] = (),
    entries: Mapping[str, object] | None = None,
    console: Console | None = None,
) -> runs.RunResult:
    """Run one tree to its end and a safe stop.

    Args:
        log: file to write; None for a new one in the configured folder.
        goal, seed: what the simulated person builds, and what is drawn at random.
        nodes: files and packages with nodes of one's own.
        entries: of the main tree, set before the first tick.
        console: shows the run as `cell run` does; None for nothing.

    Raises:
        InputError: nothing has moved, and no file was touched.
        DeviceFault: a device could not be opened.
    """
    options = RunOptions(
        tree=Path(tree),
        configuration=cell.path,
        goal=goal,
        seed=seed,
        pace="real" if real_time else "fast",
        log=_path(log),
        nodes=tuple(nodes),
        entries=dict(entries or {}),
        devices=cell.devices,
    )
    return runs.run(options, console or Console(quiet=True))


def replay(log: Name, tree: Name | None = None, configuration: Name | None = None) -> list[Difference]:
    """Tick the tree of a log again, or another tree, and list what is decided otherwise.

    Raises:
        LogError: the log cannot be read, or lacks what a replay needs.
        InputError: a changed file cannot be used.
    """
    changes = Changes(_path(tree), _path(configuration))
    found: list[Difference] = []

    def watch(step: Step) -> None:
        found.extend(step.differences)

    Replay(read_log(Path(log)), changes).run(watch=watch)
    return found


def _path(name: Name | None) -> Path | None:
    return None if name is None else Path(name)
