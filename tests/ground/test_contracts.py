"""The contract suite is the ground's own: a stranger's drivers are tried with nothing else installed."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

from tests.ground.made_up import BLOCKED

FOLDER = Path(__file__).parent


def answer(kind: str) -> str:
    """Of the contract, where an import of the cell, the simulator or pytest fails."""
    code = (
        f"import sys; [sys.modules.__setitem__(name, None) for name in {BLOCKED}];"
        f"import made_up; print(' '.join(made_up.failed({kind!r})) or 'all passed')"
    )
    found = subprocess.run([sys.executable, "-c", code], cwd=FOLDER, capture_output=True, text=True, check=False)
    assert found.returncode == 0, found.stderr
    return found.stdout.strip()


@pytest.mark.parametrize("kind", ["arm", "gripper"])
def test_drivers_of_a_made_up_maker_pass_with_the_ground_alone(kind: str) -> None:
    assert answer(kind) == "all passed"


def test_a_driver_that_breaks_the_contract_fails() -> None:
    assert "check_hold" in answer("deaf arm").split()
    assert answer("strong gripper") == "check_commands_are_cut_to_the_registers"
