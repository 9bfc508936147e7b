"""Faults at random: a kind in a signal, at a moment of a pick and place; judged from the truth as IEC 61508 has it.

A fault is dangerous if it does harm where the supervisor is blind. It is detected if a supervisor that sees notices it
in time. A run splits for both as in `bracket_lab.evaluations.faults`. Somebody presses pause after the fault, as
each hold proves that orders are obeyed, and lets the cell go on a second later; at last the run is stopped.

Every second run has faults in what detectors answer, and a person: instead of the pause, a hand goes into the arm's
way, as that proves that hands are seen. A blind supervisor still keeps the distance to what it is told of hands. What
comes after arm and hand have touched does not count: a hand that pushes an arm looks like a fault.
"""

from __future__ import annotations

import math
import os
import signal
from collections import Counter
from collections.abc import Callable, Container, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from bracket_cell.configuration import DEFAULT_TREE
from bracket_cell.fleet.intervals import wilson
from bracket_cell.running.supervisor import PAUSED, Supervisor, make_supervisor
from bracket_cell.skills.motion.planner import MotionPlanner
from bracket_cell.watching.observer import Observer, Outcome, TickRecord
from bracket_ground.files.row_store import Row
from bracket_ground.interfaces.devices import Devices
from bracket_ground.interfaces.faults import USUAL, Action, FaultTable
from bracket_ground.interfaces.operator import OperatorOrder
from bracket_lab.evaluations.assembly import OF_PERSON, assembly
from bracket_lab.evaluations.danger import DRIVEN_M_S, PART_FELL, Danger
from bracket_lab.evaluations.evidence import Evidence
from bracket_lab.evaluations.faults import Fork, trial
from bracket_sim.cell import SimCell
from bracket_sim.faults.signal_faults import DETECTED, SIGNALS, drawn_fault

EACH = 20  # faults that one run splits for; one more has none
TICKS = (30, 360)  # of a run, when a fault comes
PAUSED_S, PAUSES_S, ENDS_S = 1.0, (0.6, 2.5), 6.0
REACTS_S = 1.0  # so long after it was noticed a trial goes on: the arm stands by then
NOTICED_TICKS, FURTHER_M = 5, 0.10
NONE = "none"
PERSON = "careful"
OTHER_WORDS = (PAUSED, "hand_near", "hand_too_near", *USUAL)  # no sign of a fault


@dataclass(frozen=True)
class Drawn:
    """One trial.

    Attributes:
        number: of all; a fault follows from it and the first seed.
        fault: as `SignalFault.parse` reads it; NONE for the trial without one.
        tick: in which it comes.
        pause_s: so long after it somebody presses pause, or a hand comes.
    """

    number: int
    fault: str
    tick: int
    pause_s: float

    @property
    def beside(self) -> bool:
        """Whether a person is at the bench, and the fault is one of a detector's answers."""
        return self.number // (EACH + 1) % 2 == 1

    @staticmethod
    def by_number(number: int, first_seed: int, joints: int = 6) -> Drawn:
        """The trial of this number; the last of each run has no fault."""
        rng = np.random.default_rng([first_seed, number])
        signals = DETECTED if Drawn(number, NONE, 0, 0.0).beside else SIGNALS
        fault, tick = drawn_fault(rng, signals, joints), int(rng.integers(*TICKS))
        name = NONE if number % (EACH + 1) == EACH else fault.name
        return Drawn(number, name, tick, float(rng.uniform(*PAUSES_S)))


class Watch(Observer):
    """Sees one trial with the eyes of the evidence, the truth and the supervisor.

    Attributes:
        signal: by which the supervisor noticed it first; empty for never.
        noticed_s: when.
        held_before: a part was between the fingers when the fault came.
    """

    def __init__(self, evidence: Evidence, danger: Danger, cell: SimCell) -> None:
        self.evidence, self.danger, self._cell = evidence, danger, cell
        self.signal, self.noticed_s = "", math.inf
        self.began_s = self._ended_s = self.touched_s = math.inf
        self._due, self._comes_s = [math.inf, math.inf], math.inf
        self._times_s: list[float] = []
        self.held_before = False

    def begin(self, time_s: float, drawn: Drawn) -> None:
        """The fault comes."""
        self.began_s, due_s = time_s, time_s + drawn.pause_s
        if drawn.beside:
            self._comes_s = due_s
        else:
            self._due = [due_s, due_s + PAUSED_S]
        self.danger.paused_s, self.danger.resumed_s = self._due
        self.evidence.begin()
        self.danger.begin(holding=self.held_before)
        self._times_s.clear()

    def presses(self, now_s: float) -> Sequence[OperatorOrder]:
        """What is pressed now."""
        due = [number for number, when_s in enumerate(self._due) if when_s <= now_s]
        for number in due:
            self._due[number] = math.inf
        return tuple((OperatorOrder("pause", "now"), OperatorOrder("resume"))[number] for number in due)

    def tick(self, record: TickRecord) -> None:
        time_s, judgement = record.observation.time_s, record.judgement
        if time_s >= self._comes_s and self._cell.worker is not None:
            self._comes_s = math.inf
            self._cell.worker.intrude()
        self._touch()
        if self.began_s == math.inf:
            self.held_before = record.observation.gripper.holding
        self._times_s.append(time_s)
        if record.status != "STOPPING":
            self._ended_s = time_s
        over = record.status == "STOPPING" or self.touched_s < math.inf
        if judgement is None or self.signal or over or not self.began_s < time_s:
            return
        signals = [name for name, _ in judgement.reasons if name not in OTHER_WORDS]
        if signals and judgement.action >= Action.WARN:
            self.signal, self.noticed_s = signals[0], time_s

    def _touch(self) -> None:
        """Arm and hand touch: the trial is over, and dangerous where the arm moved."""
        contacts = [] if self._cell.contacts is None else self._cell.contacts.all()
        first = next((contact for contact in contacts if contact.start_s >= self.began_s), None)
        if first is None or self.touched_s < math.inf:
            return
        self.touched_s = first.start_s
        for judge in (self.evidence, self.danger):
            if judge.time_s > self.touched_s:
                judge.words, judge.time_s = "", math.inf
        if first.first_m_s > DRIVEN_M_S and not self.danger.words:
            self.danger.words = f"the arm touches a person at {first.first_m_s:.2f} m/s"
            self.danger.time_s = self.touched_s

    def close(self, outcome: Outcome) -> None:
        if not self.signal and outcome.end in ("fault", "failed"):
            self.signal, self.noticed_s = outcome.end, self._ended_s

    def row(self, fork: Fork, outcome: Outcome | None = None) -> Row:
        """What came of it; without an outcome the trial was broken off."""
        evidence, danger = self.evidence, self.danger
        if outcome is not None:
            placed = any(
                placement.seated and placement.by == "robot" for placement in self._cell.score.placements().values()
            )
            danger.at_end(outcome, placed=placed)
        noticed_s = min(self.noticed_s, self.began_s + ENDS_S)
        ticks = sum(evidence.time_s <= time_s <= self.noticed_s for time_s in self._times_s)
        return {
            "fault": fork.fault or NONE,
            "seed": fork.seed,
            "state": fork.state,
            "shown_by": evidence.words,
            "shown_s": self._since(evidence.time_s),
            "danger": danger.words,
            "danger_s": self._since(danger.time_s),
            "noticed_by": self.signal,
            "noticed_s": self._since(self.noticed_s),
            "ticks": ticks if self.signal else -1,
            "further_m": round(danger.between_m(evidence.time_s, noticed_s), 3),
            "way_m": round(danger.between_m(self.began_s, math.inf), 3),
            "end": outcome.end if outcome else "",
            "reason": outcome.reason if outcome else "",
            "condition": outcome.condition if outcome else "",
        }

    def _since(self, time_s: float) -> float | None:
        """After the fault."""
        return round(time_s - self.began_s, 2) if math.isfinite(time_s) else None


class Blindable(Supervisor):
    """A supervisor that can be blinded: then it heeds a person's orders, and the rows that are left.

    Attributes:
        blind: it is.
    """

    def __init__(self, sees: Supervisor) -> None:
        vars(self).update(vars(sees))
        self.blind = False

    def lose(self, left: Container[str]) -> None:
        """Lose all rows but those of the signals that are left."""
        self.blind, self._rows = True, [row for row in self._rows if row[0].signal in left]


class Splitting(Fork):
    """Splits a run at the ticks of its trials, for those that are noticed once more with a blind supervisor.

    It is also somebody at the bench who presses pause and resume.

    Attributes:
        left: trials that did not come so far.
        now: the trial of this process.
        supervisor: of the run.
    """

    def __init__(self, trials: Sequence[Drawn], seed: int, watch: Watch, tell: Callable[[Row], None]) -> None:
        super().__init__("idle", seed)
        self.left = sorted(trials, key=lambda drawn: drawn.tick)
        self.now = Drawn(-1, NONE, 0, math.inf)
        self.supervisor: Blindable | None = None
        self._watch, self._tell, self._ticks, self._over = watch, tell, 0, False

    def supervised(self, table: FaultTable, motion: MotionPlanner) -> Supervisor:
        """The usual one, until it is blinded."""
        self.supervisor = Blindable(make_supervisor(table, motion))
        return self.supervisor

    def devices(self, devices: Devices) -> Devices:
        """Also with what is pressed."""
        return super().devices(replace(devices, pressed=lambda: self._watch.presses(self.now_s())))

    def tick(self, record: TickRecord) -> None:
        """At the tick of a trial processes go on with it; they are stopped a while later."""
        self._work.see(record)
        self._ticks += 1
        time_s = record.observation.time_s
        while self.began_s is None and self.left and self._ticks >= self.left[0].tick:
            self._try(self.left.pop(0), time_s)
        if self.began_s is None:
            if not self.left and not self._over:  # all are told: how it would have gone on is of no interest
                self._over = True
                os.kill(os.getpid(), signal.SIGTERM)
            return
        watch = self._watch
        over = time_s - watch.noticed_s > REACTS_S or watch.touched_s <= time_s
        if over or (self._blind and watch.danger.words):
            self.reply(watch.row(self))  # how it goes on adds nothing
        if ENDS_S <= time_s - self.began_s < ENDS_S + 0.1:
            os.kill(os.getpid(), signal.SIGTERM)

    @property
    def _blind(self) -> bool:
        return self.supervisor is not None and self.supervisor.blind

    def _try(self, drawn: Drawn, time_s: float) -> None:
        """In the parent: tell what comes of it; what is noticed is tried once more, blind."""
        self.state = self._work.name
        row = self._split(drawn, time_s, blind=False)
        if row is None:
            return
        row["harm"] = row["danger"]
        if row["noticed_by"] and not row["danger"]:
            unnoticed = self._split(drawn, time_s, blind=True)
            if unnoticed is None:
                return
            row |= {name: unnoticed.get(name) for name in ("danger", "danger_s")}
        row = {"number": drawn.number, "tick": drawn.tick, "reached": True, **row}
        self._tell({**row, "judged": judged(row)})

    def _split(self, drawn: Drawn, time_s: float, *, blind: bool) -> Row | None:
        """As `split`; the child begins the trial."""
        row = self.split(drawn.fault)
        if row is None:
            assert self.supervisor is not None
            if blind:
                self.supervisor.lose(OF_PERSON if drawn.beside else ())
            self.now, self.left = drawn, []
            self.begin("" if drawn.fault == NONE else drawn.fault, time_s)
            self._watch.begin(time_s, drawn)
        return row


def drawn_rows(path: Path, trials: Sequence[Drawn], seed: int, tell: Callable[[Row], None]) -> None:
    """Tell how each trial ended, from one run that splits."""
    lead: list[Splitting] = []
    supervised: Any = lambda *parts: lead[0].supervised(*parts)  # noqa: E731
    beside = partial(assembly, path, PERSON, seed, tree=DEFAULT_TREE, depth=True)
    with (beside if trials[0].beside else partial(trial, path, seed))(supervised=supervised) as opened:
        watch = Watch(
            Evidence(opened.cell.world.robot.gripper.stroke_m), Danger(opened.cell, opened.motion), opened.cell
        )
        fork = Splitting(trials, seed, watch, tell)
        lead.append(fork)
        outcome = opened.run([watch.evidence, watch.danger, watch], fork)
        if fork.child:
            fork.reply(watch.row(fork, outcome))
    for drawn in fork.left:
        tell({"number": drawn.number, "fault": drawn.fault, "seed": seed, "reached": False, "judged": "not reached"})


def drawn_list(path: Path, trials: Sequence[Drawn], seed: int) -> list[Row]:
    """The rows that `drawn_rows` tells."""
    rows: list[Row] = []
    drawn_rows(path, trials, seed, rows.append)
    return rows


def judged(row: Row) -> str:
    """Dangerous or safe, detected or undetected, in time or late; and whether any signal could show it."""
    noticed = bool(row["noticed_by"])
    if not row["danger"]:
        return "safe detected" if noticed else "safe undetected"
    if noticed:
        early = row["danger_s"] is None or row["noticed_s"] <= row["danger_s"]  # there is no harm so far
        in_time = row["ticks"] <= NOTICED_TICKS and row["further_m"] <= FURTHER_M
        return "dangerous detected" if early or in_time else "dangerous detected late"
    return "dangerous undetected" if row["shown_by"] else "dangerous undetected, shown by nothing"


def coverage(rows: Sequence[Row]) -> Row:
    """Of all trials: how many of each kind, and the diagnostic coverage: the share of dangerous ones that is detected.

    What is noticed too late counts as undetected. `kept`: no dangerous one that a signal shows is undetected or late,
    and a cell without a fault is left alone.
    """
    faults = [row for row in rows if row["reached"] and row["fault"] != NONE]
    sound = [row for row in rows if row["reached"] and row["fault"] == NONE]
    found = Counter(str(row["judged"]) for row in faults)
    detected = found["dangerous detected"]
    dangerous = sum(count for name, count in found.items() if name.startswith("dangerous"))
    could = dangerous - found["dangerous undetected, shown by nothing"]
    seen = [row for row in faults if row["noticed_by"] and row["shown_by"]]
    grave = [row for row in seen if row["danger"]]
    alarms = sum(map(_alarmed, sound))
    return {
        "faults": len(faults),
        "not_reached": sum(not row["reached"] for row in rows),
        **{name: found[name] for name in sorted(found)},
        "coverage": _share(detected, dangerous),
        "coverage_of_shown": _share(detected, could),
        "dangerous_most_ticks": max((row["ticks"] for row in grave), default=0),
        "dangerous_most_further_m": max((row["further_m"] for row in grave), default=0.0),
        "noticed_within_ticks": _share(sum(row["ticks"] <= NOTICED_TICKS for row in seen), len(seen)),
        "parts_that_fell": sum(row.get("harm") == PART_FELL for row in faults),
        "without_fault": len(sound),
        "without_fault_alarms": alarms,
        "kept": detected == could and not alarms,
    }


def _alarmed(row: Row) -> bool:
    return bool(row["noticed_by"] or row["shown_by"] or row["danger"])


def _share(right: int, count: int) -> str:
    low, _, high = wilson(right, count)
    return f"{right} of {count}, 95 % {low:.3f} to {high:.3f}"


def missing(faults: int, first_seed: int, done: Container[int], joints: int = 6) -> list[tuple[list[Drawn], int]]:
    """Trials that still have to be run, with the seed of the run that splits for them."""
    left: dict[int, list[Drawn]] = {}
    for number in range(faults + faults // EACH):
        if number not in done:
            drawn = Drawn.by_number(number, first_seed, joints)
            left.setdefault(first_seed + number // (EACH + 1), []).append(drawn)
    return [(trials, seed) for seed, trials in left.items()]


def words_of(row: Row) -> str:
    """A row for people."""
    fields = {"shown": "shown_by", "danger": "danger", "noticed": "noticed_by"}
    parts = [f"{word} {row[f'{name}_s']} s: {row[by]}" for word, by in fields.items() if row.get(by) for name in [word]]
    return f"{row['number']} {row['fault']} @ {row.get('state', '')}: {row['judged']}; {'; '.join(parts)}"
