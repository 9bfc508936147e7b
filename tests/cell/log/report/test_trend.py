"""How a shift went on is told where enough brackets ended."""

from __future__ import annotations

import pytest

from bracket_cell.log.report.shift import HEIGHT, WIDTH, Shift, trend_of
from bracket_cell.production.book import BracketRow


def bracket(number: int, length_s: float = 60.0, **changes: object) -> BracketRow:
    row = BracketRow(number, 100.0 * number, 100.0 * number + length_s, finished=True, correct=True)
    for name, value in changes.items():
        setattr(row, name, value)
    return row


def test_a_few_brackets_have_no_trend() -> None:
    five = [bracket(i) for i in range(1, 6)]
    assert trend_of(five) is None
    assert trend_of([*five, bracket(6, finished=None)]) is None  # the log ends in it
    assert trend_of([*five, bracket(6)]) is not None


def test_bars_are_as_high_as_brackets_are_long_and_stand_side_by_side() -> None:
    trend = trend_of([bracket(i, 10.0 * i, waits_s={"help": 5.0 * i}) for i in range(1, 9)])
    assert trend is not None
    assert trend.longest_s == 80.0
    assert [bar.height for bar in trend.bars] == pytest.approx([HEIGHT * i / 8 for i in range(1, 9)], abs=0.1)
    assert [bar.waiting for bar in trend.bars] == pytest.approx([bar.height / 2 for bar in trend.bars], abs=0.1)
    ends = [bar.x + bar.width for bar in trend.bars]
    assert all(end < after.x for end, after in zip(ends, trend.bars[1:], strict=False))
    assert ends[-1] <= WIDTH


def test_stretches_cover_every_ended_bracket_once_and_tell_what_is_known() -> None:
    rows = [bracket(i, questions=["help"] * (i > 20), correct=None if i < 4 else i != 24) for i in range(1, 25)]
    trend = trend_of(rows)
    assert trend is not None
    assert [(stretch.first, stretch.last) for stretch in trend.stretches] == [
        (1, 4),
        (5, 8),
        (9, 12),
        (13, 16),
        (17, 20),
        (21, 24),
    ]
    assert [stretch.questions for stretch in trend.stretches] == [0, 0, 0, 0, 0, 1]
    assert [stretch.right for stretch in trend.stretches] == [1.0, 1.0, 1.0, 1.0, 1.0, 0.75]
    nobody_knows = trend_of([bracket(i, correct=None) for i in range(6)])
    assert nobody_knows is not None
    assert nobody_knows.stretches[0].right is None


def test_a_shift_has_its_trend() -> None:
    shift = Shift([], [bracket(i) for i in range(1, 8)], {})
    assert shift.trend is not None
    assert len(shift.trend.bars) == 7
    assert shift.trend.label_each == 1
