"""Success against the share of scenarios that is trained on, for 1, 2 and 3 goals (Fig. 11)."""

from __future__ import annotations

from functools import partial
from itertools import product as product_of

from cell.interfaces.product import Product
from learned.lab.experiments import Cell, Values
from learned.lab.semantic_models import AS_PRINTED, KINDS, first_goals, planner_of
from learned.semantic.evaluate import Answers, success
from learned.semantic.graph import Layout
from learned.semantic.scenarios import TRAIN_RATIO, from_the_right, scenarios, split, sub_demonstrations
from learned.semantic.settings import PaperSettings

RATIOS = (0.2, 0.3, 0.4, 0.6, TRAIN_RATIO, 0.9)
FEW_RATIOS = (0.2, 0.4, TRAIN_RATIO)  # with sub-demonstrations
SEEDS = (1, 2, 3, 4, 5)
RIGHTMOST = {"paper as printed": AS_PRINTED, "paper, tuned": PaperSettings()}


def ratio_cells(product: Product) -> list[Cell]:
    """Every kind, number of goals, ratio and seed; with all goals also with sub-demonstrations."""
    cells = []
    most = len(product.goals)
    for augment in (False, True):
        for count in range(most, most - 1 if augment else 0, -1):
            some = first_goals(product, count)
            ratios = FEW_RATIOS if augment else RATIOS
            for kind, ratio, seed in product_of(KINDS, ratios, SEEDS):
                key = {"experiment": "ratios", "kind": kind, "goals": count, "ratio": ratio, "seed": seed}
                if kind != "bayes" or not augment:
                    measure = partial(_measure, some, kind, ratio, seed, augment)
                    cells.append(Cell({**key, "sub_demonstrations": augment}, measure))
    for ratio, seed, (name, chosen) in product_of(FEW_RATIOS, SEEDS[:3], RIGHTMOST.items()):
        key = {"experiment": "ratios", "kind": name, "goals": most, "ratio": ratio, "seed": seed}
        cells.append(Cell({**key, "sub_demonstrations": False}, partial(_rightmost, product, ratio, seed, chosen)))
    return cells


def _rightmost(product: Product, ratio: float, seed: int, settings: PaperSettings) -> Values:
    """The paper's network on demonstrators who always place the first missing object from the right."""
    layout = Layout.of(product)
    whole = from_the_right(scenarios(layout, seed))
    train, held_out = split(whole, ratio, seed)
    answers = Answers(planner_of("paper", product, train, seed, settings), layout)
    return {
        **{f"{name}_all": value for name, value in success(answers, layout, whole).items()},
        **{f"{name}_held_out": value for name, value in success(answers, layout, held_out).items()},
    }


def _measure(product: Product, kind: str, ratio: float, seed: int, augment: bool) -> Values:
    layout = Layout.of(product)
    whole = scenarios(layout, seed)
    train, held_out = split(whole, ratio, seed)
    shown = sub_demonstrations(layout, train) if augment else train
    answers = Answers(planner_of(kind, product, shown, seed), layout)
    return {
        **{f"{name}_all": value for name, value in success(answers, layout, whole).items()},
        **{f"{name}_held_out": value for name, value in success(answers, layout, held_out).items()},
    }
