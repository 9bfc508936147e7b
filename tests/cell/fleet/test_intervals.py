"""Intervals hold what they promise: known quantiles, and the truth inside as often as they say."""

from __future__ import annotations

import numpy as np
import pytest

from bracket_cell.fleet.intervals import mean, paired_mean, paired_share, wilson


@pytest.mark.parametrize(("count", "quantile"), [(2, 12.706), (3, 4.303), (5, 2.776), (10, 2.262), (30, 2.045)])
def test_means_have_the_quantiles_of_student_s_tables(count: int, quantile: float) -> None:
    values = [float(number % 2) for number in range(count)]
    low, value, high = mean(values)
    assert (high - value) * count**0.5 / np.std(values, ddof=1) == pytest.approx(quantile, rel=1e-3)
    assert value - low == pytest.approx(high - value)


def test_fifty_of_fifty_allow_less_than_all() -> None:
    assert np.allclose(wilson(50, 50), (0.929, 1.0, 1.0), atol=0.0005)
    assert np.allclose(wilson(0, 50), (0.0, 0.0, 0.071), atol=0.0005)


def test_intervals_hold_the_share_and_shrink() -> None:
    for count in (10, 100, 1000):
        for right in range(0, count + 1, count // 10):
            low, _, high = wilson(right, count)
            assert 0.0 <= low <= right / count <= high <= 1.0
            assert high - low < 2.0 / count**0.5
    assert np.allclose(wilson(500, 1000), (0.469, 0.5, 0.531), atol=0.001)


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
