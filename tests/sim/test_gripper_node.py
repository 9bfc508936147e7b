"""The gripper's side of the CAN bus: registers as in the 2F-85's manual."""

from __future__ import annotations

import can
import pytest

from bracket_ground.interfaces.bench import Bench
from bracket_ground.interfaces.product import Product
from bracket_sim.scene.clutter import standing
from tests.sim.conftest import MakeRig
from tests.sim.rig import Rig, downwards

CLOSING_CONTACT, AT_POSITION = 2, 3


@pytest.fixture
def holding(make_rig: MakeRig, product: Product, bench: Bench) -> Rig:
    """A gripper that has closed on an o2 in the tray."""
    x, y, z = bench.tray.centre_m
    rig = make_rig([standing(product, bench.tray, "o2", (x, y), 0.0)])
    rig.activate()
    rig.grip(0.085)
    yaw = rig.cell.world.tool_pose().yaw_rad
    side = 1.5708 if abs(yaw) < 3.1416 and yaw > 0 else -1.5708
    rig.move(downwards(x, y, z + 0.15, side), 3.0)
    rig.move(downwards(x, y, z + 0.04, side), 1.0)
    rig.grip(0.0)
    return rig


def test_activation_opens_and_closes_fully(make_rig: MakeRig) -> None:
    rig = make_rig()
    rig.activate()
    rig.request(rACT=0)
    rig.wait(0.1)
    assert (rig.status["gSTA"], rig.status["gACT"]) == (0, 0)
    rig.request(rACT=1)
    openings = []
    for _ in range(40):
        rig.wait(0.04)
        openings.append(rig.status["gPO"])
    assert openings[0] < 15
    assert max(openings) > 82
    assert openings[-1] < 1
    assert (rig.status["gACT"], rig.status["gSTA"], rig.status["gFLT"]) == (1, 3, 0)


def test_the_heartbeat_comes_ten_times_a_second_and_tells_the_state(make_rig: MakeRig) -> None:
    rig = make_rig()
    rig.activate()
    assert len(rig.heartbeats) == 15
    assert rig.heartbeats[:2] == [0x00, 0x7F]
    assert rig.heartbeats[-1] == 0x05


@pytest.mark.parametrize(("opening_mm", "speed_mm_s"), [(20.0, 150.0), (50.0, 20.0)])
def test_motions_reach_their_opening_at_the_requested_speed(
    make_rig: MakeRig, opening_mm: float, speed_mm_s: float
) -> None:
    rig = make_rig()
    rig.activate()
    rig.request(rSP=speed_mm_s)
    rig.grip(opening_mm / 1000, 0.1)
    assert rig.status["gOBJ"] == 0
    rig.wait(opening_mm / speed_mm_s)
    assert rig.status["gOBJ"] == AT_POSITION
    assert rig.status["gPO"] == pytest.approx(opening_mm, abs=1.0)


def test_a_part_stops_the_fingers_and_is_reported(holding: Rig, product: Product) -> None:
    assert holding.status["gOBJ"] == CLOSING_CONTACT
    assert holding.status["gPO"] == pytest.approx(product.parts["o2"].size_m[1] * 1000, abs=1.5)
    assert holding.status["gCU"] > 0.2


def test_clearing_go_to_keeps_the_grip(holding: Rig) -> None:
    holding.request(rGTO=0)
    holding.wait(1.0)
    current = holding.status["gCU"]
    part = holding.cell.world.bodies[0]
    before = holding.cell.world.part_pose(part).position_m[2]
    x, y, z = holding.cell.world.tool_pose().position_m
    holding.move(downwards(x, y, z + 0.1, holding.cell.world.tool_pose().yaw_rad), 1.0)
    assert current > 0.2
    assert holding.cell.world.part_pose(part).position_m[2] == pytest.approx(before + 0.1, abs=0.002)


def test_a_part_that_is_taken_away_ends_the_contact(holding: Rig) -> None:
    part = holding.cell.world.bodies[0]
    pose = holding.cell.world.part_pose(part)
    holding.cell.world.place(part, type(pose)((0.5, 0.6, 0.2), pose.quaternion_wxyz))
    holding.wait(0.8)
    assert holding.status["gOBJ"] == AT_POSITION
    assert holding.status["gPO"] < 1


def test_moving_before_activation_is_a_fault(make_rig: MakeRig) -> None:
    rig = make_rig()
    rig.request(rACT=0, rGTO=1)
    rig.wait(0.2)
    assert rig.status["gFLT"] == 0x07
    rig.request(rACT=1)
    rig.wait(0.2)
    assert rig.status["gFLT"] == 0x05
    rig.wait(1.4)
    assert rig.status["gFLT"] == 0
    assert rig.emergencies == [0xFF07, 0xFF05, 0]


def test_a_silent_master_is_a_fault_that_ends_when_it_speaks(make_rig: MakeRig) -> None:
    rig = make_rig()
    rig.activate()
    rig.cell.devices.clock.sleep_until(rig.cell.devices.clock.now_s() + 1.1)
    rig.listen()
    assert rig.status["gFLT"] == 0x09
    rig.wait(0.1)
    assert rig.status["gFLT"] == 0


def test_an_injected_fault_stops_the_fingers_until_reset(make_rig: MakeRig) -> None:
    rig = make_rig()
    rig.activate()
    rig.grip(0.085, 0.2)
    rig.cell.gripper_node.inject_fault(0x0E)
    rig.wait(0.1)
    stopped = rig.status["gPO"]
    rig.wait(0.5)
    assert rig.status["gFLT"] == 0x0E
    assert rig.status["gPO"] == pytest.approx(stopped, abs=0.5)
    assert rig.emergencies == [0xFF0E]
    rig.request(rACT=0, rGTO=0)
    rig.wait(0.1)
    assert (rig.status["gFLT"], rig.status["gSTA"]) == (0, 0)


def test_automatic_release_opens_and_needs_a_reset(holding: Rig) -> None:
    holding.request(rATR=1, rARD=1)
    holding.wait(0.5)
    assert holding.status["gFLT"] == 0x0B
    holding.wait(4.0)
    assert holding.status["gFLT"] == 0x0F
    assert holding.status["gPO"] > 84


def test_frames_of_a_wrong_length_are_not_commands(make_rig: MakeRig) -> None:
    rig = make_rig()
    rig.bus.send(can.Message(arbitration_id=0x20A, data=b"\x01", is_extended_id=False))
    rig.cell.devices.clock.sleep_until(0.2)
    rig.listen()
    assert rig.status["gSTA"] == 0


def test_a_silenced_node_sends_nothing(make_rig: MakeRig) -> None:
    rig = make_rig()
    rig.wait(0.3)
    rig.cell.gripper_node.silence()
    count = len(rig.heartbeats)
    rig.wait(0.5)
    assert len(rig.heartbeats) == count
