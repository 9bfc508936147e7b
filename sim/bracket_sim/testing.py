"""A test kit: run trees of your own on a simulated cell, from pixels, in simulated time and without a log.

Example:
    def test_a_part_is_fetched() -> None:
        with simulated_cell(goal="g0", seed=3) as cell:
            outcome, seen = cell.run("trees/mine.xml")
        assert outcome.end == "finished", outcome.cause
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path

from bracket_cell.configuration import Configuration, load_configuration, load_faults, load_product
from bracket_cell.runs.options import Files
from bracket_cell.runs.run import run_controller
from bracket_cell.skills.motion.planner import MotionPlanner
from bracket_cell.trees.loading import load_tree
from bracket_cell.trees.node_library import node_registry
from bracket_cell.watching.observer import Observer, Outcome, TickRecord
from bracket_cell.wiring.devices import attached
from bracket_cell.wiring.services import load_planners
from bracket_ground.files.files import user_or_packaged
from bracket_ground.interfaces.product import Product
from bracket_sim.cell import SimCell
from bracket_sim.scene.parts import ScenePart
from bracket_sim.scene.settings import settings_of

__all__ = ["Recorded", "ScenePart", "SimulatedCell", "simulated_cell"]


@dataclass
class Recorded(Observer):
    """An observer that keeps what decides a test.

    Attributes:
        notes: (time_s, topic, fields) of every note that nodes made.
        joints: measured joints of every tick.
        statuses: status changes of every tick.
    """

    notes: list[tuple[float, str, dict[str, object]]] = field(default_factory=list)
    joints: list[tuple[float, ...]] = field(default_factory=list)
    statuses: list[tuple[tuple[str, str], ...]] = field(default_factory=list)

    def tick(self, record: TickRecord) -> None:
        time_s = record.observation.time_s
        self.notes += [(time_s, topic, dict(fields)) for topic, fields in record.notes]
        self.joints.append(record.observation.arm.positions_rad)
        self.statuses.append(tuple((change.path, change.new.name) for change in record.changes))

    def reasons(self) -> list[str]:
        """What skills and guards said, in order."""
        return [str(fields.get("reason")) for _, topic, fields in self.notes if topic in ("skill", "verdict")]


@dataclass(frozen=True)
class SimulatedCell:
    """A cell with its simulator.

    Attributes:
        world: the simulator, with what really is.
        motion: plans ways of the arm; it keeps no state between runs.
    """

    configuration: Configuration
    product: Product
    world: SimCell
    motion: MotionPlanner

    def run(
        self,
        tree: Path | str,
        main: str | None = None,
        entries: Mapping[str, object] | None = None,
        recorded: Recorded | None = None,
        nodes: Iterable[str] = (),
    ) -> tuple[Outcome, Recorded]:
        """Run a tree to its end and a safe stop.

        Args:
            main: BehaviorTree to run instead of the file's `main_tree_to_execute`.
            entries: of the main tree's blackboard, set before the first tick.
            nodes: files and packages with further nodes, beside those of the configuration.

        Raises:
            InputError: everything that is wrong with the tree.
        """
        recorded = recorded or Recorded()
        loaded = load_tree(Path(tree), node_registry(self.product, nodes, self.configuration), main, entries)
        planners, faults = load_planners(self.configuration, self.product), load_faults(self.configuration)
        files = Files(self.configuration, self.product, loaded, planners, faults)
        with attached(self.configuration, self.product, self.world.devices) as devices:
            return run_controller(files, devices, self.motion, (recorded,)), recorded


@contextmanager
def simulated_cell(
    configuration: Path | str | None = None,
    goal: str = "random",
    seed: int = 1,
    person: bool = True,
    parts: Sequence[ScenePart] | None = None,
) -> Iterator[SimulatedCell]:
    """A simulated cell, closed at the end.

    Args:
        configuration: file; that of the folder, config/cell.yaml, by default, else the shipped one.
        goal: what the person builds, or "random".
        person: somebody works at the bench.
        parts: in the tray; drawn by the seed by default.

    Raises:
        InputError: the configuration or the product is wrong.
    """
    path = Path(configuration or user_or_packaged("bracket_cell.config", "cell.yaml"))
    read = load_configuration(path)
    product, devices = load_product(read, path), read.devices
    world = SimCell(
        product,
        read.bench,
        settings_of(devices.simulation),
        *devices.gripper_bus,
        seed,
        goal,
        worker=person,
        clutter=parts,
    )
    try:
        yield SimulatedCell(read, product, world, MotionPlanner(product, read.bench, read.motion))
    finally:
        world.close()
