"""Larger products: success beside the bound, and the time of one CPU core to train and to plan."""

from __future__ import annotations

import time
from functools import partial

import numpy as np

from cell.interfaces.product import Product
from learned.lab.experiments import Cell, Values
from learned.lab.semantic_demonstrators import HabitSettings, drawn_demonstrators, whole_demonstrations
from learned.lab.semantic_models import generated_product, planner_of
from learned.semantic.data import states_of
from learned.semantic.evaluate import Answers, success
from learned.semantic.graph import Layout
from learned.semantic.scenarios import sampled

SEEDS = (1, 2, 3)
SIZES = ((6, 3, 3), (20, 8, 30), (40, 12, 100))  # positions, types, goals
DEMONSTRATIONS = 500
TEST_STATES = 500
MANY_SEEDS_POSITIONS = 20  # larger products are tried once


def size_cells(product: Product) -> list[Cell]:
    """Every kind, size and seed."""
    cells = []
    for kind in ("factored", "bayes", "and_or"):
        for positions, types, goals in SIZES:
            seeds = SEEDS if positions <= MANY_SEEDS_POSITIONS else SEEDS[:1]
            for seed in seeds:
                key = {"experiment": "sizes", "kind": kind, "positions": positions, "types": types, "goals": goals}
                key["seed"] = seed
                cells.append(Cell(key, partial(_measure, product, kind, (positions, types, goals), seed)))
    return cells


def _measure(product: Product, kind: str, size: tuple[int, int, int], seed: int) -> Values:
    rng = np.random.default_rng(seed)
    large = generated_product(product, *size, rng)
    layout = Layout.of(large)
    demonstrators = drawn_demonstrators(layout, HabitSettings(strength=0.0), rng)
    train = states_of(layout, whole_demonstrations(demonstrators, DEMONSTRATIONS, rng))
    begin_s = time.process_time()
    planner = planner_of(kind, large, train, seed)
    train_s = time.process_time() - begin_s
    test = sampled(layout, TEST_STATES, rng)
    begin_s = time.process_time()
    scores = success(Answers(planner, layout), layout, test)
    return {**scores, "train_s": train_s, "plan_s": (time.process_time() - begin_s) / TEST_STATES}
