"""A log as a row of the table of runs."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from bracket_cell.fleet.table import order_id
from bracket_cell.log.read.mcap_file import metadata_of
from bracket_cell.log.read.reader import files_of, json_of, read_log

Row = Mapping[str, Any]


def run_row(path: Path) -> Row:
    """One row about the run: who, when, with what, and the result.

    A log without an index, as of a killed process, is read whole.

    Args:
        path: the log, or its first part.

    Raises:
        LogError: it is not a log of this program, or cannot be read.
    """
    files = files_of(path)
    said = [metadata_of(file) for file in dict.fromkeys((files[0], files[-1]))]
    first, last = said[0], said[-1]
    if "run" not in first or not last:
        log = read_log(path)
        return _row(files, dict(log.metadata), dict(log.outcome), dict(log.result), log.unfinished)
    missing = "" if "outcome" in last else "the run's end is not in it"
    return _row(files, first["run"], last.get("outcome", {}), last.get("result", {}), missing)


def _row(
    files: list[Path], run: dict[str, str], outcome: dict[str, str], result: dict[str, str], unfinished: str
) -> Row:
    fields = {name: json_of(files[0], result, name, lambda value: value) for name in result}
    fields |= {"brackets": json_of(files[0], result, "brackets", lambda rows: [dict(row) for row in rows])}
    why = json_of(files[0], outcome, "why", dict) or {}
    ended = {name: _number(value) for name, value in outcome.items() if name != "why"}
    row: Row = {
        "run_id": run.get("run_id", ""),
        "log": str(files[0]),
        "bytes": sum(file.stat().st_size for file in files),
        "parts": len(files),
        "unfinished": unfinished,
        **{name.replace(".", "_"): value for name, value in run.items() if name != "run_id"},
        "goal_asked": run.get("goal", ""),
        **ended,
        **fields,
        "seed": _number(run.get("seed", "")),
        "order_id": order_id(fields),
        "cause": outcome.get("cause", ""),
        "otherwise": why.get("otherwise", ""),
        "limits": run.get("safety.sha256", ""),
        "failed_leaf": why.get("node", "") if outcome.get("end") == "failed" else "",
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
