"""Faults that are put in end as the table of faults promises; a sample, `cell eval faults` runs them all."""

from __future__ import annotations

import pytest

from cell.commands.main import main
from cell.configuration import DEFAULT_CONFIGURATION
from cell.evaluating.faults import fault_try
from cell.interfaces.errors import InputError
from cell.running.injection import Injection


@pytest.mark.parametrize(
    ("fault", "state"),
    [
        ("arm_frozen", "carry"),
        ("arm_velocity_nan", "lower"),
        ("arm_safeguard", "carry"),
        ("gripper_refuses", "carry"),
        ("status_lost", "lift"),
        ("camera_black", "carry"),
        ("sighup", "above"),
    ],
)
def test_a_fault_ends_as_promised(fault: str, state: str) -> None:
    row = fault_try(DEFAULT_CONFIGURATION, fault, state, 1)
    assert row["as_promised"], row
    assert row["held"] is not False


def test_a_fault_or_state_that_there_is_not_is_refused() -> None:
    with pytest.raises(InputError, match="unknown fault 'arm_lots'; legal: arm_frozen, "):
        Injection.parse("arm_lots@carry")
    with pytest.raises(InputError, match="unknown state 'fly'; legal: look, "):
        Injection.parse("arm_lost@fly")
    assert main(["run", "--inject", "nothing@carry"]) == 2
