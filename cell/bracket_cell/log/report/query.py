"""Answers to what testers ask of a log: what is in it, what went on in its ticks, and how two logs differ."""

from __future__ import annotations

import json
from array import array
from collections import Counter
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass, replace
from typing import Any

from bracket_cell.log.read.reader import Log, LogStream, json_of
from bracket_cell.log.replay.compare import (
    CAUSE,
    WHY,
    Comparison,
    Difference,
    causes_of,
    differences,
    input_differences,
    logged,
    remembers,
)
from bracket_cell.log.replay.logged_tree import FOLDER, logged_tree
from bracket_cell.log.replay.matching import Names, caused_by, partners, renamed
from bracket_cell.recording.schemas import plain
from bracket_ground.errors import InputError, LogError

FOREVER = float("inf")
OF_REASON = ("text", "otherwise", "words", "uid", "path")


def why_of(log: Log | LogStream) -> dict[str, Any] | None:
    """Why the tree of a log failed, or did not end in time, by the keys of `Reason.plain`; of a stream that was read.

    None where it ended otherwise, and in logs that do not say.

    Raises:
        LogError: it does not hold what it should.
    """
    return json_of(log.path, log.outcome, "why", lambda row: {**{name: row[name] for name in OF_REASON}, **row})


@dataclass(frozen=True)
class Query:
    """Which entries of a log are wanted; what is None is not asked.

    Attributes:
        node: part of a node's path.
        status: that a node took, e.g. "FAILURE".
        key: that the entry has at any depth, e.g. "goal" or "fingertips_m".
        topic: of the messages, e.g. "tick", "note/belief", "command"; a part of it is enough.
    """

    node: str | None = None
    status: str | None = None
    key: str | None = None
    topic: str | None = None
    from_s: float = 0.0
    until_s: float = FOREVER


def info(log: Log | LogStream) -> dict[str, Any]:
    """A log in a few lines: how the run ended, what is attached, how many messages there are of which topic."""
    counts: Counter[str] = Counter()
    sizes: Counter[str] = Counter()
    wall_s, overruns, first_s, last_s = array("d"), 0, 0.0, 0.0
    for piece in log:
        for message in piece.messages:
            counts[message.topic] += 1
            sizes[message.topic] += len(message.data)
        if piece.ticks:
            first_s = first_s if wall_s else piece.ticks[0].time_s
            last_s = piece.ticks[-1].time_s
        wall_s.extend(tick.wall_s for tick in piece.ticks)
        overruns += sum(tick.overrun for tick in piece.ticks)
    wall_s = array("d", sorted(wall_s))
    return {
        "log": str(log.path),
        "parts": [path.name for path in log.parts] if len(log.parts) > 1 else [],
        "bytes": sum(path.stat().st_size for path in log.parts or (log.path,)),
        "ticks": len(wall_s),
        "duration_s": last_s - first_s,
        "overruns": overruns,
        "tick_wall_p50_ms": round(1e3 * wall_s[len(wall_s) // 2], 3) if wall_s else None,
        "tick_wall_max_ms": round(1e3 * wall_s[-1], 3) if wall_s else None,
        "unfinished": log.unfinished,
        "inputs_altered": log.altered,
        "outcome": {**log.outcome, **({"why": why} if (why := why_of(log)) else {})},
        "result": {name: json_of(log.path, log.result, name, lambda value: value) for name in log.result},
        "metadata": dict(log.metadata),
        "attachments": {name: len(content) for name, content in log.attachments.items()},
        "topics": {topic: {"messages": counts[topic], "bytes": sizes[topic]} for topic in sorted(counts)},
    }


def ticks(
    log: Log | LogStream, from_s: float = 0.0, until_s: float = FOREVER, all_ticks: bool = False
) -> Iterator[dict[str, Any]]:
    """Ticks with what happened in them; those in which nothing was decided only where all are asked for.

    The one in which the tree failed says why, which is known once all of the log was read.
    """
    late: list[dict[str, Any]] = []
    for tick in (tick for piece in log for tick in piece.ticks):
        notes = [{"topic": topic, **fields} for topic, fields in tick.notes if topic != WHY]
        acts = any(note["topic"] != CAUSE for note in notes) or tick.command or tick.display or tick.status != "RUNNING"
        if not (from_s <= tick.time_s <= until_s and (acts or all_ticks)):
            continue
        shown = {
            "tick": tick.number,
            "time_s": tick.time_s,
            "status": tick.status,
            "changes": plain(tick.changes),
            "notes": notes,
            "command": tick.command,
            "display": tick.display,
            "wall_s": tick.wall_s,
        }
        if tick.status == "FAILURE" or late:
            late.append(shown)
        else:
            yield shown
    if late and (why := why_of(log)):
        late[0]["why"] = why
    yield from late


def query(log: Log | LogStream, asked: Query) -> Iterator[dict[str, Any]]:
    """Entries that fit everything asked: status changes where a node or a status is asked, else whole messages."""
    if asked.node is not None or asked.status is not None:
        yield from (entry for entry in _changes(log, asked) if asked.key is None or _has(entry, asked.key))
        return
    for message in (message for piece in log for message in piece.messages):
        time_s = message.time_ns / 1e9
        if message.encoding != "json" or not asked.from_s <= time_s <= asked.until_s:
            continue
        if asked.topic is not None and asked.topic not in message.topic:
            continue
        fields = json.loads(message.data)
        if asked.key is None or _has(fields, asked.key):
            yield {"topic": message.topic, "time_s": time_s, **fields}


def diff(one: Log, other: Log) -> Comparison:
    """Two logs tick by tick: what was seen (model outputs among it) and what was decided."""
    trees = [{name: text for name, text in log.attachments.items() if name.startswith(FOLDER)} for log in (one, other)]
    names: Names = {}
    with suppress(LogError, InputError):  # of a tree that cannot be read here nodes go by their paths
        names = partners(logged_tree(one), logged_tree(other)) if trees[0] != trees[1] else {}
    comparison, memory = Comparison(), remembers(one) and remembers(other)
    for a, b in zip(one.ticks, other.ticks, strict=False):
        now = logged(b)
        now = replace(now, changes=renamed(now.changes, names))
        decided = differences(a.number, a.time_s, logged(a), now, memory)
        caused = caused_by(list(causes_of(b)), names)
        comparison.compared(a.number, a.time_s, (a.changes, causes_of(a)), (now.changes, caused))
        comparison.add([*input_differences(a, b), *decided])
    shorter, longer = sorted((one, other), key=lambda log: len(log.ticks))
    if len(shorter.ticks) != len(longer.ticks):
        tick = longer.ticks[len(shorter.ticks)]
        comparison.add([Difference(tick.number, tick.time_s, "length", len(one.ticks), len(other.ticks))])
    return comparison


def _changes(log: Log | LogStream, asked: Query) -> Iterator[dict[str, Any]]:
    for tick in (tick for piece in log for tick in piece.ticks):
        if not asked.from_s <= tick.time_s <= asked.until_s or asked.topic not in (None, "tick", "/tick"):
            continue
        for change in tick.changes:
            if (asked.node is None or asked.node in change.path) and asked.status in (None, change.new.name):
                yield {"tick": tick.number, "time_s": tick.time_s, **plain(change)}


def _has(value: Any, key: str) -> bool:
    if isinstance(value, dict):
        return key in value or any(_has(item, key) for item in value.values())
    return isinstance(value, list) and any(_has(item, key) for item in value)
