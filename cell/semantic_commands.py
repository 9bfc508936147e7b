"""`cell train semantic` and `cell eval semantic`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from cell.terminal import CONFIGURATION, ConfigOption, JsonOption, SeedOption, product_of, report_scores
from cell.weights import need_torch, shipped_weights


def train(
    kind: Annotated[str, typer.Option(help="paper or factored.")] = "factored",
    out: Annotated[Path | None, typer.Option(help="File to write; the shipped one by default.")] = None,
    config: ConfigOption = CONFIGURATION,
    seed: SeedOption = 0,
    as_json: JsonOption = False,
) -> None:
    """Train the planner that infers the goal and what remains to be done."""
    need_torch()
    from learned.semantic.train import train_semantic

    report_scores(
        "semantic", train_semantic(product_of(config), out or shipped_weights("semantic", kind), seed, kind), as_json
    )


def evaluate(
    kind: Annotated[str, typer.Option(help="paper, factored or bayes.")] = "factored",
    weights: Annotated[Path | None, typer.Option(help="ONNX file; the shipped one by default.")] = None,
    config: ConfigOption = CONFIGURATION,
    seed: SeedOption = 0,
    as_json: JsonOption = False,
) -> None:
    """Score the semantic planner."""
    from learned.semantic.evaluate import evaluate_semantic
    from learned.semantic.planner import load_semantic_planner

    product = product_of(config)
    planner = load_semantic_planner(kind, weights or shipped_weights("semantic", kind), product)
    report_scores("semantic", evaluate_semantic(planner, product, seed), as_json)
