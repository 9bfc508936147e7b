"""Shares and means of many runs with their intervals, by a column."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterable, Mapping
from typing import Any

from cell.fleet.intervals import mean, wilson
from cell.interfaces.errors import InputError

Row = Mapping[str, Any]
MEANS = ("sim_time_s", "robot_placements", "help_requests", "contacts", "interventions", "human_idle", "robot_idle")


def summary_lines(rows: Iterable[Row], by: str) -> list[str]:
    """A block for each value of the column: how many, how many right, and means.

    Raises:
        InputError: no run has this column.
    """
    groups: dict[str, list[Row]] = defaultdict(list)
    for row in rows:
        if by not in row:
            raise InputError(f"runs have no column '{by}'; they have: {', '.join(sorted(row))}")
        groups[str(row[by])].append(row)
    return [line for value, group in sorted(groups.items()) for line in _block(f"{by} {value}", group)]


def _block(title: str, rows: list[Row]) -> list[str]:
    right = sum(row.get("end") == "finished" and row.get("correct") is True for row in rows)
    share = wilson(right, len(rows))
    told = [f"{title}: {right} of {len(rows)} right, {share.value:.3f} (95 %: {share.low:.3f} - {share.high:.3f})"]
    for name in MEANS:
        values = [float(row[name]) for row in rows if isinstance(row.get(name), int | float)]
        if values:
            found = mean(values)
            spread = f" (95 %: {found.low:.2f} - {found.high:.2f})" if len(values) > 1 else ""
            told.append(f"  {name} {found.value:.2f}{spread}")
    return told
