"""Plots of the experiments as PNG files."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from matplotlib.axes import Axes
from matplotlib.figure import Figure

from learned.inference.scores import student
from learned.lab.experiments import Cells, score_of, values_of
from learned.lab.semantic_belief import OPTIMUM
from learned.lab.semantic_habits import STRENGTHS
from learned.lab.semantic_models import KINDS
from learned.lab.semantic_ratios import RATIOS
from learned.semantic.scenarios import DETECTION_ERROR, TRAIN_RATIO

COLOURS = {
    "factored": "tab:blue",
    "paper": "tab:orange",
    "and_or": "tab:green",
    "bayes": "tab:purple",
    OPTIMUM: "black",
}
MARKERS: dict[str, dict[str, Any]] = {"factored": {"marker": "s", "markersize": 10, "markerfacecolor": "none"}}
PAPER_SUCCESS = 0.963  # at TRAIN_RATIO, on the paper's own recordings
LEAST_WRONG = 1e-4  # lower end of the axis of wrong placements


def plot_ratios(cells: Cells, out: Path) -> None:
    """Success over all scenarios by ratio, a panel for each number of goals."""
    figure = Figure(figsize=(12, 4), layout="constrained")
    panels = figure.subplots(1, 3, sharey=True)
    for axes, goals in zip(panels, (1, 2, 3), strict=True):
        for kind in KINDS:
            wanted = {"kind": kind, "goals": goals, "sub_demonstrations": False}
            rows = [values_of(cells, score_of("success_all"), ratio=ratio, **wanted) for ratio in RATIOS]
            _line(axes, RATIOS, rows, kind)
        bound = values_of(cells, score_of("bound_all"), goals=goals)
        axes.axhline(bound[0], color="grey", linestyle=":", label="bound")
        axes.set(title=f"{goals} goal{'s' * (goals > 1)}", xlabel="share of scenarios trained on")
        axes.grid(alpha=0.3)
    panels[2].plot([TRAIN_RATIO], [PAPER_SUCCESS], "k*", markersize=10, label="the paper's figure")
    panels[0].set_ylabel("success over all scenarios")
    panels[2].legend()
    figure.savefig(out, dpi=110)


def plot_coverage(cells: Cells, out: Path) -> None:
    """Wrong placements against coverage as the threshold moves; the first seed of every kind."""
    figure = Figure(figsize=(11, 8), layout="constrained")
    panels = figure.subplots(2, 2, sharex=True, sharey=True)
    for axes, name, title in zip(
        panels.flat,
        ("uniform", f"runs_{DETECTION_ERROR}", "uniform_seen", "runs_seen"),
        (
            "all scenarios alike, reports alone",
            "after 1 to 5 actions, reports alone",
            "all scenarios alike, filled holes seen",
            "after 1 to 5 actions, filled holes seen",
        ),
        strict=True,
    ):
        for kind in (*KINDS, OPTIMUM):
            curve = next(values[name]["curve"] for key, values in cells if key["kind"] == kind)
            coverage, wrong = zip(*curve, strict=True)
            shown = [max(value, LEAST_WRONG) for value in wrong]
            axes.plot(coverage, shown, color=COLOURS[kind], label=kind, linestyle="--" if kind == OPTIMUM else "-")
        axes.plot([0.94], [0.003], "r*", markersize=11, label="the aim")
        axes.set(title=f"{title}, 4.5 % misdetections", xlabel="coverage", yscale="log", xlim=(0.2, 1.01))
        axes.grid(alpha=0.3, which="both")
    for axes in panels[:, 0]:
        axes.set_ylabel("share of wrong placements")
    panels[0, 0].legend()
    figure.savefig(out, dpi=110)


def plot_habits(cells: Cells, out: Path) -> None:
    """Goal accuracy after one action, and wrong placements, by strength of habits."""
    figure = Figure(figsize=(10, 4), layout="constrained")
    panels = figure.subplots(1, 2)
    for axes, name, label in zip(
        panels,
        ("goal_accuracy_1", "wrong_always"),
        ("goal accuracy after 1 action", "wrong placements if always acting"),
        strict=True,
    ):
        for kind in (OPTIMUM, "factored", "bayes"):
            rows = [values_of(cells, score_of(name), kind=kind, strength=strength) for strength in STRENGTHS]
            means = [student(row)[0] for row in rows]
            axes.plot(STRENGTHS, means, "o-", color=COLOURS[kind], label=kind, linewidth=1 + (kind == "factored"))
        axes.set(xlabel="strength of habits", ylabel=label)
        axes.grid(alpha=0.3)
    panels[0].legend()
    figure.savefig(out, dpi=110)


def _line(axes: Axes, x: Sequence[float], rows: Sequence[Sequence[float]], kind: str) -> None:
    """Means with 95 % intervals over seeds."""
    known = [(place, *student(row)) for place, row in zip(x, rows, strict=True) if row]
    if known:
        places, means, halves = zip(*known, strict=True)
        axes.errorbar(
            places, means, yerr=halves, color=COLOURS[kind], label=kind, capsize=2, **MARKERS.get(kind, {"marker": "o"})
        )
