"""A driver of a user's own for an arm that streams: the contract of every arm, and its words where the link is lost."""

from __future__ import annotations

import inspect
from collections.abc import Callable, Iterator

import pytest

from bracket_cell import DeviceFault
from bracket_cell.configuration import load_configuration
from bracket_ground.contracts.arm import CHECKS, Bench
from bracket_ground.interfaces.clock import WallClock
from tests.sim.streaming import tcp_arm
from tests.sim.streaming.tcp_arm import TcpArm, TcpSettings
from tests.sim.streaming.tcp_server import TcpController
from tests.sim.twin.rig import light_cell, slower_now

LINES = 150


@pytest.fixture(scope="module")
def served() -> Iterator[tuple[int, float, TcpController]]:
    """Port and pace of a controller, and the controller."""
    slower = slower_now()
    cell = light_cell({"arm": {"kind": "own", "port": 0}}, "ur10", slower)
    controller = TcpController(cell, "arm")
    cell.serve()
    yield controller.port, slower, controller
    controller.close()
    cell.close()


@pytest.fixture
def bench(served: tuple[int, float, TcpController]) -> Iterator[Bench]:
    port, slower, controller = served
    clock = WallClock(slower)
    arm = TcpArm(TcpSettings(port=port), clock, load_configuration().robot)

    def stop() -> None:
        controller.cell.fault("protective_stop")

    yield Bench(arm, clock, stop)
    arm.close()
    arm.close()
    controller.cell.fault("mended")


@pytest.mark.long
@pytest.mark.contract
@pytest.mark.parametrize("check", CHECKS, ids=lambda check: check.__name__.removeprefix("check_"))
def test_a_driver_of_few_lines_does_what_every_arm_must(bench: Bench, check: Callable[[Bench], None]) -> None:
    check(bench)


def test_the_driver_is_short() -> None:
    assert len(inspect.getsource(tcp_arm).splitlines()) <= LINES


def test_a_link_that_is_cut_is_a_stop_that_is_acknowledged(
    bench: Bench, served: tuple[int, float, TcpController]
) -> None:
    bench.half_way()
    served[2].cut()
    stopped = bench.until(lambda state: state.mode != "normal")[-1]
    assert (stopped.mode, bool(stopped.reason)) == ("not_controlled", True)
    bench.stand()
    bench.arm.acknowledge()
    bench.until(lambda state: state.mode == "normal", 20.0)
    bench.arm.follow(bench.way(0.3))
    bench.rest()


def test_nobody_there_is_said_in_words() -> None:
    with pytest.raises(DeviceFault, match=r"no controller answers at 127\.0\.0\.1:1: "):
        TcpArm(TcpSettings(port=1), WallClock(), load_configuration().robot)
