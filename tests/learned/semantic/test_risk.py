"""The robot acts from a probability on that keeps few of its acts wrong, by what the planner expects."""

from __future__ import annotations

import numpy as np
import pytest

from bracket_cell.learned.semantic.confusions import Confusions
from bracket_cell.learned.semantic.goals import FinishedGoal, OpenGoals
from bracket_cell.learned.semantic.graph import Layout
from bracket_cell.learned.semantic.model import BayesPlanner
from bracket_cell.learned.semantic.risk import act_probability
from bracket_ground.interfaces.product import Product
from bracket_lab.experiments.semantic_streams import NEVER, assemble, unlisted
from tests.learned.products import DEFAULT

pytestmark = pytest.mark.torch
LAYOUT = Layout.of(DEFAULT)
CONFUSIONS = Confusions.of(LAYOUT, "alike types", 0.05)


def goals(product: Product, more: int, seed: int = 1) -> OpenGoals:
    """The product's goals, and so many others, each finished four times."""
    found = {
        f"new{number}": FinishedGoal(parts=tuple(LAYOUT.parts[part] for part in types), finished=4)
        for number, types in enumerate(unlisted(LAYOUT, more, np.random.default_rng(seed)))
    }
    return OpenGoals(product, found)


def threshold(known: OpenGoals, wrong_share: float = 0.02, least: float = 0.9) -> float:
    return act_probability(BayesPlanner(DEFAULT, known, CONFUSIONS), known, CONFUSIONS, least, wrong_share)


def test_the_products_own_goals_leave_the_threshold_as_it_is() -> None:
    assert threshold(OpenGoals.of(DEFAULT)) == 0.9
    assert threshold(OpenGoals.of(DEFAULT), wrong_share=0.001) == 0.9


def test_many_goals_in_use_ask_for_more_and_never_for_less() -> None:
    some = [threshold(goals(DEFAULT, 9), share) for share in (1.0, 0.05, 0.02, 0.01)]
    assert some[0] == 0.9
    assert some == sorted(some)
    assert some[2] > 0.92
    assert threshold(goals(DEFAULT, 9), least=0.99) == 0.99


def test_the_same_goals_give_the_same_threshold() -> None:
    assert threshold(goals(DEFAULT, 9)) == threshold(goals(DEFAULT, 9))


def test_wrong_acts_stay_near_what_was_asked_for() -> None:
    known = goals(DEFAULT, 9, seed=3)
    planner, act, rng = BayesPlanner(DEFAULT, known, CONFUSIONS), threshold(known), np.random.default_rng(5)
    layout = planner.layout
    states = [
        state
        for _ in range(250)
        for state in assemble(
            planner, layout, layout.types[rng.integers(len(layout.goals))], CONFUSIONS, rng, NEVER, act
        )
    ]
    acts = [state["wrong"] for state in states if state["acts"]]
    assert len(acts) > 0.25 * len(states)
    assert sum(acts) <= 0.02 * len(acts) + 2.5 * (0.02 * len(acts)) ** 0.5
