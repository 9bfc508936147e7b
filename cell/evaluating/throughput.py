"""What separation costs: the time for a bracket beside a careful person, with it and without it."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from cell.configuration import load_configuration, load_faults
from cell.evaluating.assembly import assembly
from cell.evaluating.row_file import Row
from cell.interfaces.judgement import FaultTable

OF_PERSON = ("hand_near", "hand_too_near", "blind_area")


def timed_pair(path: Path, tree: Path, seed: int) -> Row:
    """Two brackets with the same seed; a time is None where the bracket was not finished."""
    table = load_faults(load_configuration(path))
    rows = [row.model_copy(update={"action": "run"}) if row.signal in OF_PERSON else row for row in table.faults]
    without = table.model_copy(update={"faults": tuple(rows)})
    times = {"with_s": _time_s(path, tree, seed, table), "without_s": _time_s(path, tree, seed, without)}
    return {"kind": "throughput", "tree": tree.name, "seed": seed, **times}


def throughput_ratio(rows: Sequence[Row], tree: Path) -> float | None:
    """The sum of times with separation over the sum without, of pairs that were finished both; None without any."""
    times = [
        (float(str(row["with_s"])), float(str(row["without_s"])))
        for row in rows
        if row["kind"] == "throughput" and row["tree"] == tree.name and None not in (row["with_s"], row["without_s"])
    ]
    return round(sum(one for one, _ in times) / sum(other for _, other in times), 3) if times else None


def _time_s(path: Path, tree: Path, seed: int, table: FaultTable) -> float | None:
    with assembly(path, "careful", seed, table, tree=tree) as opened:
        outcome = opened.run([], None)
    return round(outcome.sim_time_s, 2) if outcome.end == "finished" else None
