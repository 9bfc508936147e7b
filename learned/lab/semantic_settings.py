"""Which settings of the learned planners are best, judged on validation products that no reported number is from."""

from __future__ import annotations

from functools import partial

import numpy as np

from cell.interfaces.product import Product
from learned.lab.experiments import Cell, Values
from learned.lab.semantic_demonstrators import HabitSettings, drawn_demonstrators, whole_demonstrations
from learned.lab.semantic_models import exact_scores, planner_of, random_goals
from learned.lab.semantic_optimum import exact_joint, run_states
from learned.semantic.data import states_of
from learned.semantic.evaluate import Answers, success
from learned.semantic.graph import Layout
from learned.semantic.scenarios import scenarios, split
from learned.semantic.settings import DETECTION_ERROR, FactoredSettings, PaperSettings
from learned.semantic.train import Settings

VALIDATION_SEEDS = (1000, 1001, 1002)  # of products, splits and demonstrators; reported seeds are small numbers
RATIOS = (0.2, 0.77)
STRENGTHS = (0.0, 1.0, 2.0)
DEMONSTRATIONS = 200

PAPER_CANDIDATES: dict[str, Settings] = {
    "sum, noise .1": PaperSettings(),
    "mean": PaperSettings(aggregation="mean"),
    "both directions": PaperSettings(direction="both"),
    "noise .05": PaperSettings(noise=0.05),
    "noise .2": PaperSettings(noise=0.2),
    "300 steps": PaperSettings(steps=300),
    "rate .01": PaperSettings(learning_rate=0.01),
    "decay 1e-4": PaperSettings(weight_decay=1e-4),
    "hidden 96": PaperSettings(hidden=96),
}
FACTORED_CANDIDATES: dict[str, Settings] = {
    f"own {own}, shared {shared}": FactoredSettings(habit_scale=own, shared_scale=shared)
    for own, shared in ((0.1, 0.3), (0.3, 0.5), (0.6, 0.5), (1.0, 1.0), (3.0, 3.0))
}


def settings_cells(product: Product) -> list[Cell]:
    """Every candidate on every validation product."""
    cells = []
    for seed in VALIDATION_SEEDS:
        other = random_goals(product, len(product.goals), np.random.default_rng(seed))
        for ratio in RATIOS:
            for name, chosen in PAPER_CANDIDATES.items():
                key = {"experiment": "settings", "kind": "paper", "candidate": name, "ratio": ratio, "seed": seed}
                cells.append(Cell(key, partial(_held_out, other, ratio, seed, chosen)))
        for strength in STRENGTHS:
            for name, chosen in FACTORED_CANDIDATES.items():
                key = {"experiment": "settings", "kind": "factored", "candidate": name, "strength": strength}
                key["seed"] = seed
                cells.append(Cell(key, partial(_with_habits, other, strength, seed, chosen)))
    return cells


def _held_out(product: Product, ratio: float, seed: int, settings: Settings) -> Values:
    layout = Layout.of(product)
    train, held_out = split(scenarios(layout, seed), ratio, seed)
    answers = Answers(planner_of("paper", product, train, seed, settings), layout)
    return success(answers, layout, held_out)


def _with_habits(product: Product, strength: float, seed: int, settings: Settings) -> Values:
    layout = Layout.of(product)
    rng = np.random.default_rng(seed)
    demonstrators = drawn_demonstrators(layout, HabitSettings(strength=strength), rng)
    train = states_of(layout, whole_demonstrations(demonstrators, DEMONSTRATIONS, rng))
    joint = exact_joint(layout, run_states(layout, len(layout.positions) - 1, demonstrators), DETECTION_ERROR)
    return exact_scores(Answers(planner_of("factored", product, train, seed, settings), layout), joint)
