"""HTML pages about a run: one figure after the other, or, of a run that lasts hours, its shift, figures and alarms."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

from cell.errors import LogError
from cell.log.read.mcap_file import statistics
from cell.log.read.reader import Log, LogStream
from cell.log.read.ticks import LoggedTick
from cell.log.report.html_page import rendered, write_page
from cell.log.report.key_frames import key_frames
from cell.log.report.query import why_of
from cell.log.report.shift import shift_from, shift_of
from cell.log.report.summary import (
    Belief,
    Line,
    Placed,
    beliefs,
    lines,
    lines_from,
    node_rows,
    overruns,
    placements,
    tick_period_s,
    verdicts,
    waits,
    with_cause,
)

TEMPLATE = Path(__file__).with_name("report.html.j2")
WIDTH, LABELS = 1120, 270  # of the charts, and of the names at their left, in user units
NARROWEST_PX = 720  # of a chart; on a phone it is scrolled beside its names
MOST_POINTS = 600
MOST_OVERRUNS = 12  # are listed, the worst ones
GRID = 12
COLOURS = ("#3b6fd4", "#d9822b", "#2a9d74", "#8a8f98", "#a24bb3", "#c23b4e", "#6b7a1f", "#1c8aa6")
LONG_S = 1200.0  # the whole of a run that is longer would fill no readable page
MOST_LINES = 2000  # of what the controller said, the last ones


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
    if not log.ticks:
        raise LogError(log.path, "holds no tick that could be reported")
    axis = Axis(log.ticks[0].time_s, log.ticks[-1].time_s)
    rows, placed, goals, said = with_cause(node_rows(log), log, why_of(log)), placements(log), beliefs(log), lines(log)
    names = list(dict.fromkeys(name for belief in goals for name in belief.goals))
    return rendered(
        TEMPLATE,
        log=log,
        why=why_of(log),
        parts=[],
        shift=shift_of(log),
        axis=axis,
        width=WIDTH,
        labels=LABELS,
        narrowest=NARROWEST_PX,
        rows=rows,
        belief_names=names,
        belief_lines=[(name, colour, _steps(goals, name, axis)) for name, colour in _coloured(names)],
        beliefs=goals,
        placements=placed,
        verdicts=verdicts(log),
        waits=waits(log, rows),
        lines=said,
        overruns=overruns(log)[:MOST_OVERRUNS],
        timing=_timing(log, axis),
        frames=key_frames(log, placed),
        tiles=_tiles(log, goals, placed, said),
    )


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


def _tiles(
    log: Log, goals: Sequence[Belief], placed: Sequence[Placed], said: Sequence[Line]
) -> list[tuple[str, str, str]]:
    """(caption, value, mood) of the summary's tiles."""
    end = log.outcome.get("end", "cut off")
    late = sum(tick.overrun for tick in log.ticks)
    alarms = sum(line.count for line in said if line.level != "info")
    helps = sum(topic == "help" for tick in log.ticks for topic, _ in tick.notes)
    new = [one for one in placed if not one.confirms]
    robot = sum(one.source == "robot" for one in placed)
    last = goals[-1].goals if goals else {}
    goal = max(last, key=lambda name: last[name]) if last else "none"
    certainty = f" ({last[goal]:.0%})" if last else ""
    return [
        ("outcome", end, "good" if end == "finished" else "bad"),
        ("goal inferred", goal + certainty, ""),
        ("by robot / all parts", f"{robot} / {len(new)}", ""),
        ("calls for help", str(helps), "bad" if helps else ""),
        ("time", f"{log.ticks[-1].time_s - log.ticks[0].time_s:.1f} s", ""),
        ("ticks", str(len(log.ticks)), ""),
        ("overruns", str(late), "bad" if late else "good"),
        ("alarms", str(alarms), "bad" if alarms else "good"),
    ]


def is_long(parts: Sequence[Path]) -> bool:
    """Whether a log in parts holds more than a page can show."""
    spans = [(begin_s, end_s) for begin_s, end_s, _ in _spans(parts)]
    return len(spans) > 1 and max(end for _, end in spans) - min(begin for begin, _ in spans) > LONG_S


def write_overview(stream: LogStream, path: Path) -> int:
    """Write the page; returns its size in bytes.

    Raises:
        LogError: a part cannot be read, or there is no tick to tell of.
        InputError: the page cannot be written.
    """
    told = _Told(stream)
    shift = shift_from(told.ticks(), lambda: stream.result)
    if not told.count:
        raise LogError(stream.path, "holds no tick that could be reported")
    page = rendered(
        TEMPLATE,
        log=stream,
        why=why_of(stream),
        parts=_spans(stream.parts),
        shift=shift,
        axis=Axis(told.first_s, told.last_s),
        width=WIDTH,
        labels=LABELS,
        narrowest=NARROWEST_PX,
        lines=told.lines[-MOST_LINES:],
        tiles=told.tiles(),
    )
    return write_page(page, path)


class _Told:
    """What is counted while the ticks pass."""

    def __init__(self, stream: LogStream) -> None:
        self._stream = stream
        self.count = self._late = self._helps = 0
        self.first_s = self.last_s = 0.0
        self.lines: list[Line] = []

    def ticks(self) -> Iterator[LoggedTick]:
        """All ticks, once."""
        for piece in self._stream:
            self.lines += lines_from(self._stream.path, piece.messages)
            for tick in piece.ticks:
                self.first_s = tick.time_s if not self.count else self.first_s
                self.last_s = tick.time_s
                self.count += 1
                self._late += tick.overrun
                self._helps += sum(topic == "help" for topic, _ in tick.notes)
                yield tick

    def tiles(self) -> list[tuple[str, str, str]]:
        """(caption, value, mood) of the tiles."""
        end = self._stream.outcome.get("end", "cut off")
        alarms = sum(line.count for line in self.lines if line.level != "info")
        return [
            ("outcome", end, "good" if end == "finished" else "bad"),
            ("calls for help", str(self._helps), "bad" if self._helps else ""),
            ("time", f"{(self.last_s - self.first_s) / 3600:.2f} h", ""),
            ("ticks", str(self.count), ""),
            ("overruns", str(self._late), "bad" if self._late else "good"),
            ("alarms", str(alarms), "bad" if alarms else "good"),
        ]


def _spans(parts: Sequence[Path]) -> list[tuple[float, float, Path]]:
    """(from, until, file) of the parts that say so [s]."""
    found = [(part, told) for part in parts if (told := statistics(part)) is not None]
    return [(told.message_start_time / 1e9, told.message_end_time / 1e9, part) for part, told in found]
