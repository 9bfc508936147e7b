"""Overall equipment effectiveness as ISO 22400-2 has it, for any brackets of the book.

availability   = APT / PBT: actual production time over planned busy time
effectiveness  = PRI PQ / APT: planned run time of what was produced over actual production time
quality ratio  = GQ / PQ: good quantity over what was inspected
OEE            = availability x effectiveness x quality ratio

PBT is the configured time of each day with a run, or else the time of the runs. APT is the time of brackets without
the waits in them, so each wait counts once, and time between brackets is no production. PRI is the configured ideal
cycle time of the variant. What is not configured or not inspected is not known, and then OEE is not known either.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from datetime import date, datetime

from bracket_cell.production.book import Book, BracketRow, RunRow


@dataclass(frozen=True)
class Effectiveness:
    """The times and counts that the shares are of.

    Attributes:
        planned_s: PBT.
        produced_s: APT.
        ideal_s: PRI x PQ; None where the ideal cycle time of a variant that was made is not configured.
        produced: PQ, brackets that ended finished.
        inspected: of them.
        good: of the inspected ones.
    """

    planned_s: float
    produced_s: float
    ideal_s: float | None
    produced: int
    inspected: int
    good: int

    @property
    def availability(self) -> float | None:
        return self.produced_s / self.planned_s if self.planned_s > 0 else None

    @property
    def effectiveness(self) -> float | None:
        return None if self.ideal_s is None or self.produced_s <= 0 else self.ideal_s / self.produced_s

    @property
    def quality(self) -> float | None:
        return self.good / self.inspected if self.inspected else None

    @property
    def oee(self) -> float | None:
        shares = (self.availability, self.effectiveness, self.quality)
        known = [share for share in shares if share is not None]
        return known[0] * known[1] * known[2] if len(known) == len(shares) else None

    @property
    def per_hour(self) -> float | None:
        """Brackets an hour of planned busy time."""
        return 3600 * self.produced / self.planned_s if self.planned_s > 0 else None


def effectiveness_of(runs: Iterable[RunRow], brackets: Iterable[BracketRow]) -> Effectiveness:
    """Of these runs and their brackets."""
    known, brackets = {run.id: run for run in runs}, list(brackets)
    produced = [bracket for bracket in brackets if bracket.finished]
    ideal = [known[row.run].ideal_s.get(row.variant) for row in produced]
    inspected = [row.correct for row in produced if row.correct is not None]
    return Effectiveness(
        planned_s=_planned_s(known.values()),
        produced_s=sum(max(0.0, bracket.length_s - bracket.waited_s) for bracket in brackets),
        ideal_s=None if None in ideal or not ideal else sum(ideal_s for ideal_s in ideal if ideal_s is not None),
        produced=len(produced),
        inspected=len(inspected),
        good=sum(inspected),
    )


def _planned_s(runs: Iterable[RunRow]) -> float:
    """Of each day the configured time, or the time of its runs."""
    days: dict[date, list[RunRow]] = {}
    for run in runs:
        days.setdefault(day_of(run), []).append(run)
    total_s = 0.0
    for some in days.values():
        planned = [run.planned_day_s for run in some if run.planned_day_s is not None]
        total_s += planned[-1] if planned else sum(run.seconds for run in some)
    return total_s


def day_of(run: RunRow) -> date:
    """The local day that a run began on."""
    return datetime.fromisoformat(run.began_utc).astimezone().date()


@dataclass(frozen=True)
class Period:
    """What was made in some time, and how well that time was used."""

    runs: Sequence[RunRow]
    brackets: Sequence[BracketRow]
    waits_s: Mapping[str, float]

    @staticmethod
    def of(book: Book, run: int | None = None) -> Period:
        """All of a book, or one run of it."""
        runs = [row for row in book.runs() if run in (None, row.id)]
        return Period(runs, book.brackets(run), book.waits_s(run))

    @property
    def whole(self) -> Effectiveness:
        """Of all of it."""
        return effectiveness_of(self.runs, self.brackets)

    @property
    def days(self) -> list[tuple[date, Effectiveness]]:
        """Day by day."""
        days: dict[date, list[RunRow]] = {}
        for run in self.runs:
            days.setdefault(day_of(run), []).append(run)
        found = []
        for day, runs in days.items():
            ids = {run.id for run in runs}
            found.append((day, effectiveness_of(runs, (bracket for bracket in self.brackets if bracket.run in ids))))
        return found
