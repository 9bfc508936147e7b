"""Intervals: they hold the share, shrink with the cases, do not collapse at the edges, and fit any number of seeds."""

from __future__ import annotations

import numpy as np
import pytest

from bracket_lab.learned.scores import ScoreCounter, student, wilson


def test_fifty_of_fifty_allow_less_than_all() -> None:
    assert np.allclose(wilson(50, 50), (0.929, 1.0), atol=0.0005)
    assert np.allclose(wilson(0, 50), (0.0, 0.071), atol=0.0005)


def test_intervals_hold_the_share_and_shrink() -> None:
    for count in (10, 100, 1000):
        for right in range(0, count + 1, count // 10):
            low, high = wilson(right, count)
            assert 0.0 <= low <= right / count <= high <= 1.0
            assert high - low < 2.0 / count**0.5
    assert np.allclose(wilson(500, 1000), (0.469, 0.531), atol=0.001)


@pytest.mark.parametrize(("seeds", "factor"), [(2, 12.706), (3, 4.303), (6, 2.571), (7, 2.447), (30, 2.045)])
def test_means_over_any_number_of_seeds(seeds: int, factor: float) -> None:
    numbers = [float(seed % 2) for seed in range(seeds)]
    mean, half = student(numbers)
    spread = (sum((value - mean) ** 2 for value in numbers) / (seeds - 1)) ** 0.5
    assert half == pytest.approx(factor * spread / seeds**0.5, rel=1e-3)
    assert student([0.3]) == (0.3, 0.0)


def test_shares_and_means_are_counted_by_name() -> None:
    counter = ScoreCounter()
    for right in (True, False, True, True):
        counter.add("a", right)
        counter.measure("b", 3.0 * right)
    scores = counter.scores()
    assert (scores["a"], scores["b"]) == (0.75, 2.25)
    assert (scores["a_low"], scores["a_high"]) == wilson(3, 4)
