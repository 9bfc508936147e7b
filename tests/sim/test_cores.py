"""Where there are two cores, one is the controller's, and it lends it while it waits."""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Iterator

import pytest

from bracket_cell.remote.child import lent, two_cores

pytestmark = pytest.mark.skipif(two_cores() is None, reason="this machine has not two cores")


@pytest.fixture
def sleeper() -> Iterator[subprocess.Popen[bytes]]:
    with subprocess.Popen([sys.executable, "-c", "input()"], stdin=subprocess.PIPE) as process:
        yield process
        process.kill()


def test_a_process_has_the_controllers_core_as_long_as_it_is_lent(sleeper: subprocess.Popen[bytes]) -> None:
    cores = two_cores()
    assert cores is not None
    with lent(sleeper.pid, cores):
        assert os.sched_getaffinity(sleeper.pid) == {cores[0]}
    assert os.sched_getaffinity(sleeper.pid) == {cores[1]}


def test_nothing_is_lent_where_cores_are_many(sleeper: subprocess.Popen[bytes]) -> None:
    before = os.sched_getaffinity(sleeper.pid)
    with lent(sleeper.pid, None):
        assert os.sched_getaffinity(sleeper.pid) == before


def test_a_process_that_died_is_lent_nothing(sleeper: subprocess.Popen[bytes]) -> None:
    sleeper.kill()
    sleeper.wait()
    with lent(sleeper.pid, two_cores()):
        pass
