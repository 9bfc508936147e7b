"""Assemblies beside a person who goes into the arm's way in every phase: contacts as they really were."""

from __future__ import annotations

from bisect import bisect_right
from collections import Counter, deque
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from cell.faults.injection import STATES, WorkState
from cell.files.row_store import Row
from cell.interfaces.faults import Action
from cell.interfaces.perception import HandSample
from cell.lab.assembly import assembly
from cell.watching.observer import Observer, TickRecord
from sim.cell import SimCell
from sim.truth.contacts import Contact
from skills.motion.separation import SeparationMonitor

SLOW_M_S = 0.25
DRIVEN_M_S = 0.05  # below this the arm stood, and the person touched it
STOPS_S = 0.35  # after this the arm stands that was told to hold
LATE_S = 0.15  # as late as answers about the hand come: half a frame's period, the detectors' time and a tick
BOX = (100, 100, 200, 200)
LATEST_S = 0.8  # after a phase began, a hand comes at the latest
RESTS_S = 1.0  # between two reaches into the arm's way


@dataclass(frozen=True)
class _Tick:
    """Since when the arm was held, and since when it should have been; infinite for not. What was known; the phase."""

    time_s: float
    held_s: float
    should_s: float
    known: str
    phase: str


@dataclass
class Encounters(Observer):
    """An observer that keeps what is needed to judge contacts afterwards.

    Attributes:
        moved_while_unknown: ticks in which the arm moved although it was not known where the hand is.
        acknowledged: how many times somebody acknowledged a trouble.
    """

    cell: SimCell
    monitor: SeparationMonitor
    moved_while_unknown: int = 0
    acknowledged: int = 0
    _ticks: list[_Tick] = field(default_factory=list)
    _hands: deque[tuple[float, HandSample]] = field(default_factory=lambda: deque(maxlen=16))
    _held_s: float = np.inf
    _should_s: float = np.inf
    _unknown_s: float = np.inf
    _work: WorkState = field(default_factory=WorkState)

    def tick(self, record: TickRecord) -> None:
        self._work.see(record)
        seen, judgement = record.observation, record.judgement
        now_s, bench = seen.time_s, seen.bench
        self.acknowledged += seen.acknowledged
        held = judgement is not None and judgement.action >= Action.HOLD
        self._held_s = min(self._held_s, now_s) if held else np.inf
        self._should_s = min(self._should_s, now_s) if self._should_hold(record) else np.inf
        unknown = bench is not None and bool(bench.hand_unknown)
        self._unknown_s = min(self._unknown_s, now_s) if unknown else np.inf
        self.moved_while_unknown += now_s - self._unknown_s > STOPS_S and not seen.arm.stands
        words = "" if judgement is None else judgement.words
        hand = "unknown" if unknown else "seen" if bench is not None and bench.hand is not None else "not seen"
        self._ticks.append(_Tick(now_s, self._held_s, self._should_s, f"hand {hand}; {words}", self._work.name))

    def phase(self, time_s: float) -> str:
        """Of the work at this time."""
        return self._at(time_s).phase

    def judge(self, contact: Contact) -> dict[str, object]:
        """A contact as a row: could the formula have avoided it, and what did the cell know."""
        last = self._at(contact.start_s)
        driven = contact.first_m_s > DRIVEN_M_S
        since_s = min(last.held_s, last.should_s)
        return {
            **vars(contact),
            "fast": contact.speed_m_s > SLOW_M_S,
            "avoidable": driven and contact.start_s - since_s > STOPS_S,
            "phase": last.phase,
            "known": last.known,
        }

    def _at(self, time_s: float) -> _Tick:
        """The last tick by then."""
        number = bisect_right([tick.time_s for tick in self._ticks], time_s)
        return self._ticks[number - 1] if number else _Tick(0.0, np.inf, np.inf, "", "start")

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


class Provocation(Observer):
    """An observer that sends the hand into the arm's way once in every phase of its work, and again when all were.

    A hand that is busy with a part is left alone.
    """

    def __init__(self, cell: SimCell, seed: int) -> None:
        self._cell, self._rng = cell, np.random.default_rng([seed, 11])
        self._work, self._phases = WorkState(), list(STATES)
        self._wait_s, self._since_s, self._last_s = 0.0, 0.0, -np.inf

    def tick(self, record: TickRecord) -> None:
        worker, now_s = self._cell.worker, record.observation.time_s
        self._work.see(record)
        if self._work.ticks == 0:  # a phase begins
            self._since_s, self._wait_s = now_s, float(self._rng.uniform(0.0, LATEST_S))
        if worker is None or worker.intruding:
            self._last_s = now_s
        elif (
            self._work.name in self._phases
            and now_s - self._since_s >= self._wait_s
            and now_s - self._last_s >= RESTS_S
            and not worker.busy
        ):
            self._phases.remove(self._work.name)
            self._phases = self._phases or list(STATES)
            worker.intrude()


def encounter(path: Path, tree: Path, person: str, seed: int, *, provoked: bool, rendered: bool = False) -> Row:
    """One assembly beside this person, with every encounter of hand and arm and every contact.

    Args:
        provoked: the person goes into the arm's way in every phase, whatever their habits are.
    """
    with assembly(path, person, seed, tree=tree, rendered=rendered) as opened:
        cell, watch = opened.cell, Encounters(opened.cell, opened.motion.separation)
        outcome = opened.run([watch, Provocation(cell, seed)] if provoked else [watch], None)
    assert cell.worker is not None
    assert cell.contacts is not None
    met = [act for act in cell.worker.acts if act.fields.get("act") == "intrude"]
    return {
        "kind": "assembly",
        "seed": seed,
        "end": outcome.end,
        "reason": outcome.reason,
        "sim_time_s": round(outcome.sim_time_s, 2),
        "encounters": len(met),
        "phases": [watch.phase(act.time_s) for act in met],
        "speeds_m_s": [round(float(str(act.fields["speed_m_s"])), 2) for act in met],
        "moved_while_unknown": watch.moved_while_unknown,
        "acknowledged": watch.acknowledged,
        "contacts": [{"seed": seed, **watch.judge(one)} for one in cell.contacts.all()],
    }


def summary(rows: Sequence[Row]) -> Row:
    """Counts of all assemblies."""
    rows = [row for row in rows if row["kind"] == "assembly"]
    contacts: list[Row] = [contact for row in rows for contact in row["contacts"]]
    phases = [str(phase) for row in rows for phase in row["phases"]]
    speeds = [float(speed) for row in rows for speed in row["speeds_m_s"]]
    return {
        "assemblies": len(rows),
        "ends": _counted([str(row["end"]) for row in rows]),
        "encounters": len(phases),
        "phases": _counted(phases),
        "fastest_hand_m_s": max(speeds, default=0.0),
        "contacts": len(contacts),
        "contacts_fast": sum(bool(one["fast"]) for one in contacts),
        "contacts_avoidable": sum(bool(one["avoidable"]) for one in contacts),
        "fastest_m_s": round(max((float(str(one["speed_m_s"])) for one in contacts), default=0.0), 3),
        "moved_while_unknown": sum(int(str(row["moved_while_unknown"])) for row in rows),
    }


def _counted(words: Sequence[str]) -> dict[str, int]:
    return dict(Counter(words).most_common())
