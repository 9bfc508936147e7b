"""Planners straight from training, and generated products, for experiments. Imports torch."""

from __future__ import annotations

from collections.abc import Callable, Mapping

import numpy as np

from bracket_cell.learned.inference.onnx_model import ModelCard
from bracket_cell.learned.semantic.graph import Bools, Floats, Layout
from bracket_cell.learned.semantic.misdetection import Scenarios
from bracket_cell.learned.semantic.model import BayesPlanner, FactoredPlanner
from bracket_cell.learned.semantic.settings import FactoredSettings, PaperSettings
from bracket_ground.interfaces.planning import UNKNOWN_GOAL, AssemblyPlan, SemanticPlanner
from bracket_ground.interfaces.product import Product
from bracket_lab.experiments.experiments import Values
from bracket_lab.experiments.paper.and_or import AndOrGraph, AndOrPlanner
from bracket_lab.experiments.paper.htn import HtnPlanner
from bracket_lab.experiments.semantic_optimum import Joint, best_coverage, trade_off
from bracket_lab.learned.semantic.evaluate import CALIBRATION_BINS, LEAST_PROBABILITY, Answers
from bracket_lab.learned.semantic.paper_planner import PaperPlanner
from bracket_lab.learned.semantic.train import OUTPUTS, Settings, train_network
from bracket_lab.learned.training.torch_model import TorchModel

KINDS = ("factored", "paper", "and_or", "htn", "bayes")
UNTRAINED: Mapping[str, Callable[[Product], SemanticPlanner]] = {"bayes": BayesPlanner, "htn": HtnPlanner}
AS_PRINTED = PaperSettings(aggregation="mean", start="object", noise=0.0)


def planner_of(
    kind: str, product: Product, train: Scenarios, seed: int, settings: Settings | None = None
) -> SemanticPlanner:
    """A planner of any kind, trained on these states where it learns at all."""
    if kind in UNTRAINED:
        return UNTRAINED[kind](product)
    layout = Layout.of(product)
    if kind == "and_or":
        return AndOrPlanner(product, AndOrGraph.of(layout, train))
    chosen = settings or (PaperSettings() if kind == "paper" else FactoredSettings())
    card = ModelCard(
        kind=f"semantic.{kind}",
        config=chosen.model_dump(),
        vocabulary=layout.vocabulary,
        data_sha256=train.sha256,
        command="",
        seed=seed,
    )
    model = TorchModel(train_network(layout, train, chosen, seed), OUTPUTS[kind], card)
    return PaperPlanner(product, model) if kind == "paper" else FactoredPlanner(product, model)


def first_goals(product: Product, count: int) -> Product:
    """The product with its first goals only."""
    goals = dict(list(product.goals.items())[:count])
    return Product.model_validate({**product.model_dump(), "goals": goals, "goal_titles": {}})


def random_goals(product: Product, count: int, rng: np.random.Generator) -> Product:
    """The product with other goals: random arrangements of its parts."""
    parts = [name for name, part in product.parts.items() for _ in range(part.quantity)]
    goals: list[tuple[str, ...]] = []
    while len(goals) < count:
        arrangement = tuple(str(name) for name in rng.permutation(parts))
        if arrangement not in goals:
            goals.append(arrangement)
    named = {f"g{i}": goal for i, goal in enumerate(goals)}
    return Product.model_validate({**product.model_dump(), "goals": named, "goal_titles": {}})


def generated_product(product: Product, positions: int, types: int, goals: int, rng: np.random.Generator) -> Product:
    """A product of any size; shapes are those of the given one's first part, which planners do not look at."""
    shape = next(iter(product.parts.values())).model_dump()
    quantities = np.bincount(np.arange(positions) % types, minlength=types)
    parts = {f"o{i + 1}": {**shape, "quantity": int(quantity)} for i, quantity in enumerate(quantities)}
    holes = {f"p{i + 1}": (0.0, 0.08 * i) for i in range(positions)}
    arrangement = tuple(f"o{i % types + 1}" for i in range(positions))
    bracket = {**product.bracket.model_dump(), "holes_m": holes}
    one = {**product.model_dump(), "parts": parts, "bracket": bracket, "goals": {"g0": arrangement}, "goal_titles": {}}
    return random_goals(Product.model_validate(one), goals, rng)


WRONG_LIMIT = 0.003  # the bar: the largest share of wrong placements ...
ACT = 0.9  # ... at this threshold of the posterior


def exact_scores(answers: Answers, joint: Joint) -> Values:
    """Goal accuracy (also by number of filled holes), calibration, and wrong placements against coverage."""
    layout = joint.layout
    plans = [answers(row) for row in joint.seen]
    believed = np.array([[plan.goal_belief[goal] for goal in layout.goals] for plan in plans])
    unknown = np.array([plan.goal_belief.get(UNKNOWN_GOAL, 0.0) for plan in plans])
    best = np.array([_best_placement(plan, layout, taken) for plan, taken in zip(plans, joint.taken, strict=True)])
    return score(joint, believed, unknown, best)


def optimal_scores(joint: Joint) -> Values:
    """The same scores of the exact posterior, which no planner beats."""
    exact = joint.next_beliefs().reshape(len(joint.seen), -1)
    best = np.column_stack([exact.max(axis=1), exact.argmax(axis=1)])
    return score(joint, joint.goals / joint.weights[:, None], np.zeros(len(joint.seen)), best)


def score(joint: Joint, believed: Floats, unknown: Floats, best: Floats) -> Values:
    """Scores of beliefs.

    Args:
        believed: (R, z) in the goals.
        unknown: (R,) in none of them; scores of calibration are of what is believed of the goals.
        best: (R, 2) belief in the best placement, and which it is as type m + position.
    """
    rows = np.arange(len(joint.seen))
    weights = joint.weights
    right = joint.goals[rows, believed.argmax(axis=1)]
    count = joint.taken.sum(axis=1)
    exact = joint.next_beliefs().reshape(len(rows), -1)
    wrong = 1.0 - exact[rows, best[:, 1].astype(int)]
    coverage, mistakes = trade_off(best[:, 0], wrong, weights)
    acting = best[:, 0] >= ACT
    acted = max(float(weights[acting].sum()), 1e-12)
    by_count = {
        f"goal_accuracy_{k}": float(right[count == k].sum() / weights[count == k].sum()) for k in np.unique(count)
    }
    return {
        "goal_accuracy": float(right.sum()),
        **by_count,
        "goal_nll": float(-(joint.goals * np.log(np.maximum(believed, LEAST_PROBABILITY))).sum()),
        "goal_calibration_error": _calibration_error(believed, right, weights),
        "next_calibration_error": _calibration_error(best[:, :1], weights - wrong * weights, weights),
        "unknown": float(unknown @ weights),
        "wrong_always": float(wrong @ weights),
        "coverage_at_act": float(weights[acting].sum()),
        "wrong_at_act": float((wrong * weights)[acting].sum() / acted),
        "best_coverage": best_coverage(coverage, mistakes, WRONG_LIMIT),
        "curve": [[round(float(c), 5), round(float(w), 6)] for c, w in zip(coverage, mistakes, strict=True)],
    }


def _best_placement(plan: AssemblyPlan, layout: Layout, taken: Bools) -> tuple[float, int]:
    """Belief in the best placement into a hole that is not taken (m,), and its index; without any, no belief."""
    positions = layout.positions
    possible = {key: belief for key, belief in plan.next_belief.items() if not taken[positions.index(key[1])]}
    if not possible:
        return 0.0, int(np.argmin(taken))
    (part, position), belief = max(possible.items(), key=lambda item: item[1])
    return belief, layout.parts.index(part) * len(positions) + positions.index(position)


def _calibration_error(believed: Floats, right: Floats, weights: Floats) -> float:
    """Expected difference between belief in the best answer and how often it is right, in CALIBRATION_BINS bins."""
    best = believed.max(axis=1)
    bins = np.minimum((best * CALIBRATION_BINS).astype(int), CALIBRATION_BINS - 1)
    gaps = [abs(float((best * weights - right)[bins == i].sum())) for i in range(CALIBRATION_BINS)]
    return sum(gaps)
