"""Scenarios: their number, the exact bound, splits, noise and sub-demonstrations."""

from __future__ import annotations

import numpy as np

from bracket_cell.learned.semantic.graph import EMPTY, Layout, action_pairs
from bracket_lab.learned.semantic.misdetection import misdetect
from bracket_lab.learned.semantic.scenarios import (
    SCENARIO_LIMIT,
    bound,
    consistent,
    scenarios,
    split,
    sub_demonstrations,
    unknown_goals,
)
from tests.learned.products import DEFAULT, HARDER, with_goals

LAYOUT = Layout.of(DEFAULT)


def test_every_partial_state_of_every_goal_once() -> None:
    whole = scenarios(LAYOUT, 0)
    assert len(whole) == 186
    assert len({(goal, *seen) for goal, seen in zip(whole.goals.tolist(), whole.seen.tolist(), strict=True)}) == 186
    assert consistent(LAYOUT, whole.seen)[np.arange(186), whole.goals].all()
    assert (whole.seen[np.arange(186), whole.following] == EMPTY).all()


def test_the_bound_is_the_share_of_distinct_states() -> None:
    for product, states in ((DEFAULT, 183), (HARDER, 180)):
        layout = Layout.of(product)
        whole = scenarios(layout, 0)
        assert len({tuple(row) for row in whole.seen.tolist()}) == states
        assert np.isclose(bound(layout, whole), states / 186)


def test_the_default_product_has_the_papers_action_classes() -> None:
    assert len(action_pairs(LAYOUT)) == 15


def test_splits_divide_the_scenarios_and_follow_the_seed() -> None:
    whole = scenarios(LAYOUT, 0)
    train, test = split(whole, 0.77, 1)
    assert (len(train), len(test)) == (143, 43)
    rows = np.concatenate([np.column_stack([part.goals, part.seen]) for part in (train, test)])
    assert len(np.unique(rows, axis=0)) == 186
    assert split(whole, 0.77, 1)[0].sha256 == train.sha256 != split(whole, 0.77, 2)[0].sha256


def test_sub_demonstrations_are_the_states_on_the_way() -> None:
    whole = scenarios(LAYOUT, 0)
    row = np.flatnonzero((whole.goals == 1) & ((whole.seen != EMPTY).sum(axis=1) == 4))[:1]
    states = sub_demonstrations(LAYOUT, whole.take(row))
    assert len(states) == 2**4 - 1
    assert (states.goals == 1).all()
    assert ((states.seen == EMPTY) | (states.seen == whole.seen[row])).all()


def test_misdetection_swaps_placements_for_others_at_the_given_rate() -> None:
    rng = np.random.default_rng(0)
    whole = scenarios(LAYOUT, 0)
    assert misdetect(LAYOUT, whole, rng, 0.0).sha256 == whole.sha256
    changed = 0
    for _ in range(20):
        noisy = misdetect(LAYOUT, whole, rng, 0.1)
        assert ((noisy.seen != EMPTY).sum(axis=1) == (whole.seen != EMPTY).sum(axis=1)).all()
        changed += int(((noisy.seen != whole.seen) & (whole.seen != EMPTY)).sum())
    assert 0.09 < changed / (20 * int((whole.seen != EMPTY).sum())) < 0.11
    pairs = {(int(part), place) for row in noisy.seen for place, part in enumerate(row) if part != EMPTY}
    assert pairs == set(action_pairs(LAYOUT))


def test_noise_for_training_never_shows_another_state_of_the_same_goal() -> None:
    whole = scenarios(LAYOUT, 0)
    noisy = misdetect(LAYOUT, whole, np.random.default_rng(0), 0.3, contradicting=True)
    changed = (noisy.seen != whole.seen).any(axis=1)
    assert changed.sum() > 50
    assert not consistent(LAYOUT, noisy.seen)[changed, whole.goals[changed]].any()


def test_unknown_goals_use_the_same_parts_and_are_none_of_the_goals() -> None:
    others = unknown_goals(LAYOUT, np.ones((500, 6), bool), np.random.default_rng(0))
    assert len(others) == 500
    assert (np.sort(others.seen, axis=1) == np.sort(LAYOUT.types[0])).all()
    assert not consistent(LAYOUT, others.seen).any()


def test_large_products_are_sampled() -> None:
    parts = {f"o{i}": {**DEFAULT.parts["o1"].model_dump(), "quantity": 1} for i in range(15)}
    holes = {f"p{i}": (0.0, 0.1 * i) for i in range(15)}
    product = with_goals("111223")
    large = type(product).model_validate(
        {
            **product.model_dump(),
            "parts": parts,
            "bracket": {**product.bracket.model_dump(), "holes_m": holes},
            "goals": {"forwards": tuple(parts), "backwards": tuple(reversed(parts))},
            "goal_titles": {},
        }
    )
    whole = scenarios(Layout.of(large), 0)
    assert len(whole) == SCENARIO_LIMIT
    assert scenarios(Layout.of(large), 0).sha256 == whole.sha256
