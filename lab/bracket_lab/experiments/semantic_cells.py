"""Cells of the experiments: a planner of one kind, taught with one seed, scored under one condition."""

from __future__ import annotations

import time
from functools import partial
from itertools import product as product_of

import numpy as np

from bracket_cell.learned.semantic.graph import Layout
from bracket_cell.learned.semantic.misdetection import Scenarios
from bracket_cell.learned.semantic.settings import DETECTION_ERROR, FactoredSettings, PaperSettings
from bracket_ground.interfaces.product import Product
from bracket_lab.experiments.experiments import Cell, Values
from bracket_lab.experiments.semantic_demonstrators import HabitSettings, drawn_demonstrators, whole_demonstrations
from bracket_lab.experiments.semantic_models import (
    AS_PRINTED,
    KINDS,
    UNTRAINED,
    exact_scores,
    first_goals,
    generated_product,
    optimal_scores,
    planner_of,
    random_goals,
)
from bracket_lab.experiments.semantic_optimum import Joint, exact_joint, run_states, uniform_states
from bracket_lab.learned.semantic.data import states_of
from bracket_lab.learned.semantic.evaluate import Answers, success, under_noise
from bracket_lab.learned.semantic.scenarios import (
    TRAIN_RATIO,
    from_the_right,
    sampled,
    scenarios,
    split,
    sub_demonstrations,
)
from bracket_lab.learned.semantic.train import Settings

OPTIMUM = "optimum"
SEEDS = (1, 2, 3, 4, 5)

RATIOS = (0.2, 0.3, 0.4, 0.6, TRAIN_RATIO, 0.9)
FEW_RATIOS = (0.2, 0.4, TRAIN_RATIO)  # with sub-demonstrations
RIGHTMOST = {"paper, near its equations": AS_PRINTED, "paper, tuned": PaperSettings()}

ERRORS = (0.0, DETECTION_ERROR, 0.1)

HABIT_SEEDS = tuple(range(1, 11))
HABIT_STRENGTHS = (0.0, 0.5, 1.0, 2.0)
HABIT_DEMONSTRATIONS = 200

SIZE_SEEDS = (1, 2, 3)
SIZES = ((6, 3, 3), (20, 8, 30), (40, 12, 100))  # positions, types, goals
SIZE_DEMONSTRATIONS = 500
TEST_STATES = 500
MANY_SEEDS_POSITIONS = 20  # larger products are tried once

VALIDATION_SEEDS = (1000, 1001, 1002)  # of products, splits and demonstrators; reported seeds are small numbers
VALIDATION_RATIOS = (0.2, 0.77)
VALIDATION_STRENGTHS = (0.0, 1.0, 2.0)
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


def ratio_cells(product: Product) -> list[Cell]:
    """Success against the share of scenarios that is trained on, for 1, 2 and 3 goals (Fig. 11).

    Every kind, number of goals, ratio and seed; with all goals also with sub-demonstrations.
    """
    cells = []
    most = len(product.goals)
    for augment in (False, True):
        for count in range(most, most - 1 if augment else 0, -1):
            some = first_goals(product, count)
            ratios = FEW_RATIOS if augment else RATIOS
            for kind, ratio, seed in product_of(KINDS, ratios, SEEDS):
                key = {"experiment": "ratios", "kind": kind, "goals": count, "ratio": ratio, "seed": seed}
                if kind not in UNTRAINED or not augment:
                    measure = partial(_by_ratio, some, kind, ratio, seed, augment=augment)
                    cells.append(Cell({**key, "sub_demonstrations": augment}, measure))
    for ratio, seed, (name, chosen) in product_of(FEW_RATIOS, SEEDS[:3], RIGHTMOST.items()):
        key = {"experiment": "ratios", "kind": name, "goals": most, "ratio": ratio, "seed": seed}
        measure = partial(_by_ratio, product, "paper", ratio, seed, settings=chosen, rightmost=True)
        cells.append(Cell({**key, "sub_demonstrations": False}, measure))
    return cells


def _by_ratio(
    product: Product,
    kind: str,
    ratio: float,
    seed: int,
    *,
    augment: bool = False,
    settings: Settings | None = None,
    rightmost: bool = False,
) -> Values:
    """Args:
    rightmost: of demonstrators who always place the first missing object from the right.
    """
    layout = Layout.of(product)
    whole = scenarios(layout, seed)
    whole = from_the_right(whole) if rightmost else whole
    train, held_out = split(whole, ratio, seed)
    train = sub_demonstrations(layout, train) if augment else train
    answers = Answers(planner_of(kind, product, train, seed, settings), layout)
    return {
        **{f"{name}_all": value for name, value in success(answers, layout, whole).items()},
        **{f"{name}_held_out": value for name, value in success(answers, layout, held_out).items()},
    }


def belief_cells(product: Product) -> list[Cell]:
    """Belief under misdetections (Fig. 13), its calibration, wrong placements against coverage, and unknown goals.

    Every kind and seed; one seed is enough for what learns nothing.
    """
    cells = []
    for kind in (OPTIMUM, *KINDS):
        for seed in SEEDS if kind not in (OPTIMUM, *UNTRAINED) else SEEDS[:1]:
            key = {"experiment": "belief", "kind": kind, "seed": seed}
            cells.append(Cell(key, partial(_belief, product, kind, seed)))
    return cells


def _belief(product: Product, kind: str, seed: int) -> Values:
    layout = Layout.of(product)
    runs, uniform = run_states(layout, len(layout.positions) - 1), uniform_states(layout)
    joints = {f"runs_{error}": exact_joint(layout, runs, error) for error in ERRORS}
    joints["uniform"] = exact_joint(layout, uniform, DETECTION_ERROR)
    joints["uniform_seen"] = exact_joint(layout, uniform, DETECTION_ERROR, holes_seen=True)
    joints["runs_seen"] = exact_joint(layout, runs, DETECTION_ERROR, holes_seen=True)
    if kind == OPTIMUM:
        return {name: optimal_scores(joint) for name, joint in joints.items()}
    train, _ = split(scenarios(layout, seed), TRAIN_RATIO, seed)
    answers = Answers(planner_of(kind, product, train, seed), layout)
    noisy = under_noise(answers, layout, np.random.default_rng([seed, 1]))
    return {
        **{name: exact_scores(answers, joint) for name, joint in joints.items()},
        "unknown_goals": {name: value for name, value in noisy.items() if name.startswith("unknown")},
    }


def habit_cells(product: Product) -> list[Cell]:
    """What is gained by learning people's order, beside exact inference that knows it.

    Every strength of the habits and seed of the demonstrators; the paper's network takes too long to train.
    """
    cells = []
    for kind, strength, seed in product_of((OPTIMUM, "factored", "bayes", "and_or"), HABIT_STRENGTHS, HABIT_SEEDS):
        key = {"experiment": "habits", "kind": kind, "strength": strength, "seed": seed}
        cells.append(Cell(key, partial(_with_habits, product, kind, strength, seed)))
    return cells


def _with_habits(product: Product, kind: str, strength: float, seed: int, settings: Settings | None = None) -> Values:
    layout = Layout.of(product)
    joint, train = _habits(layout, strength, seed)
    if kind == OPTIMUM:
        return optimal_scores(joint)
    return exact_scores(Answers(planner_of(kind, product, train, seed, settings), layout), joint)


def _habits(layout: Layout, strength: float, seed: int) -> tuple[Joint, Scenarios]:
    """Reports of what people with habits do, and the states of their demonstrations."""
    rng = np.random.default_rng(seed)
    demonstrators = drawn_demonstrators(layout, HabitSettings(strength=strength), rng)
    joint = exact_joint(layout, run_states(layout, len(layout.positions) - 1, demonstrators), DETECTION_ERROR)
    return joint, states_of(layout, whole_demonstrations(demonstrators, HABIT_DEMONSTRATIONS, rng))


def size_cells(product: Product) -> list[Cell]:
    """Larger products: success beside the bound, and the time of one CPU core to train and to plan."""
    cells = []
    for kind in ("factored", "bayes", "and_or"):
        for positions, types, goals in SIZES:
            seeds = SIZE_SEEDS if positions <= MANY_SEEDS_POSITIONS else SIZE_SEEDS[:1]
            for seed in seeds:
                key = {"experiment": "sizes", "kind": kind, "positions": positions, "types": types, "goals": goals}
                key["seed"] = seed
                cells.append(Cell(key, partial(_of_size, product, kind, (positions, types, goals), seed)))
    return cells


def _of_size(product: Product, kind: str, size: tuple[int, int, int], seed: int) -> Values:
    rng = np.random.default_rng(seed)
    large = generated_product(product, *size, rng)
    layout = Layout.of(large)
    demonstrators = drawn_demonstrators(layout, HabitSettings(strength=0.0), rng)
    train = states_of(layout, whole_demonstrations(demonstrators, SIZE_DEMONSTRATIONS, rng))
    begin_s = time.process_time()
    planner = planner_of(kind, large, train, seed)
    train_s = time.process_time() - begin_s
    test = sampled(layout, TEST_STATES, rng)
    begin_s = time.process_time()
    scores = success(Answers(planner, layout), layout, test)
    return {**scores, "train_s": train_s, "plan_s": (time.process_time() - begin_s) / TEST_STATES}


def settings_cells(product: Product) -> list[Cell]:
    """Which settings of the learned planners are best, judged on products that no reported number is from.

    Every candidate on every validation product.
    """
    cells = []
    for seed in VALIDATION_SEEDS:
        other = random_goals(product, len(product.goals), np.random.default_rng(seed))
        for ratio, (name, chosen) in product_of(VALIDATION_RATIOS, PAPER_CANDIDATES.items()):
            key = {"experiment": "settings", "kind": "paper", "candidate": name, "ratio": ratio, "seed": seed}
            cells.append(Cell(key, partial(_held_out, other, ratio, seed, chosen)))
        for strength, (name, chosen) in product_of(VALIDATION_STRENGTHS, FACTORED_CANDIDATES.items()):
            key = {"experiment": "settings", "kind": "factored", "candidate": name, "strength": strength}
            key["seed"] = seed
            cells.append(Cell(key, partial(_with_habits, other, "factored", strength, seed, chosen)))
    return cells


def _held_out(product: Product, ratio: float, seed: int, settings: Settings) -> Values:
    layout = Layout.of(product)
    train, held_out = split(scenarios(layout, seed), ratio, seed)
    answers = Answers(planner_of("paper", product, train, seed, settings), layout)
    return success(answers, layout, held_out)
