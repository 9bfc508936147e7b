"""`cell lab eval grasp|semantic`: the planners' scores."""

from __future__ import annotations

from functools import partial
from pathlib import Path
from typing import Annotated

import numpy as np
from typer import Option

from bracket_cell.commands.log_terminal import read
from bracket_cell.commands.options import takes
from bracket_cell.commands.terminal import console, print_json, product_of, report_scores
from bracket_cell.configuration import load_configuration
from bracket_cell.learned.grasp.crops import load_crops
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
from bracket_lab.learned.grasp.evaluate import AlwaysGrasp, embedded, evaluate_grasp
from bracket_lab.learned.grasp.paper_planner import load_grasp_planner
from bracket_lab.learned.semantic.evaluate import evaluate_semantic
from bracket_lab.learned.semantic.paper_planner import load_semantic_planner
from bracket_lab.wiring.drawn_frames import tray_camera


@takes(Shared, "kind", "weights", "seed", "config", "as_json")
def evaluate_grasp_planner(
    shared: Shared,
    scenes: Annotated[int, Option(min=4, help="Number of test scenes.")] = 1000,
) -> None:
    """Score the grasp planner. Kinds: pairwise, paper, rule, always."""
    product = product_of(shared.config)
    kind = shared.one_kind(("pairwise", "paper", "rule", "always"))
    if kind == "always":
        report_scores("grasp", evaluate_grasp(AlwaysGrasp(), product, shared.seed, scenes), shared.as_json)
        return
    path = shared.weights or shipped_weights("grasp", kind)
    planner = load_grasp_planner(kind, path, product)
    if kind != "paper":
        report_scores("grasp", evaluate_grasp(planner, product, shared.seed, scenes), shared.as_json)
        return
    with tray_camera(product, load_configuration(shared.config).bench) as camera:
        look = partial(embedded, camera=camera, network=load_crops(crops_file(path)))
        report_scores("grasp", evaluate_grasp(planner, product, shared.seed, scenes, look=look), shared.as_json)


@takes(Shared, "kind", "weights", "seed", "config", "as_json")
def evaluate_semantic_planner(
    shared: Shared,
    certify: Annotated[
        float | None, Option(min=0.0001, max=0.5, help="Share of wrong acts to certify; needs --from.")
    ] = None,
    logs: Annotated[
        list[Path] | None, Option("--from", metavar="LOG", help="With --certify: log of a run; may be repeated.")
    ] = None,
) -> None:
    """Score the semantic planner, or certify its thresholds.

    Kinds: factored, paper, htn, bayes.
    """
    product = product_of(shared.config)
    if certify is not None:
        _certify(certify, logs or [], product, shared)
        return
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
