"""What a run is asked for, and everything that is read before a device is opened."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal

from cell.configuration import DEFAULT_CONFIGURATION, DEFAULT_TREE, Configuration
from cell.errors import InputError
from cell.interfaces.faults import FaultTable
from cell.interfaces.product import Product
from cell.interfaces.resume import LeftOff
from cell.wiring.node_library import node_registry
from cell.wiring.services import Planners
from trees.engine.tree import Tree
from trees.files.loader import load_tree, unused_entries

Pace = Literal["fast", "real"]


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
        page_port: where the operator's page is served; None for no page.
        orders: lines that an operator types; None for no one.
        max_duration_s: the run ends by itself after so long; None for the configuration's.
        images: keep images and joint samples in the log, and make a contact sheet.
        pixels: render what the cameras see; without, a simulated cell's hands, holes and parts come from the truth.
        one_process: simulate, render and detect in this process, as where many runs go on side by side.
        world: address of a world that `cell world` opened; None for one of the run's own.
        resume: log of a run that was broken off; this one goes on with its work.
        brackets: how many are made one after the other; None for one bracket, 0 for until the run is stopped.
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
    page_port: int | None = None
    orders: Iterable[str] | None = None
    brackets: int | None = None
    world: Path | None = None
    resume: Path | None = None
    max_duration_s: float | None = None
    images: bool = True
    pixels: bool = True
    one_process: bool = False

    def adjusted(self, configuration: Configuration) -> Configuration:
        """The configuration as this run is to have it: how long at most, what its log keeps, how it is simulated."""
        controller, log, devices = configuration.controller, configuration.log, configuration.devices
        if self.max_duration_s is not None:
            controller = controller.model_copy(update={"max_duration_s": self.max_duration_s})
        if not self.images:
            log = log.model_copy(update={"camera_frames": False, "joint_samples": False})
        if self.one_process:
            simulation = devices.simulation.model_copy(update={"overlap": False})
            devices = devices.model_copy(update={"simulation": simulation})
        return configuration.model_copy(update={"controller": controller, "log": log, "devices": devices})

    @property
    def attended(self) -> bool:
        """Whether somebody is there who answers questions."""
        return self.brackets is not None or self.page_port is not None or self.orders is not None

    def load(self, product: Product, configuration: Configuration) -> Tree:
        """The tree as it stands in its files now.

        Raises:
            InputError: everything that is wrong with it, or with the entries that it is given.
        """
        registry = node_registry(product, self.nodes, configuration)
        tree = load_tree(self.tree, registry, None, self.entries, self.beside)
        if tree.unused:
            raise InputError(*unused_entries({self.tree: tree}))
        return tree


@dataclass(frozen=True)
class Files:
    """Everything that was read before any device was opened.

    Attributes:
        left_off: of the run that this one goes on with.
    """

    configuration: Configuration
    product: Product
    tree: Tree
    planners: Planners
    faults: FaultTable
    left_off: LeftOff | None = None
