"""`cell data semantic`, `cell train semantic` and `cell eval semantic`."""

from __future__ import annotations

import os
import platform
import sys
from datetime import date
from enum import StrEnum
from functools import partial
from pathlib import Path
from typing import Annotated

import typer

from cell.commands.terminal import (
    CONFIGURATION,
    ConfigOption,
    JsonOption,
    SeedOption,
    WorkersOption,
    console,
    print_json,
    product_of,
    report_scores,
)
from cell.commands.weights import OverwriteOption, need_torch, new_weights, shipped_weights, writing
from cell.errors import InputError
from cell.interfaces.product import Product

KEPT = Path("data") / "semantic"  # finished cells of experiments, a file for each product
TRAIN_RATIO = 0.77  # 143 of the 186 scenarios of the default product, as in the paper


class Experiment(StrEnum):
    """Which sections `cell eval semantic --experiment` writes."""

    SETTINGS = "settings"
    RATIOS = "ratios"
    BELIEF = "belief"
    HABITS = "habits"
    STREAMS = "streams"
    SIZES = "sizes"
    ALL = "all"


def data(
    out: Annotated[Path, typer.Option(help="New file (JSON lines, learned/semantic/data.py).")],
    scenarios: Annotated[
        bool, typer.Option("--scenarios", help="The paper's scenarios: every partial state, and what followed it.")
    ] = False,
    count: Annotated[int, typer.Option(min=1, help="Whole assemblies by people with habits.")] = 500,
    strength: Annotated[float, typer.Option(min=0, help="Of their habits; 0 is any order alike.")] = 1.0,
    config: ConfigOption = CONFIGURATION,
    seed: SeedOption = 0,
) -> None:
    """Generate demonstrations: whole assemblies, or the paper's scenarios."""
    from learned.semantic.data import save_demonstrations
    from learned.semantic.demonstrators import generated_demonstrations, scenario_demonstrations

    product = product_of(config)
    if out.exists():
        raise InputError(f"--out {out}: is there already; name a new file")
    if scenarios:
        drawn = scenario_demonstrations(product, seed)
        source = f"cell data semantic --scenarios --seed {seed}"
    else:
        drawn = generated_demonstrations(product, count, strength, seed)
        source = f"cell data semantic --count {count} --strength {strength:g} --seed {seed}"
    save_demonstrations(out, product, drawn, source)
    console().print(f"{len(drawn)} demonstrations in {out}")


def train(
    kind: Annotated[str, typer.Option(help="paper, factored or and_or.")] = "factored",
    data: Annotated[Path | None, typer.Option(help="Demonstrations to learn from; generated ones by default.")] = None,
    out: Annotated[Path | None, typer.Option(help="File to write; beside --config by default.")] = None,
    ratio: Annotated[float, typer.Option(min=0.01, max=0.99, help="Share that is trained on.")] = TRAIN_RATIO,
    augment: Annotated[bool, typer.Option("--augment", help="Learn from sub-demonstrations too.")] = False,
    overwrite: OverwriteOption = False,
    config: ConfigOption = CONFIGURATION,
    seed: SeedOption = 0,
    as_json: JsonOption = False,
) -> None:
    """Train the planner that infers the goal and what remains to be done; goes on where a training stopped."""
    need_torch()
    from learned.semantic.train import train_semantic

    path = new_weights("semantic", kind, config, out)
    product = product_of(config)
    with writing(path, overwrite=overwrite):
        scores = train_semantic(product, path, seed, kind, ratio=ratio, augment=augment, data=data)
    report_scores(f"weights in {path}", scores, as_json)


def evaluate(
    kind: Annotated[str, typer.Option(help="paper, factored, and_or or bayes.")] = "factored",
    weights: Annotated[Path | None, typer.Option(help="File of weights; the shipped one by default.")] = None,
    experiment: Annotated[
        Experiment | None, typer.Option(help="Compare all kinds instead; finished cells are kept under data/.")
    ] = None,
    out: Annotated[Path | None, typer.Option(help="With --experiment: page to write, plots beside it.")] = None,
    certify: Annotated[
        float | None, typer.Option(min=0.0001, max=0.5, help="Share of wrong acts to certify; needs --from.")
    ] = None,
    logs: Annotated[
        list[Path] | None, typer.Option("--from", metavar="LOG", help="With --certify: log of a run; may be repeated.")
    ] = None,
    workers: WorkersOption = 1,
    config: ConfigOption = CONFIGURATION,
    seed: SeedOption = 0,
    as_json: JsonOption = False,
) -> None:
    """Score the semantic planner, certify its thresholds on recorded runs, or run an experiment with all of them."""
    product = product_of(config)
    if certify is not None:
        _certify(certify, logs or [], product, config, seed, as_json)
        return
    if experiment is not None:
        _experiment(experiment, out, product, workers)
        return
    if out is not None:
        raise InputError("--out is for --experiment; scores of one planner go to the terminal, or --json")
    from learned.semantic.evaluate import evaluate_semantic
    from learned.semantic.model import load_semantic_planner

    planner = load_semantic_planner(kind, weights or shipped_weights("semantic", kind), product)
    report_scores("semantic", evaluate_semantic(planner, product, seed), as_json)


def _certify(limit: float, logs: list[Path], product: Product, config: Path, seed: int, as_json: bool) -> None:
    """Say from which belief on the robot may act, and how often it will."""
    import numpy as np

    from cell.commands.log_terminal import read
    from cell.configuration import load_configuration
    from cell.interfaces.planning import AssemblyState
    from cell.log.report.summary import beliefs
    from cell.log.training.demonstrations import finished_bracket
    from cell.wiring.services import load_planners
    from learned.lab.semantic_certify import case_of, certificate, least_limit

    planner = load_planners(load_configuration(config), product).semantic
    rng, cases = np.random.default_rng(seed), []
    for path in logs:
        log = read([path])
        final = finished_bracket(log, product)
        states = [one.placed for one in beliefs(log) if 0 < len(one.placed) < len(product.positions)]
        if final is not None and states:
            cases.append(case_of(planner, product, AssemblyState(states[rng.integers(len(states))]), final))
    if not cases:
        raise InputError("--certify needs logs of finished brackets; name them by --from LOG")
    found = certificate(cases, limit)
    act = load_configuration(config).guard.act_probability
    say = console().print
    runs = f"{found.runs} run{'s' * (found.runs > 1)}"
    if found.threshold is None:
        certify = "certifies" if found.runs == 1 else "certify"
        say(f"{runs} {certify} no threshold for at most {100 * limit:g} % wrong acts")
    else:
        say(
            f"at most {100 * limit:g} % wrong acts with 90 % confidence, from {runs}: "
            f"guard.act_probability: {found.threshold:g}; the robot then acts in {found.coverage:.3f} of the states"
        )
    say(f"at {act:g}, as configured, they certify at most {100 * least_limit(cases, act):.2g} %")
    if as_json:
        print_json(vars(found))


def _experiment(experiment: Experiment, out: Path | None, product: Product, workers: int) -> None:
    if out is None:
        raise InputError("--experiment needs --out FILE, the page to write")
    need_torch(plots=True)
    from cell.fleet.engine import mapped
    from learned.lab.experiments import kept, write_page
    from learned.lab.semantic_page import EXPERIMENTS, HEAD
    from learned.semantic.graph import Layout

    chosen = {name: some for name, some in EXPERIMENTS.items() if experiment in (Experiment.ALL, name)}
    facts = {
        "command": f"`cell eval semantic --experiment {experiment.value} --out {out}`",
        "date": date.today().isoformat(),
        "machine": f"{os.cpu_count()} cores ({platform.machine()}), one thread used, Python {sys.version.split()[0]}",
        "seeds": "1 to 5 where nothing else is said; 1000 to 1002 for the choice of settings",
        "product": f"{product.name}: {len(product.positions)} positions, {len(product.parts)} types, "
        f"{len(product.goals)} goals",
    }
    store = kept(KEPT / f"experiments_{Layout.of(product).sha256[:12]}.jsonl")
    write_page(HEAD, chosen, product, store, out, facts, partial(mapped, workers=workers))
    console().print(f"{', '.join(chosen)} in {out}")
