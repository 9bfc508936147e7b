"""`cell train semantic` and `cell eval semantic`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from cell.terminal import CONFIGURATION, ConfigOption, JsonOption, SeedOption, product_of, report_scores
from cell.weights import need_torch, shipped_weights

TRAIN_RATIO = 0.77  # 143 of the 186 scenarios of the default product, as in the paper


def train(
    kind: Annotated[str, typer.Option(help="paper, factored or and_or.")] = "factored",
    out: Annotated[Path | None, typer.Option(help="File to write; the shipped one by default.")] = None,
    data: Annotated[Path | None, typer.Option(help="Demonstrations to learn from; generated ones by default.")] = None,
    ratio: Annotated[float, typer.Option(min=0.01, max=0.99, help="Share that is trained on.")] = TRAIN_RATIO,
    augment: Annotated[bool, typer.Option("--augment", help="Learn from sub-demonstrations too.")] = False,
    config: ConfigOption = CONFIGURATION,
    seed: SeedOption = 0,
    as_json: JsonOption = False,
) -> None:
    """Train the planner that infers the goal and what remains to be done; a fit that was interrupted goes on."""
    need_torch()
    from learned.semantic.train import train_semantic

    path = out or shipped_weights("semantic", kind)
    scores = train_semantic(product_of(config), path, seed, kind, ratio=ratio, augment=augment, data=data)
    report_scores("semantic", scores, as_json)


def evaluate(
    kind: Annotated[str, typer.Option(help="paper, factored, and_or or bayes.")] = "factored",
    weights: Annotated[Path | None, typer.Option(help="File of weights; the shipped one by default.")] = None,
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
