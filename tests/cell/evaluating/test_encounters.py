"""Trials beside a person: contacts are judged by the truth, and assemblies with faults end as promised."""

from __future__ import annotations

import numpy as np
import pytest

from cell.configuration import DEFAULT_CONFIGURATION
from cell.evaluating.encounters import meet
from cell.evaluating.troubled import troubled_assembly


@pytest.mark.slow
def test_a_careless_person_is_met_and_no_contact_is_fast_or_avoidable() -> None:
    found = meet(DEFAULT_CONFIGURATION, "careless", 1, 109, lambda _: None)
    assert found["encounters"]
    assert (found["contacts_fast"], found["contacts_avoidable"], found["moved_while_unknown"]) == (0, 0, 0)
    assert isinstance(found["rows"], list)
    assert all(np.isfinite(row["speed_m_s"]) for row in found["rows"])


@pytest.mark.slow
def test_an_assembly_with_three_faults_ends_as_promised() -> None:
    row = troubled_assembly(DEFAULT_CONFIGURATION, 701, 3)
    assert row["came"]
    assert row["as_promised"]
    assert not row["unknown"]
    assert row == troubled_assembly(DEFAULT_CONFIGURATION, 701, 3), "the same seed, the same faults and end"
