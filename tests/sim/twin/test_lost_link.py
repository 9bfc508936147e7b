"""A link to an arm of Universal Robots that is lost: told in words, without a traceback in the operator's terminal."""

from __future__ import annotations

import os
import signal
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pytest

from bracket_cell.configuration import load_configuration, load_product
from bracket_cell.skills.drivers.settings import UrSettings
from bracket_cell.skills.drivers.ur import UrArm
from bracket_ground.contracts.arm import Bench
from bracket_ground.interfaces.clock import WallClock
from tests.sim.twin.rig import Twin, running_twin

TWIN = 71


@contextmanager
def terminal() -> Iterator[list[str]]:
    """What this process and its children write to the terminal meanwhile; known at the end."""
    kept, told = os.dup(2), list[str]()
    with tempfile.TemporaryFile() as file:
        os.dup2(file.fileno(), 2)
        try:
            yield told
        finally:
            os.dup2(kept, 2)
            os.close(kept)
            file.seek(0)
            told += file.read().decode(errors="replace").splitlines()


def opened(twin: Twin) -> Bench:
    configuration, clock = load_configuration(), WallClock(twin.slower)
    arm = UrArm(UrSettings(host=twin.host), clock, load_product(configuration), configuration.robot)
    return Bench(arm, clock, lambda: None)


@pytest.mark.long
@pytest.mark.parametrize("under_way", [True, False], ids=["under way", "at rest"])
def test_a_process_that_streams_and_loses_its_link_says_so_in_words(tmp_path: Path, under_way: bool) -> None:
    with running_twin(tmp_path, TWIN + under_way) as twin, terminal() as told:
        ur = opened(twin)
        if under_way:
            ur.half_way()
        stream = ur.arm._stream  # type: ignore[attr-defined]
        twin.process.kill()
        twin.process.wait()
        ur.clock.sleep_until(ur.clock.now_s() + 3.0)
        assert np.isfinite(ur.at_rad).all()
        code = stream.child.code(10.0)
        ur.arm.close()  # type: ignore[attr-defined]
    assert code in (0, -signal.SIGKILL), "it ends by itself, or is ended where its client hangs; it never aborts"
    assert told == []


@pytest.mark.long
@pytest.mark.parametrize("under_way", [True, False], ids=["under way", "at rest"])
def test_a_link_that_is_silent_for_seconds_is_an_old_state_with_a_reason_and_comes_back(
    tmp_path: Path, under_way: bool
) -> None:
    with running_twin(tmp_path, TWIN + 2 + under_way) as twin, terminal() as told:
        ur = opened(twin)
        try:
            if under_way:
                ur.half_way()
            twin.process.send_signal(signal.SIGSTOP)  # no byte goes either way, and nobody hangs up
            silent = [ur.tick() for _ in range(50)]
            twin.process.send_signal(signal.SIGCONT)
            assert ur.clock.now_s() - silent[-1].time_s > 1.0
            assert silent[-1].reason
            ur.until(lambda state: ur.clock.now_s() - state.time_s < 0.1, 20.0)
            ur.arm.stop()
            ur.arm.acknowledge()
            ur.until(lambda state: state.mode == "normal" and not state.moving, 30.0)
            path = ur.arm.follow(ur.way(0.3))
            ur.rest()
            assert np.abs(ur.at_rad - path.at(path.duration_s)).max() < 0.006
        finally:
            ur.arm.close()  # type: ignore[attr-defined]
    assert told == []
