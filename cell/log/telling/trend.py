"""How a shift went on: the time of each bracket as bars, and figures of several brackets in a row beside each other."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from statistics import mean
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from cell.log.telling.shift import BracketRow

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
        right: share of those that are known to be right or wrong; None where nobody knows.
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
        """Every so many bars there is room for a number below."""
        return next(each for each in (1, 2, 5, 10, 20, 50, 100, 1000) if len(self.bars) <= 30 * each)


def trend_of(brackets: Sequence[BracketRow]) -> Trend | None:
    """None where too few brackets ended."""
    ended = [one for one in brackets if one.finished is not None]
    if len(ended) < FEWEST:
        return None
    longest_s = max(one.length_s for one in ended)
    step, unit = WIDTH / len(ended), HEIGHT / max(longest_s, 1e-9)
    bars = [
        Bar(one, round(i * step, 1), round(step * (1 - GAP), 1), round(one.length_s * unit, 1), _waiting(one, unit))
        for i, one in enumerate(ended)
    ]
    size = max(SMALLEST_STRETCH, -(-len(ended) // MOST_STRETCHES))
    return Trend(bars, longest_s, [_stretch(ended[i : i + size]) for i in range(0, len(ended), size)])


def _waiting(one: BracketRow, unit: float) -> float:
    return round(min(one.waited_s, one.length_s) * unit, 1)


def _stretch(some: Sequence[BracketRow]) -> Stretch:
    known = [one.correct for one in some if one.correct is not None]
    return Stretch(
        some[0].number,
        some[-1].number,
        took_s=mean(one.length_s for one in some),
        waited_s=mean(one.waited_s for one in some),
        by_robot=mean(one.robot for one in some),
        questions=mean(len(one.questions) for one in some),
        right=mean(known) if known else None,
    )
