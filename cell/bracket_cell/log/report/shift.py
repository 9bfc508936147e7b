"""A shift as its log records it: brackets, who placed what, waits by their reason, and how well the time was used.

OEE (overall equipment effectiveness) is availability x performance x quality, here:
availability: share of the shift in which no question stood and nothing held the cell;
performance: time of the quickest finished bracket over the mean time of a finished one;
quality: share of the ended brackets in which every hole was seen filled, or of those that are right where it is known.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from statistics import mean
from typing import Any

from bracket_cell.log.read.ticks import LoggedTick
from bracket_ground.interfaces.faults import Action

FEWEST = 6  # brackets from which on there is anything to tell
MOST_STRETCHES = 6
SMALLEST_STRETCH = 3
WIDTH, HEIGHT, GAP = 1100.0, 120.0, 0.2  # of the bars' drawing; the gap is a share of a bar
HOLDS = (Action.HOLD.name, Action.STOP.name)
BESIDE_WORK = ("bracket", "mend")  # kinds of questions that hold nothing up by themselves


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


@dataclass
class BracketRow:
    """One bracket of a shift.

    Attributes:
        finished: every hole was seen filled when it ended; None where the log ends before.
        goal: that it was learned to be, or as it was judged.
        correct: None if unknown.
        placed: who did it, by position; a hole that is seen filled with what the robot fetched for it is the robot's.
        fetched: type of the part that the robot fetched last for a position.
        questions: what was asked, in words.
        waits_s: seconds by reason in which the cell was held, or a question stood.
        known_wrong: holes that the cell knew to be wrong when it ended.
        order: id of the work order that it was made for; empty for none.
    """

    number: int
    begin_s: float
    end_s: float
    finished: bool | None = None
    goal: str = ""
    correct: bool | None = None
    placed: dict[str, str] = field(default_factory=dict)
    fetched: dict[str, str] = field(default_factory=dict)
    questions: list[str] = field(default_factory=list)
    waits_s: dict[str, float] = field(default_factory=dict)
    known_wrong: list[str] = field(default_factory=list)
    order: str = ""

    @property
    def length_s(self) -> float:
        return self.end_s - self.begin_s

    @property
    def robot(self) -> int:
        return sum(who == "robot" for who in self.placed.values())

    @property
    def person(self) -> int:
        return len(self.placed) - self.robot

    @property
    def waited_s(self) -> float:
        return sum(self.waits_s.values())


@dataclass(frozen=True)
class Shift:
    """All brackets of a log, and what follows from them; see the module for OEE."""

    brackets: list[BracketRow]
    availability: float
    performance: float
    quality: float

    @property
    def oee(self) -> float:
        return self.availability * self.performance * self.quality

    @property
    def trend(self) -> Trend | None:
        """How it went on; None where too few brackets ended."""
        return trend_of(self.brackets)

    @property
    def waits_s(self) -> list[tuple[str, float]]:
        """Seconds by reason, the longest first."""
        total: dict[str, float] = {}
        for reason, length_s in (wait for bracket in self.brackets for wait in bracket.waits_s.items()):
            total[reason] = total.get(reason, 0.0) + length_s
        return sorted(total.items(), key=lambda wait: -wait[1])


def shift_from(ticks: Iterable[LoggedTick], result: Callable[[], Mapping[str, str]]) -> Shift | None:
    """The shift that a log records; None where its tree named no brackets.

    Args:
        ticks: are read once.
        result: how the job was done; asked for after the last of them.
    """
    brackets = _brackets(ticks)
    if not brackets:
        return None
    _judge(result(), brackets)
    ended = [one for one in brackets if one.finished is not None]
    lengths = [one.length_s for one in ended if one.finished]
    worked_s = sum(one.length_s for one in brackets)
    good = sum(bool(one.finished) and one.correct is not False for one in ended)
    return Shift(
        brackets,
        availability=1 - sum(one.waited_s for one in brackets) / worked_s if worked_s > 0 else 0.0,
        performance=min(lengths) * len(lengths) / sum(lengths) if lengths else 0.0,
        quality=good / len(ended) if ended else 0.0,
    )


def _brackets(ticks: Iterable[LoggedTick]) -> list[BracketRow]:
    found: list[BracketRow] = []
    asked: list[Any] = []
    before_s = 0.0
    for tick in ticks:
        if found and found[-1].finished is None:
            found[-1].end_s = tick.time_s
            if reason := _waits_for(tick, asked):
                waits_s = found[-1].waits_s
                waits_s[reason] = waits_s.get(reason, 0.0) + tick.time_s - before_s
        before_s = tick.time_s
        if tick.display is not None:
            asked = list(tick.display.get("questions") or ())
        for topic, fields in tick.notes:
            _note(topic, fields, tick, found)
    return found


def _waits_for(tick: LoggedTick, asked: list[Any]) -> str:
    """What the cell waits for in a tick; empty where it does not."""
    judgement = tick.judgement or {}
    if judgement.get("action") in HOLDS and judgement.get("reasons"):
        return str(judgement["reasons"][0]["words"])
    return next((str(one["reason"]) for one in asked if one["kind"] not in BESIDE_WORK), "")


def _note(topic: str, fields: Any, tick: LoggedTick, found: list[BracketRow]) -> None:
    going_on = bool(found) and found[-1].finished is None and found[-1].number == fields.get("number")
    if topic == "bracket" and fields["edge"] == "begin" and not going_on:
        found.append(BracketRow(fields["number"], tick.time_s, tick.time_s))
    if not found or found[-1].finished is not None:
        return
    now = found[-1]
    if topic == "bracket":
        now.order = str(fields.get("order") or now.order)
    if topic == "bracket" and fields["edge"] == "end":
        now.end_s, now.finished, now.goal = tick.time_s, fields["finished"], fields.get("goal") or ""
        now.known_wrong = list(fields.get("known_wrong") or ())
    elif topic == "belief" and fields.get("edge"):
        part, position = fields["edge"]
        if part is None:
            now.placed.pop(position, None)
        else:
            mine = fields.get("source") == "robot" or now.fetched.get(position) == part
            now.placed[position] = "robot" if mine and fields.get("source") != "action" else "person"
    elif topic == "verdict" and fields.get("decision") == "act":
        part, _, position = str(fields.get("subject")).partition(" at ")
        now.fetched[position] = part
    elif topic == "help":
        now.questions.append(str(fields.get("text")))


def _judge(result: Mapping[str, str], brackets: list[BracketRow]) -> None:
    """Say of each bracket whether it is right, where the log's result knows."""
    try:
        told = json.loads(result.get("brackets", "[]"))
    except ValueError:
        told = []
    known = {one.get("number"): one for one in told if isinstance(one, dict)} if isinstance(told, list) else {}
    for bracket in brackets:
        judged = known.get(bracket.number, {})
        bracket.correct = judged.get("correct")
        bracket.goal = judged.get("goal") or bracket.goal
