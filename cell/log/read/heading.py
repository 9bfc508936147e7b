"""What a log says of its run, without its ticks: metadata, outcome and result, found by the index of the file."""

from __future__ import annotations

import struct
from pathlib import Path
from typing import Any

import orjson
from mcap.exceptions import McapError
from mcap.reader import SeekingReader

from cell.errors import LogError
from cell.log.read.mcap_file import PROFILE
from cell.log.read.reader import files_of, read_log

Row = dict[str, Any]


def run_row(path: Path) -> Row:
    """One row about the run: who, when, with what, and the result.

    A log without an index, as of a killed process, is read whole.

    Args:
        path: the log, or its first part.

    Raises:
        LogError: it is not a log of this program, or cannot be read.
    """
    files = files_of(path)
    try:
        said = [_metadata(file) for file in dict.fromkeys((files[0], files[-1]))]
    except (McapError, struct.error, ValueError, OSError, _NoIndexError):
        log = read_log(path)
        return _row(files, dict(log.metadata), dict(log.outcome), dict(log.result), log.unfinished)
    first, last = said[0], said[-1]
    missing = "" if "outcome" in last else "the run's end is not in it"
    return _row(files, first.get("run", {}), last.get("outcome", {}), last.get("result", {}), missing)


class _NoIndexError(Exception):
    """The file ends before its index."""


def _metadata(path: Path) -> dict[str, dict[str, str]]:
    with path.open("rb") as stream:
        reader = SeekingReader(stream)
        if reader.get_summary() is None:
            raise _NoIndexError
        if reader.get_header().profile != PROFILE:
            raise LogError(path, f"is not a log of this program: its profile is {reader.get_header().profile!r}")
        return {record.name: record.metadata for record in reader.iter_metadata()}


def _row(
    files: list[Path], run: dict[str, str], outcome: dict[str, str], result: dict[str, str], unfinished: str
) -> Row:
    told = {name: orjson.loads(value) for name, value in result.items()}
    failure = str(told.get("last_failure") or "")
    ended = {name: _number(value) for name, value in outcome.items()}
    row: Row = {
        "run_id": run.get("run_id", ""),
        "log": str(files[0]),
        "bytes": sum(file.stat().st_size for file in files),
        "parts": len(files),
        "unfinished": unfinished,
        **{name.replace(".", "_"): value for name, value in run.items() if name != "run_id"},
        "goal_asked": run.get("goal", ""),
        **ended,
        **told,
        "seed": _number(run.get("seed", "")),
        "failed_leaf": failure.partition(":")[0] if outcome.get("end") == "failed" else "",
    }
    return row


def _number(text: str) -> int | float | str:
    """A number where the text is one."""
    for kind in (int, float):
        try:
            return kind(text)
        except ValueError:
            continue
    return text
