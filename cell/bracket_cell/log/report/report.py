"""HTML pages about a run: one figure after the other, or, of a run that lasts hours, its shift, figures and alarms."""

from __future__ import annotations

import json
import math
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

from bracket_cell.log.read.mcap_file import statistics
from bracket_cell.log.read.reader import Log, LogStream
from bracket_cell.log.read.ticks import LoggedTick
from bracket_cell.log.report.html_page import rendered, write_page
from bracket_cell.log.report.key_frames import key_frames
from bracket_cell.log.report.query import why_of
from bracket_cell.log.report.shift import shift_from, shift_of
from bracket_cell.log.report.summary import (
    Belief,
    Line,
    beliefs,
    lines_from,
    node_rows,
    overruns,
    placements,
    tick_period_s,
    verdicts,
    waits,
    with_cause,
)
from bracket_cell.production.book import Book
from bracket_cell.production.bookkeeper import ROBOT, Placements
from bracket_ground.errors import LogError

TEMPLATE = Path(__file__).with_name("report.html.j2")
WIDTH, LABELS = 1120, 270  # of the charts, and of the names at their left, in user units
NARROWEST_PX = 720  # of a chart; on a phone it is scrolled beside its names
MOST_POINTS = 600
MOST_OVERRUNS = 12  # are listed, the worst ones
GRID = 12
COLOURS = ("#3b6fd4", "#d9822b", "#2a9d74", "#8a8f98", "#a24bb3", "#c23b4e", "#6b7a1f", "#1c8aa6")
SPLIT = ("robot_idle", "human_idle", "concurrent", "held_s", "slowed_s", "lost_alone_s")  # of a run's result
LONG_S = 1200.0  # the whole of a run that is longer would fill no readable page
MOST_LINES = 2000  # of what the controller said, the last ones


Tile = tuple[str, str, str]  # caption, value, mood


class Axis:
    """Places times on the common axis of all charts."""

    def __init__(self, begin_s: float, end_s: float) -> None:
        self.begin_s = begin_s
        self.end_s = max(end_s, begin_s + 1e-3)

    def x(self, time_s: float) -> float:
        return round(LABELS + (WIDTH - LABELS - 10) * min(max(self._share(time_s), 0.0), 1.0), 1)

    @property
    def grid(self) -> list[float]:
        """Round times of about a dozen lines."""
        length_s = self.end_s - self.begin_s
        step = next((s for s in (0.1, 0.2, 0.5, 1, 2, 5, 10, 20, 30, 60, 120, 300) if length_s / s <= GRID), 600)
        return [step * i for i in range(math.ceil(self.begin_s / step), math.floor(self.end_s / step) + 1)]

    def _share(self, time_s: float) -> float:
        return (time_s - self.begin_s) / (self.end_s - self.begin_s)


def write_report(log: Log, path: Path) -> int:
    """Write the page; returns its size in bytes.

    Raises:
        LogError: there is no tick to tell of, or a camera frame is damaged.
        InputError: the page cannot be written.
    """
    return write_page(report_html(log), path)


def report_html(log: Log) -> str:
    """The page as text."""
    told = _Told(log)
    rows, placed, goals = with_cause(node_rows(log), log, why_of(log)), placements(log), beliefs(log)
    names = list(dict.fromkeys(name for belief in goals for name in belief.goals))
    return told.page(
        f"{told.last_s - told.first_s:.1f} s",
        _found(goals, told.placements),
        parts=[],
        rows=rows,
        belief_names=names,
        belief_lines=[(name, colour, _steps(goals, name, told.axis)) for name, colour in _coloured(names)],
        beliefs=goals,
        placements=placed,
        verdicts=verdicts(log),
        waits=waits(log, rows),
        lines=told.lines,
        overruns=overruns(log)[:MOST_OVERRUNS],
        timing=_timing(log, told.axis),
        frames=key_frames(log, placed),
    )


def production_html(book: Book) -> str:
    """The page of a book: all that was made, day by day."""
    return rendered(TEMPLATE.with_name("book.html.j2"), shift=shift_of(book))


def write_overview(stream: LogStream, path: Path) -> int:
    """Write the page of a run that lasts hours; returns its size in bytes.

    Raises:
        LogError: a part cannot be read, or there is no tick to tell of.
        InputError: the page cannot be written.
    """
    told = _Told(stream)
    hours = f"{(told.last_s - told.first_s) / 3600:.2f} h"
    return write_page(told.page(hours, parts=_spans(stream.parts), lines=told.lines[-MOST_LINES:]), path)


def _coloured(names: Sequence[str]) -> Iterator[tuple[str, str]]:
    return ((name, COLOURS[i % len(COLOURS)]) for i, name in enumerate(names))


def _steps(goals: Sequence[Belief], name: str, axis: Axis) -> str:
    """SVG path of one probability over time, in a chart 150 units high."""
    points: list[str] = []
    for belief in goals:
        y = round(160 - 150 * belief.goals.get(name, 0.0), 1)
        points.append(f"H{axis.x(belief.time_s)}V{y}" if points else f"M{axis.x(belief.time_s)} {y}")
    return "".join([*points, f"H{axis.x(axis.end_s)}"]) if points else ""


def _timing(log: Log, axis: Axis) -> dict[str, Any]:
    """Longest tick of each stretch of the run, in [ms], and where the period was overrun."""
    period_ms = tick_period_s(log) * 1e3
    stretch = max(1, -(-len(log.ticks) // MOST_POINTS))
    pieces = [log.ticks[i : i + stretch] for i in range(0, len(log.ticks), stretch)]
    top_ms = max(period_ms * 1.25, max(tick.wall_s for tick in log.ticks) * 1e3)
    bars = []
    for piece in pieces:
        worst = max(piece, key=lambda tick: tick.wall_s)
        height = round(100 * worst.wall_s * 1e3 / top_ms, 1)
        bars.append((axis.x(worst.time_s), height, any(tick.overrun for tick in piece), worst))
    return {"period_ms": period_ms, "top_ms": top_ms, "bars": bars, "limit": round(110 - 100 * period_ms / top_ms, 1)}


def _found(goals: Sequence[Belief], placed: Placements) -> list[Tile]:
    """What was inferred and placed."""
    robot = list(placed.by.values()).count(ROBOT)
    last = goals[-1].goals if goals else {}
    goal = max(last, key=lambda name: last[name]) if last else "none"
    certainty = f" ({last[goal]:.0%})" if last else ""
    return [("goal inferred", goal + certainty, ""), ("by robot / all parts", f"{robot} / {len(placed.by)}", "")]


def is_long(parts: Sequence[Path]) -> bool:
    """Whether a log in parts holds more than a page can show."""
    spans = [(begin_s, end_s) for begin_s, end_s, _ in _spans(parts)]
    return len(spans) > 1 and max(end for _, end in spans) - min(begin for begin, _ in spans) > LONG_S


class _Told:
    """What both pages say: the shift, and what is counted while the ticks pass, once.

    Raises:
        LogError: there is no tick.
    """

    def __init__(self, log: Log | LogStream) -> None:
        self._log = log
        self._count = 0
        self.first_s = self.last_s = 0.0
        self.lines: list[Line] = []
        self._asked: list[Mapping[str, Any]] = []
        keeper = shift_from(self._ticks(), lambda: log.metadata, lambda: log.result)
        if not self._count:
            raise LogError(log.path, "holds no tick that could be reported")
        self._shift = shift_of(keeper.book) if keeper.rows else None
        self.placements = keeper.placements
        self.axis = Axis(self.first_s, self.last_s)

    def _ticks(self) -> Iterator[LoggedTick]:
        bracket = None
        for piece in self._log:
            self.lines += lines_from(self._log.path, piece.messages)
            for tick in piece.ticks:
                self.first_s = tick.time_s if not self._count else self.first_s
                self.last_s = tick.time_s
                self._count += 1
                for topic, fields in tick.notes:
                    if topic == "bracket":
                        bracket = fields.get("number")
                    elif topic == "help":
                        self._asked.append({**fields, "time_s": tick.time_s, "bracket": bracket})
                yield tick

    def page(self, took: str, more: Sequence[Tile] = (), **values: object) -> str:
        """The page as text.

        Args:
            more: further tiles.
            values: further ones that the template shows.
        """
        end = self._log.outcome.get("end", "cut off")
        more = [*more, *_split(self._log.result)]
        alarms = sum(line.count for line in self.lines if line.level != "info")
        tiles: list[Tile] = [
            ("outcome", end, "good" if end == "finished" else "bad"),
            *more,
            ("calls for help", str(len(self._asked)), "bad" if self._asked else ""),
            ("time", took, ""),
            ("alarms", str(alarms), "bad" if alarms else "good"),
        ]
        sizes = {"axis": self.axis, "width": WIDTH, "labels": LABELS, "narrowest": NARROWEST_PX}
        data = {"log": self._log, "why": why_of(self._log), "shift": self._shift, "tiles": tiles, "asked": self._asked}
        return rendered(TEMPLATE, **sizes, **data, **values)


def _split(result: Mapping[str, str]) -> Iterator[Tile]:
    """Where the time went, of logs that say so: who acted, and what the arm lost beside the person."""
    sums = {name: json.loads(value) for name, value in result.items() if name in SPLIT}
    if any(sums.get(name) is None for name in SPLIT):
        return
    both, alone = sums["concurrent"], (1 - sums["robot_idle"], 1 - sums["human_idle"])
    shares = (alone[0] - both, both, alone[1] - both, 1 - sum(alone) + both)
    yield "robot / both / person / nobody acts", " / ".join(f"{max(share, 0.0):.0%}" for share in shares), ""
    lost = f"{sums['held_s']:.1f} / {sums['slowed_s']:.1f} s, {sums['lost_alone_s']:.1f} s of it while the person rests"
    yield "arm held / slowed", lost, ""


def _spans(parts: Sequence[Path]) -> list[tuple[float, float, Path]]:
    """(from, until, file) of the parts that say so [s]."""
    found = [(part, told) for part in parts if (told := statistics(part)) is not None]
    return [(info.message_start_time / 1e9, info.message_end_time / 1e9, part) for part, info in found]
