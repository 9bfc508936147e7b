"""One self-contained HTML page about a run: what the nodes did, what was believed, shown, placed, refused and seen."""

from __future__ import annotations

import base64
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from jinja2 import Environment, FileSystemLoader, StrictUndefined

from cell.interfaces.errors import InputError, LogError
from cell.log.frames import Frames, LoggedFrame
from cell.log.reader import Log
from cell.log.story import Belief, Placed, beliefs, node_rows, placements, tick_period_s, verdicts, waits

TEMPLATE = "report.html.j2"
WIDTH, LABELS = 1120, 270  # of the charts, and of the names at their left, in user units
MOST_FRAMES = 24
SAME_S = 0.5  # key frames closer than this are one
MOST_POINTS = 600
GRID = 12
COLOURS = ("#3b6fd4", "#d9822b", "#2a9d74", "#8a8f98", "#a24bb3", "#c23b4e", "#6b7a1f", "#1c8aa6")


@dataclass(frozen=True)
class KeyFrame:
    """A picture at a moment that matters, with boxes (left, top, right, bottom) in [px]."""

    time_s: float
    caption: str
    uri: str
    width_px: int
    height_px: int
    boxes: tuple[tuple[int, int, int, int], ...]


class Axis:
    """Places times on the common axis of all charts."""

    def __init__(self, end_s: float) -> None:
        self.end_s = max(end_s, 1e-3)

    def x(self, time_s: float) -> float:
        return round(LABELS + (WIDTH - LABELS - 10) * min(max(time_s / self.end_s, 0.0), 1.0), 1)

    @property
    def grid(self) -> list[float]:
        """Round times of about a dozen lines."""
        step = next((s for s in (0.1, 0.2, 0.5, 1, 2, 5, 10, 20, 30, 60, 120, 300) if self.end_s / s <= GRID), 600)
        return [step * i for i in range(int(self.end_s / step) + 1)]


def write_report(log: Log, path: Path) -> int:
    """Write the page; returns its size in bytes.

    Raises:
        LogError: there is no tick to tell of, or a camera frame is damaged.
        InputError: the page cannot be written.
    """
    page = report_html(log).encode()
    try:
        path.write_bytes(page)
    except OSError as error:
        problem = f"{path}: the report cannot be written: {error.strerror or error}; choose another file by -o"
        raise InputError(problem) from None
    return len(page)


def report_html(log: Log) -> str:
    """The page as text."""
    if not log.ticks:
        raise LogError(log.path, "holds no tick that could be reported")
    environment = Environment(
        loader=FileSystemLoader(Path(__file__).parent),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    axis = Axis(log.ticks[-1].time_s)
    rows, placed, goals = node_rows(log), placements(log), beliefs(log)
    names = list(dict.fromkeys(name for belief in goals for name in belief.goals))
    return environment.get_template(TEMPLATE).render(
        log=log,
        axis=axis,
        width=WIDTH,
        labels=LABELS,
        rows=rows,
        belief_names=names,
        belief_lines=[(name, colour, _steps(goals, name, axis)) for name, colour in _coloured(names)],
        beliefs=goals,
        placements=placed,
        verdicts=verdicts(log),
        waits=waits(log, rows),
        timing=_timing(log, axis),
        frames=key_frames(log, placed),
        tiles=_tiles(log, goals, placed),
    )


def key_frames(log: Log, placed: Sequence[Placed]) -> list[KeyFrame]:
    """Pictures of begin and end, placements, screws, looks into the tray and calls for help."""
    frames = Frames(log)
    moments = sorted(_moments(log, placed), key=lambda moment: moment[0])
    kept: list[tuple[float, str, str]] = []
    for moment in moments:
        if kept and moment[0] - kept[-1][0] < SAME_S and moment[1] == kept[-1][1]:
            kept[-1] = (kept[-1][0], kept[-1][1], f"{kept[-1][2]}; {moment[2]}")
        else:
            kept.append(moment)
    if len(kept) > MOST_FRAMES:
        kept = [kept[round(i * (len(kept) - 1) / (MOST_FRAMES - 1))] for i in range(MOST_FRAMES)]
    return [
        _key_frame(log, time_s, caption, frame)
        for time_s, camera, caption in kept
        for frame in frames.newest(time_s)
        if frame.camera == camera
    ]


def _moments(log: Log, placed: Sequence[Placed]) -> Iterator[tuple[float, str, str]]:
    """(time, camera, caption) of what is worth a picture."""
    action, parts = "", None
    yield log.ticks[0].time_s, "overhead", "begin"
    for one in placed:
        yield one.time_s, "overhead", f"{one.part} at {one.position} ({one.source})"
    for tick in log.ticks:
        bench, seen = tick.observation.bench, tick.observation.parts
        if bench is not None and bench.action.kind != action:
            action = bench.action.kind
            if action == "screw":
                yield bench.time_s, "overhead", "the person screws"
        if seen is not None and seen is not parts:
            yield seen.time_s, "wrist", f"tray: {len(seen.detections)} parts seen"
            parts = seen
        for topic, fields in tick.notes:
            if topic == "help":
                yield tick.time_s, "overhead", f"help: {fields.get('text')}"
            elif topic == "skill" and fields.get("status") == "failure":
                yield tick.time_s, "overhead", f"{fields.get('node')}: {fields.get('reason')}"
    yield log.ticks[-1].time_s, "overhead", "end"


def _key_frame(log: Log, time_s: float, caption: str, frame: LoggedFrame) -> KeyFrame:
    image = cv2.imdecode(np.frombuffer(frame.jpeg, np.uint8), cv2.IMREAD_COLOR)
    if image is None:
        raise LogError(log.path, f"the image of camera {frame.camera} at {frame.time_s:.3f} s cannot be decoded")
    uri = "data:image/jpeg;base64," + base64.b64encode(frame.jpeg).decode()
    return KeyFrame(time_s, caption, uri, image.shape[1], image.shape[0], tuple(_boxes(log, frame)))


def _boxes(log: Log, frame: LoggedFrame) -> Iterator[tuple[int, int, int, int]]:
    """What the detectors found in this very frame."""
    for tick in log.ticks:
        bench, parts = tick.observation.bench, tick.observation.parts
        if frame.camera == "overhead" and bench is not None and abs(bench.time_s - frame.time_s) < 1e-6:
            if bench.hand is not None:
                yield bench.hand.box_px
            return
        if frame.camera == "wrist" and parts is not None and abs(parts.time_s - frame.time_s) < 1e-6:
            yield from (part.box_px for part in parts.detections)
            return


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


def _tiles(log: Log, goals: Sequence[Belief], placed: Sequence[Placed]) -> list[tuple[str, str, str]]:
    """(caption, value, mood) of the summary's tiles."""
    end = log.outcome.get("end", "cut off")
    overruns = sum(tick.overrun for tick in log.ticks)
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
        ("time", f"{log.ticks[-1].time_s:.1f} s", ""),
        ("ticks", str(len(log.ticks)), ""),
        ("overruns", str(overruns), "bad" if overruns else "good"),
    ]
