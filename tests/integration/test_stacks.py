"""A part under another one is fetched from pixels: what is on it is moved aside first, taken as it lies."""

from __future__ import annotations

import pytest

from tests.benchmarks.clearing_stacks import DROP_M, fetch
from tests.integration.cell_rig import CONFIGURATION


@pytest.mark.slow
def test_a_part_under_another_one_is_fetched() -> None:
    case = fetch(970_001, CONFIGURATION)
    assert case.fetched, case.words
    assert case.moves >= 1
    assert case.drop_m < DROP_M
    assert case.off == ()
