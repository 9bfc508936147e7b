"""Scores by name, with their intervals, and means over any number of seeds."""

from __future__ import annotations

import pytest

from bracket_cell.fleet.intervals import wilson
from bracket_lab.learned.scores import ScoreCounter, student


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
    assert (scores["a_low"], scores["a_high"]) == wilson(3, 4)[::2]
