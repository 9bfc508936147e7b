"""`cell train`: all that a product needs, in one go."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from cell.commands.terminal import CONFIGURATION, ConfigOption, SeedOption, console, product_of, report_scores
from cell.commands.weights import OverwriteOption, need_torch, new_weights, writing
from cell.errors import InputError

if TYPE_CHECKING:
    from cell.interfaces.product import Product

FEWEST_DEMONSTRATIONS = 20  # fewer tell nothing of people's habits
GRASP_MINUTES, SEMANTIC_MINUTES = 1, 1  # of one CPU core

RecordedOption = Annotated[
    Path | None, typer.Option("--recorded", help="Folder of `cell data --from LOG --out DIR`: learn from it, too.")
]


def train_all(
    context: typer.Context,
    recorded: RecordedOption = None,
    overwrite: OverwriteOption = False,
    config: ConfigOption = CONFIGURATION,
    seed: SeedOption = 0,
) -> None:
    """Train the planners that the product of a configuration needs; `cell train all` trains its detectors, too."""
    if context.invoked_subcommand is not None:
        return
    product = product_of(config)
    habits = _demonstrations(recorded, product)
    learns_habits = habits >= FEWEST_DEMONSTRATIONS
    minutes = GRASP_MINUTES + SEMANTIC_MINUTES * learns_habits
    say = console().print
    say(f"for {product.name}, about {minutes} minute{'s' * (minutes > 1)} of one CPU core:")
    say("- grasp planner `pairwise`, on drawn trays with parts of these sizes")
    if learns_habits:
        say(f"- semantic planner `factored`, on {habits} recorded assemblies")
    else:
        say(
            f"- semantic planner: nothing, `bayes` reads the goals from the product file; with {FEWEST_DEMONSTRATIONS} "
            f"recorded assemblies ({habits} here) people's habits can be learned (--recorded)"
        )
    need_torch()
    lines = _trained(product, recorded, learns_habits, overwrite, config, seed)
    say("its detectors: cell train all --plan", highlight=False)
    say(f"in {config}:")
    say("planners:", highlight=False)
    for planner in ("semantic", "grasp"):
        say(f"  {planner}:", *(f"    {line}" for line in lines[planner]), sep="\n", highlight=False)


def _trained(
    product: Product, recorded: Path | None, learns_habits: bool, overwrite: bool, config: Path, seed: int
) -> dict[str, list[str]]:
    """Train the planners; returns the lines for the configuration, by planner."""
    from cell.commands.noise import confusions_for
    from cell.commands.noise import train as train_noise

    weights = {"grasp": new_weights("grasp", "pairwise", config)}
    if learns_habits:
        weights["semantic"] = new_weights("semantic", "factored", config)
    segments = [] if recorded is None else [path for path in [recorded / "segments.jsonl"] if path.exists()]
    files = [*weights.values(), *(confusions_for(config) for _ in segments)]
    with writing(*files, overwrite=overwrite, option="--config"):
        lines = {"grasp": _grasp(product, weights["grasp"], seed), "semantic": ["kind: bayes"]}
        if learns_habits and recorded is not None:
            lines["semantic"] = _semantic(product, weights["semantic"], recorded, seed)
        if segments:
            train_noise(segments, None, True, config)
            lines["semantic"].append("confusions: confusions.json")
    return lines


def _demonstrations(recorded: Path | None, product: Product) -> int:
    """How many recorded assemblies there are.

    Raises:
        InputError: the folder is none of `cell data`, or the file is wrong.
    """
    from learned.semantic.data import load_demonstrations

    if recorded is None:
        return 0
    if not any((recorded / name).is_file() for name in ("manifest.json", "demonstrations.jsonl", "segments.jsonl")):
        raise InputError(f"--recorded {recorded}: nothing of `cell data --from LOG --out DIR` is there")
    path = recorded / "demonstrations.jsonl"
    if not path.exists():  # no run's goal is known
        return 0
    return sum(one.goal in product.goals for one in load_demonstrations(path, product))


def _grasp(product: Product, out: Path, seed: int) -> list[str]:
    from learned.grasp.train import train_grasp

    scores = train_grasp(product, out, seed, "pairwise", command=f"cell train --seed {seed}")
    report_scores(f"grasp planner in {out}", {name: scores[name] for name in scores if "accuracy" in name}, False)
    return ["kind: pairwise", f"weights: {out.name}"]


def _semantic(product: Product, out: Path, recorded: Path, seed: int) -> list[str]:
    from learned.semantic.train import train_semantic

    scores = train_semantic(product, out, seed, "factored", data=recorded / "demonstrations.jsonl")
    report_scores(f"semantic planner in {out}", {name: scores[name] for name in scores if "success" in name}, False)
    return ["kind: factored", f"weights: {out.name}"]
