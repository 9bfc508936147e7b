"""Demonstrators with ordering habits: what is gained by learning them, beside exact inference that knows them."""

from __future__ import annotations

from functools import partial

import numpy as np

from cell.interfaces.product import Product
from learned.lab.experiments import Cell, Values
from learned.lab.semantic_belief import OPTIMUM
from learned.lab.semantic_demonstrators import HabitSettings, drawn_demonstrators, whole_demonstrations
from learned.lab.semantic_models import exact_scores, optimal_scores, planner_of
from learned.lab.semantic_optimum import exact_joint, run_states
from learned.semantic.data import states_of
from learned.semantic.evaluate import Answers
from learned.semantic.graph import Layout
from learned.semantic.settings import DETECTION_ERROR

SEEDS = tuple(range(1, 11))
STRENGTHS = (0.0, 0.5, 1.0, 2.0)
DEMONSTRATIONS = 200


def habit_cells(product: Product) -> list[Cell]:
    """Every strength of the habits and seed of the demonstrators; the paper's network takes too long to train."""
    cells = []
    for kind in (OPTIMUM, "factored", "bayes", "and_or"):
        for strength in STRENGTHS:
            for seed in SEEDS:
                key = {"experiment": "habits", "kind": kind, "strength": strength, "seed": seed}
                cells.append(Cell(key, partial(_measure, product, kind, strength, seed)))
    return cells


def _measure(product: Product, kind: str, strength: float, seed: int) -> Values:
    layout = Layout.of(product)
    rng = np.random.default_rng(seed)
    demonstrators = drawn_demonstrators(layout, HabitSettings(strength=strength), rng)
    joint = exact_joint(layout, run_states(layout, len(layout.positions) - 1, demonstrators), DETECTION_ERROR)
    if kind == OPTIMUM:
        return optimal_scores(joint)
    train = states_of(layout, whole_demonstrations(demonstrators, DEMONSTRATIONS, rng))
    return exact_scores(Answers(planner_of(kind, product, train, seed), layout), joint)
