"""The world goes on when its controller is gone: the arm stops by itself, and the next controller finds it so."""

from __future__ import annotations

import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pytest

from bracket_cell.configuration import load_configuration, load_product
from bracket_ground.errors import DeviceFault, InputError
from bracket_ground.interfaces.command import JointTrajectory
from bracket_ground.interfaces.devices import KEEP_ALIVE_S
from bracket_ground.interfaces.observation import ArmState
from bracket_sim.process.client import RemoteCell
from bracket_sim.process.messages import Drawn, Pace
from bracket_sim.process.opening import connect, drawn_from
from tests.processes import started

CONFIGURATION = load_configuration()
PRODUCT = load_product(CONFIGURATION)
TURN_RAD, LONG_S = 1.2, 4.0


@contextmanager
def world(folder: Path, *more: str) -> Iterator[Path]:
    address = folder / "world.sock"
    with started([sys.executable, "-m", "bracket_cell", "lab", "world", "--at", str(address), *more]) as process:
        assert process.stderr is not None
        assert "the world is at" in process.stderr.readline()
        yield address


def controller(address: Path, pace: Pace) -> RemoteCell:
    return connect(CONFIGURATION, PRODUCT, address, pace)


def slow_turn(state: ArmState) -> JointTrajectory:
    here = np.array(state.positions_rad)
    return JointTrajectory(np.array([0.0, LONG_S]), np.array([here, here + np.array([TURN_RAD, 0, 0, 0, 0, 0])]))


def work(cell: RemoteCell, duration_s: float) -> ArmState:
    """Send the arm away, and command it for a while, as a controller does."""
    arm, clock = cell.devices.arm, cell.devices.clock
    arm.follow(slow_turn(arm.state()))
    until_s = clock.now_s() + duration_s
    while clock.now_s() < until_s:
        arm.pace(1.0)
        clock.sleep_until(clock.now_s() + 0.04)
    return arm.state()


@pytest.mark.long
@pytest.mark.parametrize("pace", ["fast", "real"])
def test_an_arm_whose_controller_is_gone_stands_when_the_next_one_comes(tmp_path: Path, pace: Pace) -> None:
    with world(tmp_path) as address:
        first = controller(address, pace)
        left = work(first, 0.4)
        assert left.moving
        assert not left.stands
        first.close()  # no stop: a socket that closes is all that a world sees of a killed controller
        if pace == "real":
            time.sleep(KEEP_ALIVE_S + 1.0)
        second = controller(address, pace)
        found = second.devices.arm.state()
        gone_s = found.time_s - left.time_s
        assert gone_s > 0.9, "time went on without a controller"
        assert found.stands
        turned = found.positions_rad[0] - left.positions_rad[0]
        assert 0 < turned < 0.6 * TURN_RAD * gone_s / LONG_S, "it stopped long before"
        assert second.devices.clock.now_s() >= found.time_s
        work(second, 0.2)
        second.close()


def test_a_world_serves_one_controller_and_only_of_its_product(tmp_path: Path) -> None:
    with world(tmp_path) as address:
        first = controller(address, "fast")
        with pytest.raises(InputError, match="another controller is connected"):
            controller(address, "fast")
        first.close()
        other = PRODUCT.model_copy(update={"name": "another"})
        with pytest.raises(InputError, match="opened with another product"):
            connect(CONFIGURATION, other, address, "fast")


def test_a_world_that_dies_is_a_fault_of_its_devices_and_time_goes_on(tmp_path: Path) -> None:
    with world(tmp_path) as address:
        cell = controller(address, "fast")
        cell.devices.clock.sleep_until(0.1)
    cell.devices.clock.sleep_until(0.2)
    assert cell.devices.clock.now_s() == 0.2
    with pytest.raises(DeviceFault, match=r"world \(pid \d+\): its process is gone"):
        cell.devices.arm.state()
    with pytest.raises(DeviceFault, match=r"world \(pid \d+\): its process is gone"):
        cell.devices.arm.stop()
    assert cell.devices.report() == {}
    cell.close()


def test_a_world_tells_what_it_was_drawn_from_also_while_somebody_works_there(tmp_path: Path) -> None:
    with world(tmp_path, "--seed", "41", "--goal", "g1") as address:
        assert drawn_from(address) == Drawn(41, "g1")
        first = controller(address, "fast")
        assert drawn_from(address) == Drawn(41, "g1")
        assert first.devices.arm.state().stands
        first.close()
    with pytest.raises(InputError, match="no world is there"):
        drawn_from(tmp_path / "nowhere.sock")
