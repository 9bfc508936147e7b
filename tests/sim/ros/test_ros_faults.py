"""What goes wrong with a lab's topics while the robot carries a part through them: each ends as it is promised."""

from __future__ import annotations

import gc
from collections.abc import Iterator

import pytest

pytest.importorskip("cyclonedds", reason="the extra ros2 is not installed")

from bracket_cell.commands.run import SEARCHES_GARBAGE
from tests.benchmarks.twin_faults import tried

pytestmark = pytest.mark.slow
SLOWER = 12.0  # twin and controller share one process here
PROMISED = {
    "joints_late": ("finished", ""),  # by .2 s: a hold that ends by itself
    "joints_silent": ("finished", ""),  # for 2 s: a hold that somebody acknowledges
    "joints_cut": ("finished", ""),  # the driver is started again, its program waits
    "controller_restarted": ("finished", ""),  # power and brakes, by the driver's services
    "overhead_lost": ("finished", ""),  # and back after 1.5 s
    "overhead_gone": ("fault", "overhead"),  # for good: after 20 s
    "gripper_silent": ("finished", ""),
}  # how the run ends, and what its reason names; config/faults.yaml says why


@pytest.fixture(autouse=True)
def few_searches() -> Iterator[None]:
    """A search of garbage holds up the twin, which is in this process."""
    before = gc.get_threshold()
    gc.freeze()
    gc.set_threshold(SEARCHES_GARBAGE)
    yield
    gc.set_threshold(*before)
    gc.unfreeze()


@pytest.mark.parametrize("fault", PROMISED)
def test_a_fault_of_topics_ends_as_promised(fault: str) -> None:
    end, named = PROMISED[fault]
    row = tried(fault, "carry", "ros2", SLOWER)
    assert row.reached, "the part was never carried"
    assert row.end == end, row
    assert row.as_promised, row
    assert named in row.reason
