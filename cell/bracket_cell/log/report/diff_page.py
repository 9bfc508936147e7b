"""Two runs side by side on one HTML page: why they differ first, then what each of them did."""

from __future__ import annotations

import difflib
from collections import defaultdict
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from bracket_cell.log.read.frames import Frames
from bracket_cell.log.read.reader import Log
from bracket_cell.log.replay.compare import Comparison
from bracket_cell.log.report.html_page import rendered, write_page
from bracket_cell.log.report.summary import NodeRow, node_rows, placements, verdicts, waits
from bracket_cell.log.report.text import difference_lines, short
from bracket_ground.errors import LogError

TEMPLATE = Path(__file__).with_name("diff.html.j2")
OF_ONE_RUN = ("run_id", "started_utc", "host")  # are others in every run and explain nothing
LANE, WIDTH, LABELS = 22, 1000, 250
MOST_LANES, MOST_EVENTS, MOST_LINES = 24, 120, 60

Told = list[tuple[str, str, str]]


@dataclass(frozen=True)
class Event:
    """Something that happened in one run or, where both have it at the same time, in both."""

    time_s: float
    one: str
    other: str


@dataclass(frozen=True)
class Lane:
    """A node's runs in both logs, as (x, width, ending, words) of bars."""

    name: str
    one: tuple[tuple[float, float, str, str], ...]
    other: tuple[tuple[float, float, str, str], ...]


def write_diff(
    one: Log, other: Log, comparison: Comparison, names: tuple[str, str], path: Path, causes: Sequence[str]
) -> int:
    """Write the page; returns its size in bytes.

    Args:
        causes: why they differ.

    Raises:
        LogError: one of them holds no tick.
        InputError: it cannot be written.
    """
    return write_page(diff_html(one, other, comparison, names, causes), path)


def diff_html(one: Log, other: Log, comparison: Comparison, names: tuple[str, str], causes: Sequence[str]) -> str:
    """The page as text."""
    for log in (one, other):
        if not log.ticks:
            raise LogError(log.path, "holds no tick that could be compared")
    first = comparison.first
    moment = comparison.first_by_aspect.get("command", first)  # the first one that acts on the world says most
    events = list(_events(one, other))
    end_s = max(log.ticks[-1].time_s for log in (one, other))
    return rendered(
        TEMPLATE,
        names=names,
        comparison=comparison,
        causes=causes or ["The two saw and decided the same in every tick."],
        first=None if first is None else difference_lines(first, names)[1:],
        asked_with=list(_asked_with(one, other)),
        files=[(name, list(lines)) for name, lines in _changed_files(one, other, names)],
        outcome=list(_outcomes(one, other)),
        frames=[] if moment is None else [_frame(log, moment.time_s) for log in (one, other)],
        events=events[:MOST_EVENTS],
        left_out=max(0, len(events) - MOST_EVENTS),
        lanes=_lanes(one, other, end_s),
        marks=[(_x(end_s * part / 8, end_s), f"{end_s * part / 8:.0f} s") for part in range(9)],
        mark_x=None if first is None else _x(first.time_s, end_s),
        lane=LANE,
        width=WIDTH,
        labels=LABELS,
        aspects=[
            (aspect, comparison.ticks_by_aspect[aspect], difference_lines(found, names))
            for aspect, found in comparison.first_by_aspect.items()
        ],
        nodes=comparison.ticks_by_node.most_common(MOST_LANES),
    )


def _asked_with(one: Log, other: Log) -> Iterator[tuple[str, str, str]]:
    """What the logs were recorded with, where it differs."""
    for name in dict.fromkeys((*one.metadata, *other.metadata)):
        was, now = one.metadata.get(name, "-"), other.metadata.get(name, "-")
        if was != now and name not in OF_ONE_RUN:
            yield name, short(was), short(now)


def _changed_files(one: Log, other: Log, names: tuple[str, str]) -> Iterator[tuple[str, Sequence[str]]]:
    """Attached files that differ, as unified differences."""
    for name in dict.fromkeys((*one.attachments, *other.attachments)):
        was, now = (log.attachments.get(name, b"").decode("utf-8", "replace").splitlines() for log in (one, other))
        if was != now:
            yield name, list(difflib.unified_diff(was, now, *names, lineterm="", n=1))[:MOST_LINES]


def _outcomes(one: Log, other: Log) -> Iterator[tuple[str, str, str]]:
    """How both ended and what came of it; what differs first."""
    found: Told = []
    for of in ("outcome", "result"):
        was, now = getattr(one, of), getattr(other, of)
        found += [
            (name, _few_digits(was.get(name, "-")), _few_digits(now.get(name, "-")))
            for name in dict.fromkeys((*was, *now))
            if name not in ("inputs_sha256", "why")  # whose words are those of `cause`
        ]
    yield from sorted(found, key=lambda row: row[1] == row[2])


def _few_digits(value: object) -> str:
    return f"{value:.4g}" if isinstance(value, float) else short(value)


def _events(one: Log, other: Log) -> Iterator[Event]:
    """What happened in both, in the order of time."""
    sides = [_happened(log) for log in (one, other)]
    for key in sorted({*sides[0], *sides[1]}):
        texts = [side.get(key, []) for side in sides]
        for place in range(max(map(len, texts))):
            was, now = (text[place] if place < len(text) else "" for text in texts)
            yield Event(key, was, now)


def _happened(log: Log) -> Mapping[float, list[str]]:
    found: dict[float, list[str]] = defaultdict(list)
    for placed in placements(log):
        if not placed.confirms:
            found[round(placed.time_s, 2)].append(f"{placed.part} at {placed.position} ({placed.source})")
    before = ""
    for verdict in verdicts(log):
        words = f"guard: {verdict.decision}, {verdict.subject}"
        if words != before:
            found[round(verdict.time_s, 2)].append(words)
        before = words
    for wait in waits(log, node_rows(log)):
        length = "" if wait.length_s is None else f" for {wait.length_s:.1f} s"
        found[round(wait.time_s, 2)].append(f"waits{length}: {wait.what}" if length else f"asks: {wait.what}")
    found[round(log.ticks[-1].time_s, 2)].append(f"end: {log.outcome.get('reason', log.unfinished or 'not known')}")
    return found


def _lanes(one: Log, other: Log, end_s: float) -> list[Lane]:
    """Nodes whose runs differ, those with the greatest difference of time first."""
    rows = [{_path(row): row for row in node_rows(log)} for log in (one, other)]
    paths = dict.fromkeys((*rows[0], *rows[1]))
    lanes = []
    for path in paths:
        was, now = (_bars(side.get(path), end_s) for side in rows)
        if was != now:
            row = rows[0].get(path) or rows[1][path]
            spent = [sum(width for _, width, *_ in bars) for bars in (was, now)]
            inside = row.place.rpartition(" / ")[2]
            name = f"{row.name}, {inside}" if inside else row.name
            lanes.append((abs(spent[0] - spent[1]), Lane(name, was, now)))
    return [lane for _, lane in sorted(lanes, key=lambda entry: -entry[0])[:MOST_LANES]]


def _path(row: NodeRow) -> str:
    """Without numbers, so that two trees may be compared."""
    return f"{row.place}/{row.name}"


def _bars(row: NodeRow | None, end_s: float) -> tuple[tuple[float, float, str, str], ...]:
    if row is None:
        return ()
    return tuple(
        (
            _x(run.begin_s, end_s),
            max(1.5, round(_x(run.end_s, end_s) - _x(run.begin_s, end_s), 1)),
            run.ending,
            f"{run.begin_s:.2f} to {run.end_s:.2f} s: {run.ending}, {run.feedback}",
        )
        for run in row.runs
    )


def _x(time_s: float, end_s: float) -> float:
    return round(LABELS + (WIDTH - LABELS - 10) * time_s / max(end_s, 1e-3), 1)


def _frame(log: Log, time_s: float) -> dict[str, Any] | None:
    """What the overhead camera saw then, as a data URI."""
    frame = Frames(log).newest_of("overhead", time_s)
    return None if frame is None else {"time_s": frame.time_s, "uri": frame.uri}
