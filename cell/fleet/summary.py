"""Shares and means of many runs with their intervals, by a column."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterable, Mapping
from typing import Any

from cell.fleet.intervals import mean, wilson
from cell.interfaces.errors import InputError

Row = Mapping[str, Any]
MEANS = ("sim_time_s", "robot_placements", "help_requests", "contacts", "interventions", "human_idle", "robot_idle")


def summaries(rows: Iterable[Row], by: str) -> list[dict[str, Any]]:
    """For each value of the column: how many runs, how many right, their share, and means; each with its interval.

    Raises:
        InputError: no run has this column.
    """
    groups: dict[str, list[Row]] = defaultdict(list)
    for row in rows:
        if by not in row:
            raise InputError(f"runs have no column '{by}'; they have: {', '.join(sorted(row))}")
        groups[str(row[by])].append(row)
    return [{by: value, **_figures(group)} for value, group in sorted(groups.items())]


def _figures(rows: list[Row]) -> dict[str, Any]:
    right = sum(row.get("end") == "finished" and row.get("correct") is True for row in rows)
    share = wilson(right, len(rows))
    told: dict[str, Any] = {"runs": len(rows), "right": right}
    told |= {"share": share.value, "share_low": share.low, "share_high": share.high}
    for name in MEANS:
        values = [float(row[name]) for row in rows if isinstance(row.get(name), int | float)]
        if values:
            found = mean(values)
            told |= {name: found.value}
            told |= {f"{name}_low": found.low, f"{name}_high": found.high} if len(values) > 1 else {}
    return told


def summary_lines(told: Mapping[str, Any], by: str) -> list[str]:
    """One of the summaries in words."""
    share = f"{told['share']:.3f} (95 %: {told['share_low']:.3f} - {told['share_high']:.3f})"
    lines = [f"{by} {told[by]}: {told['right']} of {told['runs']} right, {share}"]
    for name in filter(told.__contains__, MEANS):
        low, high = told.get(f"{name}_low"), told.get(f"{name}_high")
        lines.append(f"  {name} {told[name]:.2f}" + ("" if low is None else f" (95 %: {low:.2f} - {high:.2f})"))
    return lines
