"""Assemblies beside a person who goes into the arm's way: contacts as they really were, and what separation costs."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from cell.configuration import load_configuration, load_faults
from cell.evaluating.assembly import assembly
from cell.interfaces.judgement import Action, FaultTable
from cell.interfaces.perception import Frame, HandSample
from cell.observer import Level, Outcome, TickRecord
from sim.cell import SimCell
from sim.contacts import Contact
from skills.separation import SeparationMonitor

SLOW_M_S = 0.25
DRIVEN_M_S = 0.05  # below this the arm stood, and the person touched it
STOPS_S = 0.35  # after this the arm stands that was told to hold
LATE_S = 0.15  # as late as answers about the hand come: half a frame's period, the detectors' time and a tick
BOX = (100, 100, 200, 200)
OF_PERSON = ("hand_near", "hand_too_near", "blind_area")


@dataclass(frozen=True)
class _Tick:
    """Since when the arm was held, and since when it should have been; infinite for not. And what was known."""

    time_s: float
    held_s: float
    should_s: float
    known: str


@dataclass
class Encounters:
    """An observer that keeps what is needed to judge contacts afterwards.

    Attributes:
        moved_while_unknown: ticks in which the arm moved although it was not known where the hand is.
    """

    cell: SimCell
    monitor: SeparationMonitor
    moved_while_unknown: int = 0
    _ticks: list[_Tick] = field(default_factory=list)
    _hands: deque[tuple[float, HandSample]] = field(default_factory=lambda: deque(maxlen=16))
    _held_s: float = np.inf
    _should_s: float = np.inf
    _unknown_s: float = np.inf

    def frame(self, frame: Frame) -> None:
        """Images are not looked at."""

    def tick(self, record: TickRecord) -> None:
        seen, judgement = record.observation, record.judgement
        now_s, bench = seen.time_s, seen.bench
        held = judgement is not None and judgement.action >= Action.HOLD
        self._held_s = min(self._held_s, now_s) if held else np.inf
        self._should_s = min(self._should_s, now_s) if self._should_hold(record) else np.inf
        unknown = bench is not None and bool(bench.hand_unknown)
        self._unknown_s = min(self._unknown_s, now_s) if unknown else np.inf
        self.moved_while_unknown += now_s - self._unknown_s > STOPS_S and not seen.arm.stands
        words = "" if judgement is None else judgement.words
        hand = "unknown" if unknown else "seen" if bench is not None and bench.hand is not None else "not seen"
        self._ticks.append(_Tick(now_s, self._held_s, self._should_s, f"hand {hand}; {words}"))

    def message(self, time_s: float, level: Level, text: str) -> None:
        """Messages are not kept."""

    def close(self, outcome: Outcome) -> None:
        """Nothing to do."""

    def judge(self, contact: Contact) -> dict[str, object]:
        """A contact as a row: could the formula have avoided it, and what did the cell know."""
        before = [tick for tick in self._ticks if tick.time_s <= contact.start_s]
        last = before[-1] if before else _Tick(0.0, np.inf, np.inf, "")
        driven = contact.first_m_s > DRIVEN_M_S
        since_s = min(last.held_s, last.should_s)
        return {
            **vars(contact),
            "fast": contact.speed_m_s > SLOW_M_S,
            "avoidable": driven and contact.start_s - since_s > STOPS_S,
            "known": last.known,
        }

    def _should_hold(self, record: TickRecord) -> bool:
        """Whether the formula holds the arm, told the truth about the hand as late as the cell may know it."""
        assert self.cell.worker is not None
        seen, hand = record.observation, self.cell.worker.hand
        tips, palm = hand.position_m, hand.palm_m
        velocity = (0.0, 0.0)
        if self._hands:
            then_s, then = self._hands[-1]
            gone = np.array(palm[:2]) - np.array(then.palm_m)
            velocity = tuple(float(value) for value in gone / max(seen.time_s - then_s, 1e-3))  # type: ignore[assignment]
        spot = ((float(tips[0]), float(tips[1])), (float(palm[0]), float(palm[1])))
        sample = HandSample(seen.time_s, BOX, *spot, velocity_m_s=velocity, height_m=float(palm[2]))
        self._hands.append((seen.time_s, sample))
        late = [one for at, one in self._hands if at <= seen.time_s - LATE_S]
        joints = np.array(seen.arm.positions_rad)
        if not late or joints.shape != (6,) or not np.isfinite(joints).all():
            return False
        found = self.monitor.judge(joints, late[-1], LATE_S, seen.gripper.holding)
        return found.distance_m < found.least_m


def meet(
    path: Path, person: str, encounters: int, first_seed: int, tell: Callable[[str], None], *, rendered: bool = False
) -> dict[str, object]:
    """Assemble until so many times a hand went into the arm's way."""
    met = seeds = moved = 0
    rows: list[dict[str, object]] = []
    ends: dict[str, int] = {}
    while met < encounters:
        seed = first_seed + seeds
        with assembly(path, person, seed, rendered=rendered) as opened:
            cell, watch = opened.cell, Encounters(opened.cell, opened.motion.separation)
            outcome = opened.run([watch], None)
        assert cell.worker is not None
        assert cell.contacts is not None
        acts = sum(event.fields.get("act") == "intrude" for event in cell.worker.acts)
        found = [{"seed": seed, **watch.judge(one)} for one in cell.contacts.all()]
        rows += found
        met, seeds, moved = met + acts, seeds + 1, moved + watch.moved_while_unknown
        ends[outcome.end] = ends.get(outcome.end, 0) + 1
        tell(f"seed {seed}: {outcome.end} after {outcome.sim_time_s:.0f} s, {acts} encounters, {len(found)} contacts")
        for row in found:
            words = " FAST" * bool(row["fast"]) + " AVOIDABLE" * bool(row["avoidable"])
            tell(
                f"  {row['start_s']:.2f} s {row['robot']} and {row['human']}, first {row['first_m_s']:.2f}, "
                f"at most {row['speed_m_s']:.2f} m/s{words}; {row['known']}"
            )
        if not met and seeds > 5 * encounters:
            break
    return {
        "person": person,
        "assemblies": seeds,
        "ends": ends,
        "encounters": met,
        "contacts": len(rows),
        "contacts_fast": sum(bool(row["fast"]) for row in rows),
        "contacts_avoidable": sum(bool(row["avoidable"]) for row in rows),
        "fastest_m_s": round(max((float(str(row["speed_m_s"])) for row in rows), default=0.0), 3),
        "moved_while_unknown": moved,
        "pixels": rendered,
        "rows": rows,
    }


def throughput_ratio(path: Path, seeds: Iterable[int]) -> float | None:
    """Time for a bracket beside a careful person, with separation over without it, paired by seed."""
    table = load_faults(load_configuration(path))
    rows = [row.model_copy(update={"action": "run"}) if row.signal in OF_PERSON else row for row in table.faults]
    without = table.model_copy(update={"faults": tuple(rows)})
    times = [pair for seed in seeds if None not in (pair := (_time_s(path, seed, table), _time_s(path, seed, without)))]
    if not times:
        return None
    return round(sum(one or 0.0 for one, _ in times) / sum(other or 0.0 for _, other in times), 3)


def _time_s(path: Path, seed: int, table: FaultTable) -> float | None:
    """How long a bracket takes; None where none was finished."""
    with assembly(path, "careful", seed, table) as opened:
        outcome = opened.run([], None)
    return outcome.sim_time_s if outcome.end == "finished" else None
