"""What a run is asked for, and everything that is read before a device is opened."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Annotated, Any, Literal

from typer import Option

from bracket_cell.configuration import DEFAULT_CONFIGURATION, DEFAULT_TREE, Configuration
from bracket_cell.runs.signing import Signature
from bracket_cell.simulator import simulator
from bracket_cell.trees.loading import input_problem, load_tree
from bracket_cell.trees.node_library import node_registry
from bracket_cell.trees.rules import Rules, check_rules, load_rules, rules_beside
from bracket_cell.wiring.safety import SafetyConfiguration, safety_of
from bracket_cell.wiring.services import Planners
from bracket_ground.errors import InputError
from bracket_ground.interfaces.devices import Devices
from bracket_ground.interfaces.faults import FaultTable
from bracket_ground.interfaces.product import Product
from bracket_ground.interfaces.resume import ResumeState
from btxml.engine.tree import Tree
from btxml.files.loader import unused_entries

Pace = Literal["fast", "real"]
GOAL_HELP = "Goals of the simulated person, by commas, or random."
LOOK_HELP = (
    "Look of the simulation: nominal, varied, hard, PRESET:SECTION or a look file; none, for a run, renders nothing, "
    "and the simulation says what is there: faster."
)
PERSON_HELP = "The simulated person: a name of `cell docs people`, or a YAML file; A,B take turns in a shift."
SHARE_HELP = "The arm never exceeds this share of its speed."


@dataclass(frozen=True)
class RunOptions:
    """What a run is asked for; the command line has an option for each field that explains one.

    Attributes:
        nodes: files and packages with further nodes.
        beside: further tree files, and folders with them, whose trees may be named.
        entries: of the main tree, set before the first tick.
        devices: open already, in place of those that the configuration names.
        max_duration_s: after which the run ends by itself; None for the configuration's.
        images: keep images and joint samples in the log, and make a contact sheet.
        slower: the wall's clock goes so many times slower, as a twin's does.
        monitor_port, live_port: where others may watch, each None where nobody may.
        monitor_hooks: they may set breakpoints and overrides.
        pixels: render what the cameras see; without, a simulated cell's hands, holes and parts come from the truth.
        answered: somebody is there who answers questions, as with a page or in a shift.
        one_process: simulate, render and detect in this process, as where many runs go on side by side.
    """

    tree: Path = DEFAULT_TREE
    configuration: Annotated[Path, Option("--config", help="Configuration file of the cell.")] = DEFAULT_CONFIGURATION
    goal: Annotated[str, Option(help=GOAL_HELP)] = "random"
    seed: Annotated[int, Option(min=0, help="Random seed: the same seed gives the same run.")] = 0
    pace: Pace = "fast"
    log: Annotated[Path | None, Option(help="Log file (MCAP); by default a new one in the configured folder.")] = None
    monitor_port: int | None = None
    monitor_hooks: bool = False
    await_monitor: bool = False
    watch: Annotated[bool, Option("--watch", help="Apply edits of the tree file during the run.")] = False
    live_port: int | None = None
    overwrite: Annotated[bool, Option("--overwrite", help="Replace the file of --log if it exists.")] = False
    person: Annotated[str | None, Option(help=PERSON_HELP)] = None
    inject: Annotated[str | None, Option(help="FAULT@STATE: inject a fault when the work reaches a state.")] = None
    look: Annotated[str | None, Option(help=LOOK_HELP)] = None
    nodes: tuple[str, ...] = ()
    beside: tuple[Path, ...] = ()
    entries: Mapping[str, Any] = field(default_factory=dict)
    page: Annotated[
        str | None,
        Option(
            "--page",
            metavar="[HOST:PORT]",
            help="Serve the operator's page; port 8780 of this machine, or of a host that others open.",
        ),
    ] = None
    work_orders: Annotated[
        Path | None, Option(metavar="FILE", help="Work orders, a JSON object a line; the file may grow during the run.")
    ] = None
    book: Annotated[
        Path | None,
        Option(metavar="FILE", hidden=True, help="`cell serve`: write this run into its book of production (SQLite)."),
    ] = None
    operator: Annotated[str, Option(metavar="NAME", hidden=True, help="`cell serve`: who begins the run.")] = ""
    brackets: Annotated[
        int | None,
        Option("--shift", metavar="N", min=0, help="Assemble N brackets one after the other; 0: until you stop it."),
    ] = None
    world: Annotated[Path | None, Option(help="Use the simulated cell of a `cell lab world` at this address.")] = None
    resume: Annotated[
        Path | None, Option(metavar="LOG", help="Log of a run that was broken off: continue its work.")
    ] = None
    slower: float = 1.0
    unsafe_table: Annotated[
        bool, Option("--unsafe-table", help="Take faults or a separation that does less than what is shipped.")
    ] = False
    share: Annotated[float | None, Option(min=0.02, max=1, help=SHARE_HELP)] = None
    max_duration_s: float | None = None
    images: bool = True
    pixels: bool = True
    one_process: bool = False
    answered: bool = False
    devices: Devices | None = None

    def refuse_simulated(self, configuration: Configuration) -> None:
        """Check that nothing is asked of a simulator where there is none.

        Raises:
            InputError: something is.
        """
        given = {"--seed": self.seed, "--goal": self.goal != "random", "--look": self.look, "--person": self.person}
        asked = [name for name, value in given.items() if value]
        if asked and self.devices is None and not configuration.devices.simulated:
            what = "say how a cell is simulated" if len(asked) > 1 else "says how a cell is simulated"
            raise InputError(
                f"{', '.join(asked)} {what}, and all devices of {self.configuration} are real; leave it out"
            )

    def adjusted(self, configuration: Configuration) -> Configuration:
        """The configuration as this run is to have it: how long at most, what its log keeps, how it is simulated."""
        controller, log, devices = configuration.controller, configuration.log, configuration.devices
        if self.max_duration_s is not None:
            controller = controller.model_copy(update={"max_duration_s": self.max_duration_s})
        if not self.images:
            log = log.model_copy(update={"camera_frames": False, "joint_samples": False})
        if self.one_process and devices.simulated:
            simulation = simulator().changed(devices.simulation, overlap=False)
            devices = devices.model_copy(update={"simulation": simulation})
        motion = configuration.motion
        if self.share is not None:
            motion = motion.slowed(self.share)
        changed = {"controller": controller, "log": log, "devices": devices, "motion": motion}
        return configuration.model_copy(update=changed)

    @property
    def attended(self) -> bool:
        """Whether somebody is there who answers questions."""
        return self.brackets is not None or self.page is not None or self.answered

    def load(self, product: Product, configuration: Configuration) -> Tree:
        """The tree as it stands in its files now.

        Raises:
            InputError: everything that is wrong with it, or with the entries that it is given.
        """
        registry = node_registry(product, self.nodes, configuration)
        tree = load_tree(self.tree, registry, None, self.entries, self.beside)
        if tree.unused:
            raise InputError(*map(input_problem, unused_entries({self.tree: tree})))
        return tree

    def load_rules(self, tree: Tree) -> Rules:
        """The rules beside the tree file; none where there is no such file.

        Raises:
            InputError: everything that is wrong with them, as names that the tree does not have.
        """
        path = rules_beside(self.tree)
        if path is None:
            return Rules()
        if problems := check_rules(path, tree).problems:
            raise InputError(*problems)
        return load_rules(path)


@dataclass(frozen=True)
class Files:
    """Everything that was read before any device was opened.

    Attributes:
        left_off: of the run that this one goes on with; empty for a new beginning.
        unsafe: where table or separation do less than the shipped ones.
        signature: of the safety configuration; None in simulation.
        rules: of the tree.
    """

    configuration: Configuration
    product: Product
    tree: Tree
    planners: Planners
    faults: FaultTable
    left_off: ResumeState = field(default_factory=ResumeState)
    unsafe: tuple[str, ...] = ()
    signature: Signature | None = None
    rules: Rules = field(default_factory=Rules)

    @cached_property
    def safety(self) -> SafetyConfiguration:
        """What decides on people in this run."""
        return safety_of(self.configuration, self.product, self.faults)

    @property
    def signed(self) -> str:
        """The hash of that, and who signed it."""
        return f"{self.safety.short}, not signed: simulated" if self.signature is None else str(self.signature)
