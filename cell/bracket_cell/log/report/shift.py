"""A shift as its log or the book of production has it: brackets, waits by their reason, how well the time was used."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from itertools import accumulate
from statistics import mean
from typing import Any

from bracket_cell.log.read.ticks import LoggedTick
from bracket_cell.production.book import Book, BracketRow, RunRow
from bracket_cell.production.bookkeeper import Bookkeeper, moment_of
from bracket_cell.production.effectiveness import Period

FEWEST = 6  # brackets from which on there is anything to tell
MOST_STRETCHES = 6
SMALLEST_STRETCH = 3
WIDTH, HEIGHT, GAP = 1100.0, 120.0, 0.2  # of the bars' drawing; the gap is a share of a bar


@dataclass(frozen=True)
class Bar:
    """One bracket: its time, and of it the time that the cell waited; places and lengths in the drawing's units."""

    bracket: BracketRow
    x: float
    width: float
    height: float
    waiting: float


@dataclass(frozen=True)
class Stretch:
    """Several brackets in a row; means for each bracket.

    Attributes:
        right: share of those that are known to be right or wrong; None if unknown.
    """

    first: int
    last: int
    took_s: float
    waited_s: float
    by_robot: float
    questions: float
    right: float | None


@dataclass(frozen=True)
class Trend:
    """Of a shift's ended brackets."""

    bars: list[Bar]
    longest_s: float
    stretches: list[Stretch]

    @property
    def label_each(self) -> int:
        """How many bars apart the numbers below may stand."""
        return next(each for each in (1, 2, 5, 10, 20, 50, 100, 1000) if len(self.bars) <= 30 * each)


def trend_of(brackets: Sequence[BracketRow]) -> Trend | None:
    """None where too few brackets ended."""
    ended = [bracket for bracket in brackets if bracket.finished is not None]
    if len(ended) < FEWEST:
        return None
    longest_s = max(row.length_s for row in ended)
    step, unit = WIDTH / len(ended), HEIGHT / max(longest_s, 1e-9)
    bars = [
        Bar(row, round(i * step, 1), round(step * (1 - GAP), 1), round(row.length_s * unit, 1), _waiting(row, unit))
        for i, row in enumerate(ended)
    ]
    size = max(SMALLEST_STRETCH, -(-len(ended) // MOST_STRETCHES))
    return Trend(bars, longest_s, [_stretch(ended[i : i + size]) for i in range(0, len(ended), size)])


def _waiting(row: BracketRow, unit: float) -> float:
    return round(min(row.waited_s, row.length_s) * unit, 1)


def _stretch(some: Sequence[BracketRow]) -> Stretch:
    known = [row.correct for row in some if row.correct is not None]
    return Stretch(
        some[0].number,
        some[-1].number,
        took_s=mean(row.length_s for row in some),
        waited_s=mean(row.waited_s for row in some),
        by_robot=mean(row.robot for row in some),
        questions=mean(len(row.questions) for row in some),
        right=mean(known) if known else None,
    )


@dataclass(frozen=True)
class Shift(Period):
    """Runs and their brackets, as a page shows them."""

    @property
    def trend(self) -> Trend | None:
        """How it went on; None where too few brackets ended."""
        return trend_of(self.brackets)

    @property
    def losses(self) -> list[tuple[str, float, float]]:
        """Reasons of waits with their seconds and the share of all until there: Pareto's table."""
        total_s = sum(self.waits_s.values())
        shares = accumulate(self.waits_s.values())
        return [(why, s, up_to / total_s) for (why, s), up_to in zip(self.waits_s.items(), shares, strict=True) if s]


def shift_of(book: Book) -> Shift:
    """All of a book."""
    whole = Period.of(book)
    return Shift(whole.runs, whole.brackets, whole.waits_s)


def shift_from(
    ticks: Iterable[LoggedTick], facts: Callable[[], Mapping[str, str]], result: Callable[[], Mapping[str, str]]
) -> Bookkeeper:
    """The book that a run would have written, from its log.

    Args:
        ticks: are read once.
        facts: the log's metadata; asked for at the first tick.
        result: how the job was done; asked for after the last of them.
    """
    keeper = None
    for tick in ticks:
        keeper = keeper or Bookkeeper(Book(), _row(facts()))
        keeper.take(moment_of(tick))
    keeper = keeper or Bookkeeper(Book(), RunRow(""))
    keeper.end("")
    judged = _list(result().get("brackets", ""))
    known = {bracket.get("number"): bracket for bracket in judged if isinstance(bracket, dict)}
    keeper.judge([known.get(row.number, {}) for row in keeper.rows])
    return keeper


def _row(facts: Mapping[str, str]) -> RunRow:
    try:
        counts = json.loads(facts.get("production", "{}"))
        ideal_s = {str(name): float(time_s) for name, time_s in counts.get("ideal_cycle_s", {}).items()}
        planned_s = counts.get("planned_day_s")
        planned_day_s = None if planned_s is None else float(planned_s)
    except (ValueError, TypeError, AttributeError):  # a log of a stranger
        ideal_s, planned_day_s = {}, None
    began = facts.get("started_utc", "")
    return RunRow("", facts.get("product", ""), facts.get("tree", ""), "", began, 0.0, ideal_s, planned_day_s)


def _list(text: str) -> list[Any]:
    try:
        rows = json.loads(text or "[]")
    except ValueError:
        return []
    return rows if isinstance(rows, list) else []
