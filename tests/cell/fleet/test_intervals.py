"""Intervals hold what they promise: known quantiles, and the truth inside as often as they say."""

from __future__ import annotations

import numpy as np
import pytest

from bracket_cell.fleet.intervals import mean, paired_mean, paired_share, student, wilson


@pytest.mark.parametrize(
    ("freedom", "quantile"), [(1, 12.706), (2, 4.303), (4, 2.776), (9, 2.262), (29, 2.045), (1000, 1.962)]
)
def test_quantiles_of_student_are_those_of_the_tables(freedom: int, quantile: float) -> None:
    assert student(0.95, freedom) == pytest.approx(quantile, rel=0.01)


def test_wilson_is_as_published() -> None:
    found = wilson(30, 30)
    assert found.low == pytest.approx(0.8865, abs=1e-3)
    assert found.high == 1.0


@pytest.mark.parametrize("shift", [0.0, 2.0])
def test_the_interval_of_paired_means_holds_the_truth_19_times_of_20(shift: float) -> None:
    rng = np.random.default_rng(7)
    inside = 0
    for _ in range(2000):
        seeds = rng.normal(50, 8, 20)  # what a pair has in common
        ones, others = seeds + rng.normal(0, 3, 20), seeds + rng.normal(shift, 3, 20)
        found = paired_mean(list(ones), list(others))
        inside += found.low <= shift <= found.high
    assert inside / 2000 == pytest.approx(0.95, abs=0.015)


def test_the_interval_of_paired_shares_is_not_too_narrow() -> None:
    rng = np.random.default_rng(7)
    inside = 0
    for _ in range(2000):
        ones, others = rng.random(60) < 0.9, rng.random(60) < 0.9
        found = paired_share(list(ones), list(others))
        inside += found.low <= 0 <= found.high
    assert inside / 2000 >= 0.94


def test_of_one_value_nothing_is_proved() -> None:
    assert not mean([3.0]).proved
    assert not paired_share([], []).proved
    assert not paired_share([True], [False]).proved
