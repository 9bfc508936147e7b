"""Assemblies beside a person who goes into the arm's way: contacts as they really were, and what separation costs."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from cell.configuration import load_configuration, load_faults, load_product, simulated
from cell.interfaces.files import shipped
from cell.interfaces.judgement import Action, FaultTable
from cell.interfaces.perception import Frame
from cell.observer import Level, Outcome, TickRecord
from cell.run import Files, drive
from cell.running.node_library import node_registry
from cell.running.services import load_planners
from sim.cell import SimCell
from sim.contacts import Contact
from skills.planner import MotionPlanner
from trees.files.loader import load_tree

SLOW_M_S = 0.25
DRIVEN_M_S = 0.05  # below this the arm stood, and the person touched it
STOPS_S = 0.35  # after this the arm stands that was told to hold
OF_PERSON = ("hand_near", "hand_too_near", "blind_area")


@dataclass
class Holds:
    """An observer that keeps since when the arm was held, and whether it moved while the hand was unknown.

    Attributes:
        since: by the tick's time, since when the supervisor held; infinite where it did not.
    """

    since: list[tuple[float, float]] = field(default_factory=list)
    moved_while_unknown: int = 0
    _from_s: float = np.inf
    _unknown_s: float = np.inf

    def frame(self, frame: Frame) -> None:
        """Images are not looked at."""

    def tick(self, record: TickRecord) -> None:
        seen, judgement = record.observation, record.judgement
        held = judgement is not None and judgement.action >= Action.HOLD
        self._from_s = min(self._from_s, seen.time_s) if held else np.inf
        self.since.append((seen.time_s, self._from_s))
        unknown = seen.bench is not None and bool(seen.bench.hand_unknown)
        self._unknown_s = min(self._unknown_s, seen.time_s) if unknown else np.inf
        self.moved_while_unknown += seen.time_s - self._unknown_s > STOPS_S and not seen.arm.stands

    def message(self, time_s: float, level: Level, text: str) -> None:
        """Messages are not kept."""

    def close(self, outcome: Outcome) -> None:
        """Nothing to do."""

    def held_long_before(self, time_s: float) -> bool:
        """Whether the arm had been told to hold for so long that it had to stand at this time."""
        before = [since for at, since in self.since if at <= time_s]
        return bool(before) and time_s - before[-1] > STOPS_S


def meet(path: Path, person: str, encounters: int, first_seed: int, tell: Callable[[str], None]) -> dict[str, object]:
    """Assemble until so many times a hand went into the arm's way."""
    met = seeds = moved = 0
    contacts: list[Contact] = []
    avoidable = 0
    ends: dict[str, int] = {}
    while met < encounters:
        holds = Holds()
        cell, outcome = _assembly(path, person, first_seed + seeds, holds)
        assert cell.worker is not None
        assert cell.contacts is not None
        acts = sum(event.fields.get("act") == "intrude" for event in cell.worker.acts)
        found = list(cell.contacts.all())
        avoidable += sum(one.first_m_s > DRIVEN_M_S and holds.held_long_before(one.start_s) for one in found)
        contacts += found
        met, seeds, moved = met + acts, seeds + 1, moved + holds.moved_while_unknown
        ends[outcome.end] = ends.get(outcome.end, 0) + 1
        fastest = max((one.speed_m_s for one in found), default=0.0)
        words = f"{outcome.end}, {acts} encounters, {len(found)} contacts, at most {fastest:.2f} m/s"
        tell(f"seed {first_seed + seeds - 1}: {words}")
        if not acts and seeds > 5 * encounters:
            break
    return {
        "person": person,
        "assemblies": seeds,
        "ends": ends,
        "encounters": met,
        "contacts": len(contacts),
        "contacts_fast": sum(one.speed_m_s > SLOW_M_S for one in contacts),
        "contacts_avoidable": avoidable,
        "fastest_m_s": round(max((one.speed_m_s for one in contacts), default=0.0), 3),
        "moved_while_unknown": moved,
    }


def throughput_ratio(path: Path, seeds: Iterable[int]) -> float | None:
    """Time for a bracket beside a careful person, with separation over without it, paired by seed."""
    table = load_faults(load_configuration(path))
    rows = [row.model_copy(update={"action": "run"}) if row.signal in OF_PERSON else row for row in table.faults]
    without = table.model_copy(update={"faults": tuple(rows)})
    times = [(_time_s(path, seed, table), _time_s(path, seed, without)) for seed in seeds]
    return round(sum(one for one, _ in times) / sum(other for _, other in times), 3) if times else None


def _time_s(path: Path, seed: int, table: FaultTable) -> float:
    return _assembly(path, "careful", seed, Holds(), table)[1].sim_time_s


def _assembly(
    path: Path, person: str, seed: int, holds: Holds, table: FaultTable | None = None
) -> tuple[SimCell, Outcome]:
    configuration = simulated(load_configuration(path), None, person)
    product = load_product(configuration, path)
    motion = MotionPlanner(product, configuration.bench, configuration.motion)
    tree = load_tree(shipped("trees", "assemble.xml"), node_registry())
    faults = table or load_faults(configuration)
    files = Files(configuration, product, tree, load_planners(configuration, product), faults)
    can = configuration.gripper_can
    simulation = configuration.devices.simulation
    cell = SimCell(product, configuration.bench, simulation, can.interface, can.channel, seed, "random")
    try:
        return cell, drive(files, cell.devices, motion, [holds])
    finally:
        cell.close()
