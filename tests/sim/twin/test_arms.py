"""Simulated arms and an arm of Universal Robots behind its twin's wires do what every arm must do."""

from __future__ import annotations

from collections.abc import Callable, Iterator

import numpy as np
import pytest

from bracket_cell.configuration import load_configuration, load_product
from bracket_cell.skills.drivers.settings import UrSettings
from bracket_cell.skills.drivers.ur import UrArm
from bracket_ground.contracts.arm import CHECKS, Bench
from bracket_ground.interfaces.clock import WallClock
from bracket_sim.cell import SimCell
from bracket_sim.scene.settings import HARDWARE, SimSettings
from tests.sim.twin.rig import Twin, running_twin

TWIN = 51


@pytest.fixture(scope="module")
def twin(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Twin]:
    with running_twin(tmp_path_factory.mktemp("twin"), TWIN) as running:
        yield running


@pytest.fixture
def ur(twin: Twin) -> Iterator[Bench]:
    configuration, clock = load_configuration(), WallClock(twin.slower)
    arm = UrArm(UrSettings(host=twin.host), clock, load_product(configuration), configuration.robot)
    yield Bench(arm, clock, lambda: twin.fault("protective_stop"))
    arm.close()
    arm.close()
    twin.fault("mended")


@pytest.fixture(scope="module", params=["ideal", "ur10_usb"])
def simulated(request: pytest.FixtureRequest) -> Iterator[Bench]:
    configuration, hardware = load_configuration(), HARDWARE[request.param]
    settings, bench = SimSettings(hardware=hardware), configuration.bench.drawn
    product, channel = load_product(configuration), f"arms-{request.param}"
    cell = SimCell(product, bench, settings, "virtual", channel, 0, "g0", worker=False, clutter=(), rendered=False)

    def hold_back() -> None:
        cell.world.data.qpos[cell.world.arm_qpos] += np.array([0.0, 0.0, 0.0, 0.0, 0.0, 1.0])

    yield Bench(cell.devices.arm, cell.devices.clock, hold_back)
    cell.close()


@pytest.mark.contract
@pytest.mark.parametrize("check", CHECKS, ids=lambda check: check.__name__.removeprefix("check_"))
def test_the_simulated_arm(simulated: Bench, check: Callable[[Bench], None]) -> None:
    simulated.share = 1.0
    check(simulated)


@pytest.mark.long
@pytest.mark.contract
@pytest.mark.parametrize("check", CHECKS, ids=lambda check: check.__name__.removeprefix("check_"))
def test_the_arm_behind_its_wires(ur: Bench, check: Callable[[Bench], None]) -> None:
    ur.share = 1.0
    check(ur)
