"""`cell run` killed by SIGKILL: its log lacks at most the tick under way."""

from __future__ import annotations

import random

import pytest
from rich.console import Console

from tests.benchmarks.sigkill import kill_once


@pytest.mark.long
@pytest.mark.parametrize("seed", [0, *(pytest.param(seed, marks=pytest.mark.slow) for seed in (1, 2))])
def test_a_killed_run_loses_at_most_one_tick(seed: int) -> None:
    after_s = random.Random(seed).uniform(0.0, 2.0)
    assert kill_once(seed, after_s, Console(stderr=True)) <= 1


@pytest.mark.slow
def test_fifty_kills_lose_at_most_one_tick_each() -> None:
    chance = random.Random(50)
    assert max(kill_once(seed, chance.uniform(0.0, 5.0), Console(stderr=True)) for seed in range(50)) <= 1
