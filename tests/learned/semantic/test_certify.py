"""Certified thresholds: the guarantee holds over repetitions, and too few runs certify nothing."""

from __future__ import annotations

import numpy as np
import pytest

from bracket_cell.commands.main import main
from bracket_lab.experiments.semantic_certify import CONFIDENCE, Case, binomial_tail, certificate, least_limit


def drawn(count: int, seed: int) -> list[Case]:
    """Cases whose belief is what it says: of those with belief b, a share b is right."""
    rng = np.random.default_rng(seed)
    beliefs = 1.0 - 0.3 * rng.random(count) ** 4
    return [Case(float(belief), bool(rng.random() > belief)) for belief in beliefs]


def test_the_tail_is_the_binomial_distributions() -> None:
    assert binomial_tail(0, 100, 0.01) == pytest.approx(0.99**100)
    assert binomial_tail(3, 3, 0.2) == pytest.approx(1.0)


def test_more_wrong_acts_than_promised_are_rare_over_repetitions() -> None:
    truth = drawn(200_000, 0)
    broken = promised = 0
    for seed in range(1, 101):
        found = certificate(drawn(800, seed), 0.01)
        if found.threshold is None:
            continue
        acts = [case for case in truth if case.belief >= found.threshold]
        promised += 1
        broken += sum(case.wrong for case in acts) / len(acts) > 0.01
    assert promised > 50
    assert broken <= (1.0 - CONFIDENCE) * 100 + 4


def test_few_runs_certify_nothing_and_more_certify_more() -> None:
    assert certificate(drawn(50, 1), 0.01).threshold is None
    few, many = (certificate(drawn(count, 2), 0.02) for count in (400, 4000))
    assert few.threshold is not None
    assert many.threshold is not None
    assert many.coverage >= few.coverage


def test_what_one_threshold_promises_is_the_exact_upper_bound() -> None:
    right = [Case(0.95, False)] * 300
    assert least_limit(right, 0.9) == pytest.approx(1.0 - 0.1 ** (1 / 300), abs=1e-4)
    assert least_limit([*right, Case(0.95, True)], 0.9) > least_limit(right, 0.9)
    assert least_limit([], 0.9) == pytest.approx(1.0)


def test_recorded_runs_are_certified(capsys: pytest.CaptureFixture[str]) -> None:
    logs = [word for name in ("g0-seed5", "g2-seed3") for word in ("--from", f"tests/cases/assembly-{name}.mcap")]
    assert main(["lab", "eval", "semantic", "--certify", "0.01", *logs]) == 0
    told = " ".join(capsys.readouterr().err.split())
    assert "no threshold for at most 1 % wrong acts" in told
    assert "2 runs certify" in told
    assert main(["lab", "eval", "semantic", "--certify", "0.01"]) == 2
