"""Shares against the value of a knob, a panel for each knob."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from textwrap import fill
from typing import Any

from matplotlib.figure import Figure

COLUMNS, PANEL_INCHES = 4, (2.6, 2.1)
TITLE_LETTERS = 28  # over a panel


def plot_knobs(rows: Sequence[dict[str, Any]], title: str, path: Path) -> None:
    """Draw rows with `knob`, `value`, `share`, `low`, `high` and, on an axis of its own, `beside` into a PNG file."""
    names = list(dict.fromkeys(row["knob"] for row in rows))
    columns = min(COLUMNS, len(names))
    lines = -(-len(names) // columns)
    figure = Figure(figsize=(PANEL_INCHES[0] * columns, PANEL_INCHES[1] * lines + 0.4), layout="constrained")
    panels = figure.subplots(lines, columns, sharey=True, squeeze=False).ravel()
    most = max((row["beside"] for row in rows if row["beside"] is not None), default=1.0)
    for name, panel in zip(names, panels, strict=False):
        own = [row for row in rows if row["knob"] == name]
        shares = [row["share"] for row in own]
        reach = ([row["share"] - row["low"] for row in own], [row["high"] - row["share"] for row in own])
        panel.errorbar([row["value"] for row in own], shares, yerr=reach, marker="o", capsize=3)
        panel.set_title(name, fontsize="medium")
        panel.set_ylim(min(0.8, *(row["low"] for row in rows)) - 0.02, 1.02)
        panel.grid(alpha=0.3)
        other = panel.twinx()
        other.plot([row["value"] for row in own], [row["beside"] for row in own], "s--", color="tab:orange", alpha=0.7)
        other.set_ylim(0, 1.1 * most)
        other.tick_params(colors="tab:orange")
    for panel in panels[len(names) :]:
        panel.set_visible(False)
    figure.suptitle(fill(f"{title}; bars: 95 %", TITLE_LETTERS * columns), fontsize="large")
    figure.savefig(path, dpi=110)
