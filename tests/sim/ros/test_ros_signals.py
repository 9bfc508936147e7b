"""Terminals of the twin's arm by ROS 2: read, set, and what is said where a node is silent; and the arm's load."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator

import pytest

from bracket_cell.configuration import load_configuration, load_product
from bracket_cell.plant.ros_arm import Ros2Arm
from bracket_cell.plant.ros_signals import Ros2Signals
from bracket_cell.skills.drivers.settings import Ros2ArmSettings, Ros2SignalSettings
from bracket_ground.errors import DeviceFault
from bracket_ground.interfaces.clock import WallClock
from bracket_sim.twin import controller
from bracket_sim.twin.ros2 import RosArm
from tests.sim.twin.rig import UNLOCK_S, light_cell, slower_now

SETTINGS = Ros2ArmSettings(domain=1 + (os.getpid() + 31) % 200, middleware="cyclonedds")
TERMINALS = Ros2SignalSettings(
    **SETTINGS.model_dump(include={"domain", "middleware"}),
    inputs={"gate": 3, "button": 9, "tool": 16},
    outputs={"light": 2, "valve": 17},
    timeout_s=2.0,
)


@pytest.fixture(scope="module")
def served() -> Iterator[tuple[WallClock, RosArm]]:
    slower, controller.UNLOCK_S = slower_now(), UNLOCK_S
    cell = light_cell({"arm": SETTINGS.model_dump(), "signals": TERMINALS.model_dump()}, "ur10", slower)
    (arm,) = cell.serve()
    assert isinstance(arm, RosArm)
    yield WallClock(slower), arm
    cell.close()


@pytest.fixture
def signals(served: tuple[WallClock, RosArm]) -> Iterator[Ros2Signals]:
    made = Ros2Signals(TERMINALS, served[0])
    yield made
    made.close()


def until(clock: WallClock, true: Callable[[], bool], limit_s: float = 10.0) -> None:
    end_s = clock.now_s() + limit_s
    while not true():
        assert clock.now_s() < end_s, "it never came"
        clock.sleep_until(clock.now_s() + 0.02)


def trouble(signals: Ros2Signals) -> str:
    try:
        signals.read()
    except DeviceFault as fault:
        return str(fault)
    return ""


def test_terminals_are_known_from_the_first_and_as_they_change(
    served: tuple[WallClock, RosArm], signals: Ros2Signals
) -> None:
    clock, arm = served
    assert signals.read() == dict.fromkeys(("gate", "button", "tool", "light", "valve"), False)
    arm.controller.inputs = 1 << 3 | 1 << 16 | 1 << 5
    until(clock, lambda: signals.read()["gate"])
    assert [signals.read()[name] for name in TERMINALS.inputs] == [True, False, True]
    arm.controller.inputs = 0
    until(clock, lambda: not signals.read()["gate"])


def test_outputs_are_set_and_others_left_alone(served: tuple[WallClock, RosArm], signals: Ros2Signals) -> None:
    clock, arm = served
    arm.controller.outputs |= 1 << 5
    signals.write("light", True)
    signals.write("valve", True)
    until(clock, lambda: arm.controller.outputs == 1 << 2 | 1 << 17 | 1 << 5)
    signals.write("light", False)
    until(clock, lambda: arm.controller.outputs == 1 << 17 | 1 << 5)
    assert signals.read()["valve"]
    with pytest.raises(DeviceFault, match="no output 'horn'; there are: light, valve"):
        signals.write("horn", True)


def test_a_service_that_does_not_answer_is_named_and_terminals_are_still_heard(
    served: tuple[WallClock, RosArm], signals: Ros2Signals
) -> None:
    clock, arm = served
    with arm.controller.cell.lock:
        services, arm._services = arm._services, []
    signals.write("light", True)
    until(clock, lambda: "set_io did not set light" in trouble(signals))
    assert not trouble(signals).count("nothing comes")
    with arm.controller.cell.lock:
        arm._services = services
    until(clock, lambda: not trouble(signals) and bool(arm.controller.outputs & 1 << 2))


def test_silent_terminals_are_a_fault_and_come_back(served: tuple[WallClock, RosArm], signals: Ros2Signals) -> None:
    clock, arm = served
    with arm.controller.cell.lock:
        arm.silent_until_s = arm.controller.cell.now_s() + 4.0
    until(clock, lambda: "nothing comes on /io_and_status_controller/io_states" in trouble(signals))
    until(clock, lambda: not trouble(signals))


def test_nobody_there_is_said_before_the_run() -> None:
    nobody = TERMINALS.model_copy(update={"namespace": "/nobody"})
    with pytest.raises(DeviceFault, match="signals: nothing comes on /nobody/io_and_status_controller/io_states"):
        Ros2Signals(nobody, WallClock())


def test_the_controller_knows_what_hangs_on_the_flange(served: tuple[WallClock, RosArm]) -> None:
    clock, twin = served
    configuration = load_configuration()
    product = load_product(configuration)
    part_kg = max(part.mass_kg for part in product.parts.values())
    with twin.controller.cell.lock:
        twin.controller.payload_kg = 0.0
        twin._run_program()
    arm = Ros2Arm(SETTINGS, clock, product, configuration.robot)
    of = twin.controller
    try:
        until(clock, lambda: of.payload_kg == pytest.approx(SETTINGS.payload_kg, abs=1e-5))
        assert of.payload_cog_m == pytest.approx(SETTINGS.payload_centre_m)
        arm.carry(True)
        until(clock, lambda: of.payload_kg == pytest.approx(SETTINGS.payload_kg + part_kg, abs=1e-5))
        of.cell.fault("protective_stop")
        until(clock, lambda: arm.state().mode != "normal")
        of.payload_kg = 0.0
        arm.acknowledge()
        until(clock, lambda: arm.state().mode == "normal", 20.0)
        until(clock, lambda: of.payload_kg == pytest.approx(SETTINGS.payload_kg + part_kg, abs=1e-5))
    finally:
        arm.close()
