"""What holds for every test."""

from __future__ import annotations

import os
import signal
from collections.abc import Iterator
from contextlib import suppress

import pytest

from tests.processes import children

KEPT = ("multiprocessing.resource_tracker", "multiprocessing.forkserver")  # Python's own; they end with the process


@pytest.fixture(autouse=True)
def _no_child_survives() -> Iterator[None]:
    """A child that outlives its test is killed, and the test that left it fails, not a later one."""
    before = children()
    yield
    left = {one: line for one, line in children().items() if one not in before and not any(k in line for k in KEPT)}
    for one in left:
        with suppress(ProcessLookupError):
            os.kill(one, signal.SIGKILL)
    assert not left, f"still running after the test: {'; '.join(left.values())}"
