"""The exact joint distribution against sampling, and generated people against their own probabilities."""

from __future__ import annotations

import numpy as np
import pytest

from bracket_cell.learned.semantic.graph import EMPTY, Layout, one_hot
from bracket_cell.learned.semantic.misdetection import misdetect
from bracket_cell.learned.semantic.posterior import BayesPosterior
from bracket_lab.experiments.semantic_demonstrators import (
    HabitSettings,
    drawn_demonstrators,
    generated_demonstrations,
    set_probabilities,
)
from bracket_lab.experiments.semantic_optimum import best_coverage, exact_joint, run_states, trade_off, uniform_states
from bracket_lab.learned.semantic.scenarios import Demonstrators, runs
from tests.learned.products import DEFAULT

LAYOUT = Layout.of(DEFAULT)


def people(strength: float) -> Demonstrators:
    return drawn_demonstrators(LAYOUT, HabitSettings(strength=strength), np.random.default_rng(0))


@pytest.mark.parametrize("strength", [0.0, 1.5])
def test_the_joint_distribution_is_that_of_sampling(strength: float) -> None:
    some = people(strength)
    rng = np.random.default_rng(1)
    true, _ = runs(some, 4000, 5, rng)
    seen = misdetect(LAYOUT, true, rng, 0.1)
    joint = exact_joint(LAYOUT, run_states(LAYOUT, 5, some), 0.1)
    index = {tuple(row): i for i, row in enumerate(joint.seen.tolist())}
    counts = np.zeros_like(joint.goals)
    for goal, row in zip(seen.goals.tolist(), seen.seen.tolist(), strict=True):
        counts[index[tuple(row)], goal] += 1.0
    common = joint.goals > 0.002
    error = np.sqrt(joint.goals / len(seen))
    assert np.isclose(joint.goals.sum(), 1.0)
    assert (np.abs(counts / len(seen) - joint.goals)[common] < 5 * error[common]).all()


def test_without_noise_states_belong_to_the_goals_that_hold_them() -> None:
    joint = exact_joint(LAYOUT, uniform_states(LAYOUT), 0.0)
    assert len(joint.seen) == 183
    assert np.isclose(joint.goal_accuracy(), 183 / 186)


def test_bayes_is_nearly_the_exact_posterior_of_people_without_habits() -> None:
    joint = exact_joint(LAYOUT, run_states(LAYOUT, 5), 0.045)
    posterior = BayesPosterior(LAYOUT, unknown=1e-9)
    believed = np.array([posterior(one_hot(row, 3)).belief[:-1] for row in joint.seen])
    nll = -(joint.goals * np.log(believed)).sum()
    assert joint.goal_nll() <= nll < joint.goal_nll() + 0.001


def test_sets_are_filled_as_often_as_people_say() -> None:
    some = people(1.0)
    probabilities = set_probabilities(some)
    sizes = np.array([bits.bit_count() for bits in range(2**6)])
    for k in range(7):
        assert np.allclose(probabilities[:, sizes == k].sum(axis=1), 1.0)
    assert np.allclose(set_probabilities(people(0.0))[:, sizes == 2], 1 / 15)


def test_a_lower_threshold_covers_more_and_errs_more() -> None:
    belief = np.array([0.9, 0.99, 0.5, 0.9])
    coverage, mistakes = trade_off(belief, 1.0 - belief, np.full(4, 0.25))
    assert np.allclose(coverage, [0.25, 0.75, 1.0])
    assert np.allclose(mistakes, [0.01, 0.07, 0.1775])
    assert best_coverage(coverage, mistakes, 0.1) == pytest.approx(0.75)
    assert best_coverage(coverage, mistakes, 0.001) == 0.0


def test_the_same_seed_demonstrates_the_same() -> None:
    assert generated_demonstrations(DEFAULT, 20, 1.0, 5) == generated_demonstrations(DEFAULT, 20, 1.0, 5)
    assert generated_demonstrations(DEFAULT, 20, 1.0, 5) != generated_demonstrations(DEFAULT, 20, 1.0, 6)
    assert all(len(one.placements) == 6 for one in generated_demonstrations(DEFAULT, 20, 1.0, 5))


def test_runs_are_states_of_their_goals() -> None:
    states, steps = runs(people(2.0), 100, 5, np.random.default_rng(0))
    assert ((states.seen != EMPTY).sum(axis=1) == steps).all()
    assert ((states.seen == EMPTY) | (states.seen == LAYOUT.types[states.goals])).all()
    assert (states.seen[np.arange(len(states)), states.following] == EMPTY).all()


def test_a_camera_that_sees_which_holes_are_filled_takes_false_reports_away() -> None:
    states = uniform_states(LAYOUT)
    reported, seen = (exact_joint(LAYOUT, states, 0.1, holes_seen=camera) for camera in (False, True))
    assert np.isclose(seen.weights.sum(), 1.0)
    assert not ((seen.seen != EMPTY) & ~seen.taken).any()
    assert {tuple(row) for row in seen.taken.astype(int).tolist()} == set(states)
    assert seen.goal_accuracy() > reported.goal_accuracy()
