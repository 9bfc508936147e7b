"""`cell lab eval grasp|semantic` and `cell lab data grasp|semantic`: the planners' scores, experiments and data."""

from __future__ import annotations

import os
import platform
import sys
from contextlib import AbstractContextManager
from datetime import date
from enum import StrEnum
from functools import partial
from hashlib import sha256
from pathlib import Path
from typing import Annotated

import numpy as np
from rich.progress import track
from typer import Option

from bracket_cell.commands.log_terminal import read
from bracket_cell.commands.options import CONFIGURATION, ConfigOption, SeedOption, takes
from bracket_cell.commands.terminal import console, print_json, product_of, report_scores
from bracket_cell.configuration import load_configuration
from bracket_cell.fleet.engine import mapped
from bracket_cell.learned.grasp.crops import TrayCamera, load_crops
from bracket_cell.learned.grasp.settings import TRAY_SCENES, SceneSettings
from bracket_cell.learned.semantic.graph import Layout
from bracket_cell.learned.semantic.records import save_demonstrations
from bracket_cell.log.report.summary import beliefs
from bracket_cell.log.training.demonstrations import finished_bracket
from bracket_cell.wiring.services import load_planners
from bracket_ground.errors import InputError
from bracket_ground.interfaces.planning import AssemblyState, SemanticPlanner, crops_file
from bracket_ground.interfaces.product import Product
from bracket_lab.commands.shared import Shared
from bracket_lab.commands.training.weights import shipped_weights
from bracket_lab.experiments.paper.htn import HtnPlanner
from bracket_lab.experiments.semantic_certify import case_of, certificate, least_limit
from bracket_lab.experiments.semantic_demonstrators import generated_demonstrations, scenario_demonstrations
from bracket_lab.learned.grasp.data import write_scenes
from bracket_lab.learned.grasp.evaluate import AlwaysGrasp, embedded, evaluate_grasp
from bracket_lab.learned.grasp.paper_planner import load_grasp_planner
from bracket_lab.learned.grasp.scenes import draw_scenes
from bracket_lab.learned.semantic.evaluate import evaluate_semantic
from bracket_lab.learned.semantic.paper_planner import load_semantic_planner
from bracket_lab.wiring.drawn_frames import tray_camera

KEPT = Path("data")  # finished cells of experiments, a file for each product
PAGE_ALONE = "--page is for --experiment; scores of one planner go to the terminal, or --json"
NO_PAGE = "--experiment needs --page FILE, the page to write"


class Clutter(StrEnum):
    """How close parts stand in drawn scenes."""

    DENSE = "dense"
    TRAY = "tray"


class GraspExperiment(StrEnum):
    """Tables of `cell lab eval grasp --experiment`."""

    TABLE2 = "table2"
    TABLE3 = "table3"
    NOISE = "noise"
    PAPER = "paper"
    CURVE = "curve"
    ALL = "all"


class SemanticExperiment(StrEnum):
    """Sections of `cell lab eval semantic --experiment`."""

    SETTINGS = "settings"
    RATIOS = "ratios"
    BELIEF = "belief"
    HABITS = "habits"
    STREAMS = "streams"
    SIZES = "sizes"
    ALL = "all"


PageOption = Annotated[Path | None, Option("--page", help="With --experiment: page to write, plots next to it.")]
NewFileOption = Annotated[Path, Option("--out", "-o", help="New file of JSON lines.")]


def draw_grasp(
    out: NewFileOption,
    count: Annotated[int, Option(min=1, help="Number of scenes.")] = 1000,
    clutter: Annotated[Clutter, Option(help="How close parts stand.")] = Clutter.DENSE,
    config: ConfigOption = CONFIGURATION,
    seed: SeedOption = 0,
) -> None:
    """Cluttered trays with detections, truth and labels."""
    _require_new(out)
    product = product_of(config)
    settings = TRAY_SCENES if clutter is Clutter.TRAY else SceneSettings()
    drawn = track(draw_scenes(product, seed, count, "train", settings), "drawing", count, console=console())
    source = f"cell lab data grasp --count {count} --clutter {clutter.value} --seed {seed}"
    try:
        written = write_scenes(out, drawn, product, source)
    except OSError as error:
        raise InputError(f"{out}: cannot be written: {error.strerror}") from error
    console().print(f"{written} scenes in {out}")


def draw_semantic(
    out: NewFileOption,
    scenarios: Annotated[
        bool, Option("--scenarios", help="The paper's scenarios: every partial state, and what followed it.")
    ] = False,
    count: Annotated[int, Option(min=1, help="Number of whole assemblies by people with habits.")] = 500,
    strength: Annotated[float, Option(min=0, help="Strength of their habits; 0: any order alike.")] = 1.0,
    config: ConfigOption = CONFIGURATION,
    seed: SeedOption = 0,
) -> None:
    """Demonstrations: whole assemblies, or the paper's scenarios."""
    _require_new(out)
    product = product_of(config)
    if scenarios:
        drawn = scenario_demonstrations(product, seed)
        source = f"cell lab data semantic --scenarios --seed {seed}"
    else:
        drawn = generated_demonstrations(product, count, strength, seed)
        source = f"cell lab data semantic --count {count} --strength {strength:g} --seed {seed}"
    save_demonstrations(out, product, drawn, source)
    console().print(f"{len(drawn)} demonstrations in {out}")


def _require_new(out: Path) -> None:
    if out.exists():
        raise InputError(f"--out {out}: exists already; name a new file")


@takes(Shared, "kind", "weights", "seed", "config", "as_json")
def evaluate_grasp_planner(
    shared: Shared,
    experiment: Annotated[
        list[GraspExperiment] | None,
        Option(help="Compare all planners instead; may be repeated; finished cells are kept under data/."),
    ] = None,
    page: PageOption = None,
    scenes: Annotated[int, Option(min=4, help="Number of test scenes.")] = 1000,
) -> None:
    """Score the grasp planner, or run an experiment with all kinds. Kinds: pairwise, paper, rule, always."""
    product = product_of(shared.config)
    if experiment:
        _grasp_experiment(experiment, page, product, shared)
        return
    if page is not None:
        raise InputError(PAGE_ALONE)
    kind = shared.one_kind(("pairwise", "paper", "rule", "always"))
    if kind == "always":
        report_scores("grasp", evaluate_grasp(AlwaysGrasp(), product, shared.seed, scenes), shared.as_json)
        return
    path = shared.weights or shipped_weights("grasp", kind)
    planner = load_grasp_planner(kind, path, product)
    if kind != "paper":
        report_scores("grasp", evaluate_grasp(planner, product, shared.seed, scenes), shared.as_json)
        return
    with _camera(product, shared.config) as camera:
        look = partial(embedded, camera=camera, network=load_crops(crops_file(path)))
        report_scores("grasp", evaluate_grasp(planner, product, shared.seed, scenes, look=look), shared.as_json)


def _camera(product: Product, config: Path) -> AbstractContextManager[TrayCamera]:
    return tray_camera(product, load_configuration(config).bench)


def _grasp_experiment(experiments: list[GraspExperiment], page: Path | None, product: Product, shared: Shared) -> None:
    if page is None:
        raise InputError(NO_PAGE)
    import torch

    from bracket_lab.experiments.experiments import kept, write_page
    from bracket_lab.experiments.grasp_cells import TEST_SEED
    from bracket_lab.experiments.grasp_page import HEAD
    from bracket_lab.experiments.grasp_page import experiments as tables

    typed = " ".join(f"--experiment {experiment.value}" for experiment in experiments)
    test_seed = shared.seed or TEST_SEED
    facts = {
        "command": f"`cell lab eval grasp {typed} --seed {test_seed} --page {page}`",
        "date": date.today().isoformat(),
        "machine": f"{platform.machine()}, one thread, Python {platform.python_version()}, torch {torch.__version__}",
    }
    identity = sha256(product.model_dump_json().encode()).hexdigest()[:12]
    with _camera(product, shared.config) as camera:
        every = tables(camera, test_seed)
        chosen = {name: some for name, some in every.items() if {GraspExperiment.ALL, name} & {*experiments}}
        store = kept(KEPT / "grasp" / f"experiments_{identity}.jsonl")
        write_page(HEAD, chosen, product, store, page, facts)
    console().print(f"{', '.join(chosen)} in {page}")


@takes(Shared, "kind", "weights", "workers", "scheduler", "seed", "config", "as_json")
def evaluate_semantic_planner(
    shared: Shared,
    experiment: Annotated[
        SemanticExperiment | None, Option(help="Compare all kinds instead; finished cells are kept under data/.")
    ] = None,
    page: PageOption = None,
    certify: Annotated[
        float | None, Option(min=0.0001, max=0.5, help="Share of wrong acts to certify; needs --from.")
    ] = None,
    logs: Annotated[
        list[Path] | None, Option("--from", metavar="LOG", help="With --certify: log of a run; may be repeated.")
    ] = None,
) -> None:
    """Score the semantic planner, certify its thresholds, or run an experiment with all kinds.

    Kinds: factored, paper, htn, bayes.
    """
    product = product_of(shared.config)
    if certify is not None:
        _certify(certify, logs or [], product, shared)
        return
    if experiment is not None:
        _semantic_experiment(experiment, page, product, shared)
        return
    if page is not None:
        raise InputError(PAGE_ALONE)
    kind = shared.one_kind(("factored", "paper", "htn", "bayes", "auto"))
    planner: SemanticPlanner = HtnPlanner(product)
    if kind != "htn":
        planner = load_semantic_planner(kind, shared.weights or shipped_weights("semantic", kind), product)
    report_scores("semantic", evaluate_semantic(planner, product, shared.seed), shared.as_json)


def _certify(limit: float, logs: list[Path], product: Product, shared: Shared) -> None:
    """Say from which belief on the robot may act, and how often it will."""
    configuration = load_configuration(shared.config)
    planner = load_planners(configuration, product).semantic
    rng, cases = np.random.default_rng(shared.seed), []
    for path in logs:
        log = read([path])
        final = finished_bracket(log, product)
        states = [one.placed for one in beliefs(log) if 0 < len(one.placed) < len(product.positions)]
        if final is not None and states:
            cases.append(case_of(planner, product, AssemblyState(states[rng.integers(len(states))]), final))
    if not cases:
        raise InputError("--certify needs logs of finished brackets; name them with --from LOG")
    found = certificate(cases, limit)
    guard = configuration.guard
    act = guard.act_probability
    say = console().print
    runs = f"{found.runs} run{'s' * (found.runs > 1)}"
    if found.threshold is None:
        certify = "certifies" if found.runs == 1 else "certify"
        say(f"{runs} {certify} no threshold for at most {100 * limit:g} % wrong acts")
    else:
        say(
            f"at most {100 * limit:g} % wrong acts with 90 % confidence, from {runs}: "
            f"act from probability {found.threshold:g} on, guard.wrong_act_s: "
            f"{guard.question_s / (1.0 - found.threshold):.0f}; "
            f"the robot then acts in {found.coverage:.3f} of the states"
        )
    say(f"at {act:g}, as configured, they certify at most {100 * least_limit(cases, act):.2g} %")
    if shared.as_json:
        print_json(vars(found))


def _semantic_experiment(experiment: SemanticExperiment, page: Path | None, product: Product, shared: Shared) -> None:
    if page is None:
        raise InputError(NO_PAGE)
    from bracket_lab.experiments.experiments import kept, write_page
    from bracket_lab.experiments.semantic_page import EXPERIMENTS, HEAD

    chosen = {name: some for name, some in EXPERIMENTS.items() if experiment in (SemanticExperiment.ALL, name)}
    facts = {
        "command": f"`cell lab eval semantic --experiment {experiment.value} --page {page}`",
        "date": date.today().isoformat(),
        "machine": f"{os.cpu_count()} cores ({platform.machine()}), one thread used, Python {sys.version.split()[0]}",
        "seeds": "1 to 5 where nothing else is said; 1000 to 1002 for the choice of settings",
        "product": f"{product.name}: {len(product.positions)} positions, {len(product.parts)} types, "
        f"{len(product.goals)} goals",
    }
    store = kept(KEPT / "semantic" / f"experiments_{Layout.of(product).sha256[:12]}.jsonl")
    run = partial(mapped, workers=shared.workers, address=shared.scheduler)
    write_page(HEAD, chosen, product, store, page, facts, run)
    console().print(f"{', '.join(chosen)} in {page}")
