"""`cell lab eval grasp|semantic`: the planners' scores."""

from __future__ import annotations

from functools import partial
from typing import Annotated

from typer import Option

from bracket_cell.commands.options import command_from
from bracket_cell.commands.terminal import product_of, report_scores
from bracket_cell.configuration import load_configuration
from bracket_cell.learned.grasp.crops import load_crops
from bracket_ground.interfaces.planning import SemanticPlanner, crops_file
from bracket_lab.commands.shared import Shared
from bracket_lab.commands.training.weights import shipped_weights
from bracket_lab.experiments.paper.htn import HtnPlanner
from bracket_lab.learned.grasp.evaluate import AlwaysGrasp, embedded, evaluate_grasp
from bracket_lab.learned.grasp.paper_planner import load_grasp_planner
from bracket_lab.learned.semantic.evaluate import evaluate_semantic
from bracket_lab.learned.semantic.paper_planner import load_semantic_planner
from bracket_lab.wiring.drawn_frames import tray_camera


@command_from(Shared, "kind", "weights", "seed", "config", "as_json")
def evaluate_grasp_planner(
    shared: Shared, scenes: Annotated[int, Option(min=4, help="Number of test scenes.")] = 1000
) -> None:
    """Score the grasp planner, beside the one that always grasps. Kinds: pairwise, paper, rule, always."""
    product = product_of(shared.config)
    kind = shared.one_kind(("pairwise", "paper", "rule", "always"))
    scored = partial(evaluate_grasp, product=product, seed=shared.seed, scenes=scenes)
    scores = trivial = scored(AlwaysGrasp())
    if kind != "always":
        path = shared.weights or shipped_weights("grasp", kind)
        planner = load_grasp_planner(kind, path, product)
        if kind != "paper":
            scores = scored(planner)
        else:
            with tray_camera(product, load_configuration(shared.config).bench) as camera:
                look = partial(embedded, camera=camera, network=load_crops(crops_file(path)))
                scores = scored(planner, look=look)
        shares = (name for name in trivial if not name.startswith(("steps", "needless")))
        scores |= {f"always_{name}": trivial[name] for name in shares}
    report_scores("grasp", scores, shared.as_json)


@command_from(Shared, "kind", "weights", "seed", "config", "as_json")
def evaluate_semantic_planner(shared: Shared) -> None:
    """Score the semantic planner. Kinds: factored, paper, htn, bayes."""
    product = product_of(shared.config)
    kind = shared.one_kind(("factored", "paper", "htn", "bayes", "auto"))
    planner: SemanticPlanner = HtnPlanner(product)
    if kind != "htn":
        planner = load_semantic_planner(kind, shared.weights or shipped_weights("semantic", kind), product)
    report_scores("semantic", evaluate_semantic(planner, product, shared.seed), shared.as_json)
