"""One simulated assembly beside a person, opened for a trial: with images, or without."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path

from cell.configuration import load_configuration, load_faults, load_product, simulated
from cell.evaluating.bare_host import without_pixels
from cell.interfaces.errors import DeviceFault
from cell.interfaces.files import shipped
from cell.interfaces.judgement import FaultTable
from cell.interfaces.operator import OperatorOrder
from cell.observer import Observer, Outcome
from cell.run import drive
from cell.run_options import Files
from cell.running.detectors import fitted
from cell.running.injection import Injection, Injections
from cell.running.node_library import node_registry
from cell.running.services import load_planners
from sim.cell import SimCell
from skills.planner import MotionPlanner
from trees.files.loader import load_tree

ALGORITHM_1 = shipped("trees", "assemble.xml")
NOTICES_S = 3.0
Injected = Injection | Injections | None


@dataclass(frozen=True)
class Assembly:
    """A cell with its person; `run` works on one bracket."""

    cell: SimCell
    motion: MotionPlanner
    run: Callable[[Sequence[Observer], Injected], Outcome]


class Attendant:
    """Somebody at the bench who acknowledges a protective stop after a while."""

    def __init__(self, cell: SimCell) -> None:
        self._cell = cell
        self._stopped_s: float | None = None

    def pressed(self) -> Sequence[OperatorOrder]:
        """What was pressed since the last call."""
        now_s = self._cell.devices.clock.now_s()
        try:
            mode = self._cell.arm.state().mode
        except DeviceFault:  # the supervisor is told of it, too
            return ()
        if mode != "protective_stop":
            self._stopped_s = None
            return ()
        self._stopped_s = now_s if self._stopped_s is None else self._stopped_s
        if now_s - self._stopped_s < NOTICES_S:
            return ()
        self._stopped_s = now_s
        return (OperatorOrder("acknowledge"),)


@contextmanager
def assembly(
    path: Path,
    person: str,
    seed: int,
    table: FaultTable | None = None,
    *,
    tree: Path = ALGORITHM_1,
    rendered: bool = False,
) -> Iterator[Assembly]:
    """A simulated cell beside a person who builds one of the product's goals.

    Args:
        path: of the configuration.
        person: a kind of person, or a file.
        table: what the supervisor does about faults; the configured one by default.
        tree: file of the tree that is run.
    """
    configuration = simulated(load_configuration(path), None, person)
    product = load_product(configuration, path)
    configuration, _ = fitted(configuration, product)
    motion = MotionPlanner(product, configuration.bench, configuration.motion)
    faults = table or load_faults(configuration)
    files = Files(
        configuration, product, load_tree(tree, node_registry()), load_planners(configuration, product), faults
    )
    can = configuration.gripper_can
    settings = configuration.devices.simulation
    cell = SimCell(
        product, configuration.bench, settings, can.interface, can.channel, seed, "random", rendered=rendered
    )

    attendant = Attendant(cell)

    def pressed() -> Sequence[OperatorOrder]:
        return (*cell.devices.pressed(), *attendant.pressed())

    def run(observers: Sequence[Observer], injected: Injected = None) -> Outcome:
        devices = cell.devices if rendered else without_pixels(cell)
        return drive(files, replace(devices, pressed=pressed), motion, observers, injection=injected)

    try:
        yield Assembly(cell, motion, run)
    finally:
        cell.close()
