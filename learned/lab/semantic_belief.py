"""Belief under misdetections (Fig. 13), its calibration, wrong placements against coverage, and unknown goals."""

from __future__ import annotations

from functools import partial

import numpy as np

from cell.interfaces.product import Product
from learned.lab.experiments import Cell, Values
from learned.lab.semantic_models import KINDS, exact_scores, optimal_scores, planner_of
from learned.lab.semantic_optimum import exact_joint, run_states, uniform_states
from learned.semantic.evaluate import Answers, under_noise
from learned.semantic.graph import Layout
from learned.semantic.scenarios import TRAIN_RATIO, scenarios, split
from learned.semantic.settings import DETECTION_ERROR

SEEDS = (1, 2, 3, 4, 5)
ERRORS = (0.0, DETECTION_ERROR, 0.1)
OPTIMUM = "optimum"


def belief_cells(product: Product) -> list[Cell]:
    """Every kind and seed; the optimum and `bayes` learn nothing, so for them one seed is all."""
    cells = []
    for kind in (OPTIMUM, *KINDS):
        for seed in SEEDS if kind not in (OPTIMUM, "bayes") else SEEDS[:1]:
            key = {"experiment": "belief", "kind": kind, "seed": seed}
            cells.append(Cell(key, partial(_measure, product, kind, seed)))
    return cells


def _measure(product: Product, kind: str, seed: int) -> Values:
    layout = Layout.of(product)
    depth = len(layout.positions) - 1
    joints = {f"runs_{error}": exact_joint(layout, run_states(layout, depth), error) for error in ERRORS}
    joints["uniform"] = exact_joint(layout, uniform_states(layout), DETECTION_ERROR)
    joints["uniform_seen"] = exact_joint(layout, uniform_states(layout), DETECTION_ERROR, holes_seen=True)
    joints["runs_seen"] = exact_joint(layout, run_states(layout, depth), DETECTION_ERROR, holes_seen=True)
    if kind == OPTIMUM:
        return {name: optimal_scores(joint) for name, joint in joints.items()}
    train, _ = split(scenarios(layout, seed), TRAIN_RATIO, seed)
    answers = Answers(planner_of(kind, product, train, seed), layout)
    sampled = under_noise(answers, layout, np.random.default_rng([seed, 1]))
    return {
        **{name: exact_scores(answers, joint) for name, joint in joints.items()},
        "unknown_goals": {name: value for name, value in sampled.items() if name.startswith("unknown")},
    }
