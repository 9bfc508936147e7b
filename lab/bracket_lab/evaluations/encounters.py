"""Assemblies beside a person who goes into the arm's way in every phase: contacts and distances as they really were.

The judge is an oracle of its own. It knows the simulator's truth and the protective distance of ISO/TS 15066 with a
constant speed of the hand; it asks nothing of what the cell works out.
"""

from __future__ import annotations

from bisect import bisect_right
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from enum import StrEnum
from pathlib import Path

import numpy as np

from bracket_cell.skills.motion.contact import CONTACT, ContactMap
from bracket_cell.watching.observer import Observer, TickRecord
from bracket_cell.watching.work_state import STATES, WorkState
from bracket_ground.files.row_store import Row
from bracket_ground.interfaces.operator import OperatorOrder
from bracket_ground.interfaces.perception import HandSample
from bracket_lab.evaluations.assembly import assembly
from bracket_lab.evaluations.danger import BRAKES_M_S2, DRIVEN_M_S, HANDS_M_S, REACTS_S, TrueDistance
from bracket_sim.cell import SimCell
from bracket_sim.truth.contacts import Contact

REDUCED_M_S = 0.25
UNKNOWN_S = 0.35  # after this the arm stands that was told to hold
LATEST_S = 0.8  # after a phase began, a hand comes at the latest
RESTS_S = 1.0  # between two reaches into the arm's way
STOOD_S = 60.0  # an arm that stood for so long meets nobody any more
OFF_M = 0.05
MOVING_SHARE = 0.05  # of the encounters: contacts with an arm that moves; none where the tracker errs


class Tracker(StrEnum):
    """How the hand tracker errs."""

    true = "true"
    blind = "blind"
    half = "half"
    off = "off"

    def spoil(self, hand: HandSample | None, rng: np.random.Generator) -> HandSample | None:
        """What it tells of a hand: nothing, half of the time nothing, or nearer to the person than the hand is."""
        lost = self is Tracker.blind or (self is Tracker.half and rng.random() < 0.5)
        if hand is None or lost:
            return None
        x_m = OFF_M * (self is Tracker.off)
        tips, palm = ((x + x_m, y) for x, y in (hand.fingertips_m, hand.palm_m))
        return replace(hand, fingertips_m=tips, palm_m=palm)


@dataclass(frozen=True)
class _Tick:
    """Which distances of HANDS_M_S were kept; since when not, infinite for kept. What was known; the phase."""

    time_s: float
    breached_s: tuple[float, ...]
    known: str
    phase: str


@dataclass
class Encounters(Observer):
    """An observer that keeps what is needed to judge contacts afterwards.

    Attributes:
        contacts: where the arm could clamp a hand.
        moved_while_unknown: ticks in which the arm moved although it was not known where the hand is.
        breached: ticks in which a link moved nearer than the protective distance, for each of HANDS_M_S.
        acknowledged: how many times somebody acknowledged a trouble.
        stood: the arm stood for STOOD_S; then somebody stops the run.
    """

    cell: SimCell
    contacts: ContactMap
    moved_while_unknown: int = 0
    acknowledged: int = 0
    stood: bool = False
    _moved_s: float = 0.0
    _ticks: list[_Tick] = field(default_factory=list)
    _unknown_s: float = np.inf
    _work: WorkState = field(default_factory=WorkState)

    def __post_init__(self) -> None:
        self._truth = TrueDistance(self.cell)
        self._since_s = np.full(len(HANDS_M_S), np.inf)
        self.breached = np.zeros(len(HANDS_M_S), dtype=int)

    def tick(self, record: TickRecord) -> None:
        self._work.see(record)
        seen, judgement = record.observation, record.judgement
        now_s, bench = seen.time_s, seen.bench
        self.acknowledged += seen.acknowledged
        self._moved_s = self._moved_s if seen.arm.stands else now_s
        self.stood = now_s - self._moved_s > STOOD_S
        breached = np.array(self._truth.breached())
        self.breached += breached
        self._since_s = np.where(breached, np.minimum(self._since_s, now_s), np.inf)
        unknown = bench is not None and bool(bench.hand_unknown)
        self._unknown_s = min(self._unknown_s, now_s) if unknown else np.inf
        self.moved_while_unknown += now_s - self._unknown_s > UNKNOWN_S and not seen.arm.stands
        words = "" if judgement is None else judgement.words
        hand = "unknown" if unknown else "seen" if bench is not None and bench.hand is not None else "not seen"
        self._ticks.append(_Tick(now_s, tuple(self._since_s), f"hand {hand}; {words}", self._work.name))

    def pressed(self) -> Sequence[OperatorOrder]:
        """By somebody at the bench."""
        return (OperatorOrder("stop"),) if self.stood else ()

    def phase(self, time_s: float) -> str:
        """Of the work at this time."""
        return self._at(time_s).phase

    def judge(self, contact: Contact) -> dict[str, object]:
        """A contact as a row: did the arm move, would one that keeps its distance have stood, could it clamp the hand.

        Its force is "over" the limit where it is more than ISO/TS 15066 has for a hand there.
        """
        last, moving = self._at(contact.start_s), bool(contact.first_m_s > DRIVEN_M_S)
        clamped = self.contacts.clamps(np.array(contact.point_m))
        stood_s = contact.start_s - REACTS_S - contact.first_m_s / BRAKES_M_S2  # an arm that was told by then
        return {
            **vars(contact),
            "moving": moving,
            "clamped": clamped,
            "over": bool(contact.force_n > (CONTACT.clamped_n if clamped else CONTACT.free_n)),
            "fast": bool(contact.speed_m_s > REDUCED_M_S),
            **{
                f"avoidable_{hand_m_s}": bool(moving and since_s < stood_s)
                for hand_m_s, since_s in zip(HANDS_M_S, last.breached_s, strict=True)
            },
            "phase": last.phase,
            "known": last.known,
        }

    def _at(self, time_s: float) -> _Tick:
        """The last tick by then."""
        number = bisect_right([tick.time_s for tick in self._ticks], time_s)
        return self._ticks[number - 1] if number else _Tick(0.0, (np.inf,) * len(HANDS_M_S), "", "start")


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


def encounter(
    path: Path,
    tree: Path,
    person: str,
    seed: int,
    *,
    provoked: bool,
    rendered: bool = False,
    tracker: Tracker = Tracker.true,
) -> Row:
    """One assembly beside this person, with every encounter of hand and arm and every contact.

    Args:
        provoked: the person goes into the arm's way in every phase, whatever their habits are.
        tracker: other than the true one without images only.
    """
    with assembly(path, person, seed, tree=tree, rendered=rendered) as opened:
        cell, watch, rng = (
            opened.cell,
            Encounters(opened.cell, opened.motion.separation.contacts),
            np.random.default_rng([seed, 12]),
        )
        if cell.sight is not None:
            cell.sight.spoil = lambda hand: tracker.spoil(hand, rng)
        cell.devices = replace(cell.devices, pressed=watch.pressed)
        outcome = opened.run([watch, Provocation(cell, seed)] if provoked else [watch], None)
    assert cell.worker is not None
    assert cell.contacts is not None
    met = [act for act in cell.worker.acts if act.fields.get("act") == "intrude"]
    return {
        "seed": seed,
        "end": "stood" if watch.stood else outcome.end,
        "reason": f"the arm stood for {STOOD_S:g} s" if watch.stood else outcome.reason,
        "sim_time_s": round(outcome.sim_time_s, 2),
        "encounters": len(met),
        "phases": [watch.phase(act.time_s) for act in met],
        "speeds_m_s": [round(float(str(act.fields["speed_m_s"])), 2) for act in met],
        "moved_while_unknown": watch.moved_while_unknown,
        "breached": watch.breached.tolist(),
        "acknowledged": watch.acknowledged,
        "contacts": [{"seed": seed, **watch.judge(contact)} for contact in cell.contacts.all()],
    }


def summary(rows: Sequence[Row]) -> Row:
    """Counts of all assemblies."""
    contacts: list[Row] = [contact for row in rows for contact in row["contacts"]]
    moving = [contact for contact in contacts if contact["moving"]]
    phases = [str(phase) for row in rows for phase in row["phases"]]
    speeds = [float(speed) for row in rows for speed in row["speeds_m_s"]]
    return {
        "assemblies": len(rows),
        "ends": _counted([str(row["end"]) for row in rows]),
        "sim_time_s": round(sum(float(str(row["sim_time_s"])) for row in rows), 2),
        "encounters": len(phases),
        "phases": _counted(phases),
        "fastest_hand_m_s": max(speeds, default=0.0),
        "contacts": len(contacts),
        "contacts_moving": len(moving),
        "contacts_fast": sum(bool(row["fast"]) for row in contacts),
        **{
            f"contacts_avoidable_{speed}": sum(bool(row[f"avoidable_{speed}"]) for row in contacts)
            for speed in HANDS_M_S
        },
        "ticks_breached": {str(speed): sum(row["breached"][n] for row in rows) for n, speed in enumerate(HANDS_M_S)},
        "fastest_m_s": round(_most(contacts, "speed_m_s"), 3),
        "force_n": round(_most(contacts, "force_n")),
        **{
            f"force_moving_{where}_n": round(_most([row for row in moving if row["clamped"] is clamped], "force_n"))
            for where, clamped in (("clamped", True), ("free", False))
        },
        "contacts_moving_over": sum(bool(row["over"]) for row in moving),
        "moved_while_unknown": sum(int(str(row["moved_while_unknown"])) for row in rows),
    }


def passed(found: Row, tracker: Tracker = Tracker.true) -> bool:
    """Whether no contact was fast, or of a moving arm with too much force; and hardly any was with one at all.

    And nothing moved while too little was known.

    Args:
        found: of `summary`.
    """
    share = MOVING_SHARE if tracker is Tracker.true else 0.0
    few = found["contacts_moving"] <= share * found["encounters"]
    none = ("contacts_fast", "contacts_moving_over", "moved_while_unknown")
    return bool(few and not any(found[name] for name in none))


def _most(contacts: Sequence[Row], name: str) -> float:
    return max((float(str(contact[name])) for contact in contacts), default=0.0)


def _counted(words: Sequence[str]) -> dict[str, int]:
    return dict(Counter(words).most_common())
