"""Wrong set-ups of a cell are named with what to do, without motion."""

from __future__ import annotations

import socket
import threading
from collections.abc import Callable, Iterator
from itertools import count
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from pydantic import ValidationError

from bracket_cell.configuration import load_configuration
from bracket_cell.settings import MqttSettings
from bracket_cell.skills.drivers import cameras, robotiq, ur_examined
from bracket_cell.skills.drivers.settings import (
    RobotiqModbusSettings,
    RobotiqUrcapSettings,
    Ros2GripperSettings,
    StreamSettings,
    UrSettings,
)
from bracket_cell.skills.motion.kinematics import Kinematics
from bracket_ground.errors import DeviceFault
from bracket_ground.files.model import Model
from bracket_ground.interfaces.clock import WallClock
from bracket_ground.interfaces.devices import DeviceCheck
from bracket_ground.interfaces.robot import load_robot
from bracket_sim.twin.controller import Controller, UrWires
from bracket_sim.twin.gripper import ModbusTwin, Registers
from bracket_sim.twin.ur_model import MODELS
from tests.sim.twin.rig import corrected, light_cell, own_host
from tests.skills.ideal_fingers import AnsweredClock, IdealFingers
from tests.skills.test_cameras import Shooting, small_bench

HOST = own_host(71)
CONFIGURATION = load_configuration()
FORWARD = Kinematics(CONFIGURATION.motion).forward


@pytest.fixture(scope="module")
def controller() -> Iterator[Controller]:
    cell = light_cell({"arm": {"kind": "ur", "host": HOST}}, "ur10", 1.0)
    (wires,) = cell.serve()
    assert isinstance(wires, UrWires)
    yield wires.controller
    cell.close()


def wrong(**more: Any) -> list[DeviceCheck]:
    """What is found wrong of the arm."""
    settings = UrSettings(**{"host": HOST, **more})
    found = list(ur_examined.examine(settings, CONFIGURATION.bench, CONFIGURATION.robot, FORWARD))
    return [check for check in found if check.remedy]


@pytest.mark.usefixtures("controller")
def test_an_arm_as_it_is_configured_is_well() -> None:
    assert wrong() == []


def test_nobody_at_the_address() -> None:
    (found,) = wrong(host=own_host(72))
    assert "check cable and address" in found.remedy


Change = dict[str, Any]
CASES: dict[str, tuple[Change, Change, str]] = {
    "mode": ({"safety": 3}, {}, "the controller is in protective stop: clear it there"),
    "power": ({"robot_mode": 5}, {}, "release the brakes"),
    "local": ({"remote": False, "model": MODELS["ur10e"]}, {}, "switch it to remote control"),
    "payload": ({"payload_kg": 2.0}, {}, "weigh gripper, coupling and camera"),
    "tcp": ({"tcp": np.array([0, 0, 0.149, 0, 0, 0.0])}, {}, "(0, 0, 156.0) mm without rotation"),
    "model": ({"model": MODELS["ur10e"]}, {}, "write robot: ur10e"),
    "calibration": ({"model": corrected(MODELS["ur10"], 7)}, {}, "this arm's own calibration"),
    "registers": ({"fieldbus": True}, {"registers": "lower"}, "write registers: upper"),
    "turns": ({"turned_rad": np.array([0, 0, 0, 0, 0, 2 * np.pi])}, {}, "turn it back by hand"),
}


@pytest.mark.parametrize("name", CASES)
def test_what_is_wrong_with_an_arm_is_told(controller: Controller, name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    change, settings, remedy = CASES[name]
    for attribute, value in change.items():
        monkeypatch.setattr(controller, attribute, value)
    assert remedy in " ".join(check.remedy for check in wrong(**settings))


def test_a_tool_elsewhere_is_not_taken_for_another_calibration(
    controller: Controller, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(controller, "tcp", np.array([0.01, 0.0, 0.149, 0.1, 0.0, 0.0]))
    assert len(wrong()) == 1


def test_a_robot_file_with_the_arm_s_own_calibration_is_well(
    controller: Controller, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(controller, "model", corrected(MODELS["ur10"], 7))
    settings = UrSettings(host=HOST)
    robot = CONFIGURATION.robot.model_copy(update={"calibration": ur_examined.calibration(settings)})
    forward = Kinematics(CONFIGURATION.motion.of(robot)).forward
    assert [check for check in ur_examined.examine(settings, CONFIGURATION.bench, robot, forward) if check.remedy] == []
    assert robot.calibration is not None
    ur_examined.refuse_another(settings, robot.calibration)
    monkeypatch.setattr(controller, "model", corrected(MODELS["ur10"], 8))
    found = list(ur_examined.examine(settings, CONFIGURATION.bench, robot, forward))
    assert "has another arm's" in " ".join(check.remedy for check in found)
    with pytest.raises(DeviceFault, match="calibration of another arm"):
        ur_examined.refuse_another(settings, robot.calibration)
    ur_examined.refuse_another(UrSettings(host=own_host(72)), robot.calibration)


@pytest.mark.parametrize(("name", "told", "right"), [
    ("ur20", "ur20", ""), ("ur16e", "ur16e", ""), ("ur5e", "ur20", "ur20"), ("ur20", "ur5e", "ur5e"),
    ("ur5", "ur5e", "ur5e"),
])  # fmt: skip
def test_models_of_one_series_alone_are_known(
    controller: Controller, monkeypatch: pytest.MonkeyPatch, name: str, told: str, right: str
) -> None:
    monkeypatch.setattr(controller, "model", MODELS[told])
    robot = CONFIGURATION.robot.model_copy(update={"name": name})
    found = ur_examined.examine(UrSettings(host=HOST), CONFIGURATION.bench, robot, Kinematics().forward)
    named = [check.remedy.rpartition("write robot: ")[2] for check in found if "write robot" in check.remedy]
    assert named == [right] * bool(right)


def test_another_model_is_told_by_its_kinematics_where_it_does_not_tell(controller: Controller) -> None:
    robot = load_robot("ur10e").model_copy(update={"name": "ours"})
    forward = Kinematics(CONFIGURATION.motion.of(robot)).forward
    found = ur_examined.examine(UrSettings(host=HOST), CONFIGURATION.bench, robot, forward)
    assert ["it is another model than ours" in check.remedy for check in found if check.remedy] == [True, False]
    assert controller.model.name == "UR10"


@pytest.fixture
def gripper(tmp_path: Path) -> Iterator[tuple[IdealFingers, ModbusTwin, Registers, AnsweredClock]]:
    clock = AnsweredClock()
    clock.answered = count().__next__
    fingers = IdealFingers(clock)
    registers = Registers(fingers, threading.RLock(), stroke_m=0.085)
    twin = ModbusTwin(registers, tmp_path / "adapter")
    yield fingers, twin, registers, clock
    twin.close()


Gripper = tuple[IdealFingers, ModbusTwin, Registers, AnsweredClock]


def of_gripper(gripper: Gripper, **more: Any) -> list[str]:
    settings = RobotiqModbusSettings(**{"port": gripper[1].banner.split()[-1], **more})
    return [check.remedy for check in robotiq.examine(settings) if check.remedy]


def test_what_answers_as_no_gripper_does_is_not_called_closed() -> None:
    """Else a person looks for the URCap, which is there or not."""
    host = own_host(73)

    def serve(server: socket.socket) -> None:
        connection, _ = server.accept()
        with connection:
            connection.recv(100)
            connection.sendall(b"POS 300\n")
            connection.recv(100)

    with socket.create_server((host, 0)) as server:
        thread = threading.Thread(target=serve, args=(server,), daemon=True)
        thread.start()
        settings = RobotiqUrcapSettings(host=host, port=server.getsockname()[1])
        [check] = robotiq.examine(settings)
        thread.join(5)
    said = r"'GET ACT' is answered with b'POS 300\n'"
    assert check.remedy == f"{said}: no such gripper answers; see `devices.gripper`"


def closed(gripper: Gripper) -> None:
    registers, clock = gripper[2], gripper[3]
    registers.write(0, bytes((9, 0, 0, 255, 255, 255)))
    clock.sleep_until(5.0)


@pytest.mark.parametrize(
    ("kind", "keys"),
    [
        (UrSettings, {"host": "a..b"}),
        (RobotiqUrcapSettings, {"host": "x" * 64}),
        (MqttSettings, {"host": "no broker"}),
        (RobotiqModbusSettings, {"port": "x", "open_count": 228, "closed_count": 3}),
        (RobotiqModbusSettings, {"port": "x", "open_count": 128, "closed_count": 128}),
        (Ros2GripperSettings, {"open_at": 0.8, "closed_at": 0.8}),
    ],
)
def test_what_no_driver_could_use_is_refused_with_its_file(kind: type[Model], keys: dict[str, Any]) -> None:
    with pytest.raises(ValidationError):
        kind(**keys)


@pytest.mark.parametrize("host", ["ur-1", "ur_1.plant.example.", "192.0.2.1", "fe80::1", "::ffff:192.0.2.1"])
def test_names_and_addresses_are_hosts(host: str) -> None:
    assert UrSettings(host=host).host == host


def test_a_gripper_is_looked_at_without_a_command(gripper: Gripper) -> None:
    assert of_gripper(gripper) == []
    assert gripper[0].requests == []


def test_what_is_wrong_with_a_gripper_is_told(gripper: Gripper) -> None:
    assert "ls /dev/serial/by-id" in of_gripper(gripper, port="/dev/serial/by-id/none")[0]
    assert "it does not answer: 24 V" in of_gripper(gripper, node_id=8)[0]
    gripper[0].fault = 0x0A
    assert "supply voltage too low: switch it off and on" in of_gripper(gripper)[0]


def test_fingers_that_end_elsewhere_than_configured_are_told(gripper: Gripper) -> None:
    closed(gripper)
    assert of_gripper(gripper) == []
    assert "`cell setup teach gripper` measures" in of_gripper(gripper, closed_count=255)[0]


@pytest.fixture
def shooting() -> Iterator[Shooting]:
    made = Shooting()
    yield made
    made.close()


def of_camera(shooting: Shooting, rate_hz: float = 50.0, **more: Any) -> list[str]:
    bench = small_bench()
    overhead = bench.overhead.model_copy(update={"rate_hz": rate_hz})
    bench = bench.model_copy(update={"overhead": overhead})
    settings = StreamSettings(**{"url": shooting.url, "delay_s": 0.03, **more})
    return [check.remedy for check in cameras.examine(settings, WallClock(), bench, "overhead") if check.remedy]


@pytest.fixture(autouse=True)
def _short_looks(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(cameras, "LOOKED_S", 0.6)


Break = Callable[[Shooting], object]
WRONG: dict[str, tuple[Break, Change, str]] = {
    "rate": (lambda _: None, {"rate_hz": 90.0}, "rate_hz says 90"),
    "frozen": (lambda one: setattr(one.server.faults, "frozen", True), {}, "the camera is frozen"),
    "black": (lambda one: setattr(one.server.faults, "black", True), {}, "take the cover off"),
    "delay": (lambda _: None, {"delay_s": None}, "`cell setup calibrate` measures it"),
    "nobody": (lambda _: None, {"url": "http://127.0.0.1:1/"}, "check cable and address"),
}


def test_a_camera_as_it_is_configured_is_well(shooting: Shooting) -> None:
    assert of_camera(shooting, rate_hz=20.0) == []


@pytest.mark.parametrize("name", WRONG)
def test_what_is_wrong_with_a_camera_is_told(shooting: Shooting, name: str) -> None:
    breaks, more, remedy = WRONG[name]
    breaks(shooting)
    assert remedy in " ".join(of_camera(shooting, **{"rate_hz": 20.0, **more}))
