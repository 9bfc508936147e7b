"""`cell train grasp` and `cell eval grasp`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from cell.terminal import CONFIGURATION, ConfigOption, JsonOption, SeedOption, product_of, report_scores
from cell.weights import need_torch, shipped_weights


def train(
    kind: Annotated[str, typer.Option(help="paper or pairwise.")] = "pairwise",
    out: Annotated[Path | None, typer.Option(help="File to write; the shipped one by default.")] = None,
    config: ConfigOption = CONFIGURATION,
    seed: SeedOption = 0,
    as_json: JsonOption = False,
) -> None:
    """Train the planner that judges graspability in clutter."""
    need_torch()
    from learned.grasp.train import train_grasp

    command = f"cell train grasp --kind {kind} --seed {seed}"
    report_scores(
        "grasp",
        train_grasp(product_of(config), out or shipped_weights("grasp", kind), seed, kind, command=command),
        as_json,
    )


def evaluate(
    kind: Annotated[str, typer.Option(help="paper, pairwise or rule.")] = "pairwise",
    weights: Annotated[Path | None, typer.Option(help="ONNX file; the shipped one by default.")] = None,
    config: ConfigOption = CONFIGURATION,
    seed: SeedOption = 0,
    scenes: Annotated[int, typer.Option(min=4, help="Number of test scenes.")] = 1000,
    as_json: JsonOption = False,
) -> None:
    """Score the grasp planner."""
    from learned.grasp.evaluate import evaluate_grasp
    from learned.grasp.planner import load_grasp_planner

    product = product_of(config)
    planner = load_grasp_planner(kind, weights or shipped_weights("grasp", kind), product)
    report_scores("grasp", evaluate_grasp(planner, product, seed, scenes), as_json)
