"""Tables of status changes and of notes, with the run's id: tables of many runs are joined by it."""

from __future__ import annotations

import json
from collections.abc import Iterator
from typing import Any

from cell.log.reading.reader import Log

Row = dict[str, Any]


def transitions(log: Log) -> Iterator[Row]:
    """One row for every change of a node's status: run, tick, time, path, uid, name, old, new, feedback."""
    for tick in log.ticks:
        for order, change in enumerate(tick.changes):
            yield {
                **_head(log, tick.number, tick.time_s, order),
                "path": change.path,
                "uid": change.uid,
                "name": change.path.rpartition("/")[2],
                "old": change.old.name,
                "new": change.new.name,
                "feedback": change.feedback,
            }


def notes(log: Log) -> Iterator[Row]:
    """One row for every note; what each topic has most of stands in columns, everything as JSON in `fields`."""
    for tick in log.ticks:
        for order, (topic, fields) in enumerate(tick.notes):
            yield {
                **_head(log, tick.number, tick.time_s, order),
                "topic": topic,
                "subject": _text(fields, "subject", "node", "goal"),
                "decision": _text(fields, "decision", "status"),
                "reason": _text(fields, "reason", "text"),
                "fields": json.dumps(dict(fields)),
            }


def _head(log: Log, tick: int, time_s: float, order: int) -> Row:
    return {"run_id": log.metadata.get("run_id", ""), "tick": tick, "time_s": time_s, "order_in_tick": order}


def _text(fields: Any, *names: str) -> str:
    """The first of these fields that a note has."""
    return next((str(fields[name]) for name in names if fields.get(name) is not None), "")
