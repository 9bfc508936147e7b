"""What a client sets by RTDE is obeyed and told: slider, terminals, registers; recipes that cannot run are refused."""

from __future__ import annotations

import socket
import struct
from collections.abc import Iterator

import numpy as np
import pytest

from bracket_sim.twin.controller import Controller, RobotMode, UrWires
from bracket_sim.twin.rtde import PORT, output_of
from tests.sim.twin.rig import own_host, ur_wires

HOST = own_host(64)


class Wire:
    """A client of a few lines, as the guide describes it."""

    def __init__(self) -> None:
        self._socket = socket.create_connection((HOST, PORT), 5.0)
        assert self.asked("V", struct.pack(">H", 2)) == b"\1"

    def asked(self, kind: str, body: bytes = b"") -> bytes:
        """The answer to a package."""
        self.say(kind, body)
        size, _ = struct.unpack(">HB", self._exactly(3))
        return self._exactly(size - 3)

    def say(self, kind: str, body: bytes) -> None:
        self._socket.sendall(struct.pack(">HB", len(body) + 3, ord(kind)) + body)

    def close(self) -> None:
        self._socket.close()

    def _exactly(self, count: int) -> bytes:
        came = b""
        while len(came) < count:
            came += self._socket.recv(count - len(came))
        return came


@pytest.fixture(scope="module")
def wires() -> Iterator[UrWires]:
    with ur_wires(HOST) as served:
        yield served


@pytest.fixture
def controller(wires: UrWires) -> Iterator[Controller]:
    yield wires.controller
    wires.controller.mend()


@pytest.fixture
def wire(wires: UrWires) -> Iterator[Wire]:
    client = Wire()
    yield client
    client.close()
    assert wires


def told(of: Controller, name: str) -> object:
    """An output of the controller."""
    found = output_of(name)
    assert found is not None
    return found[1](of)


def put(wire: Wire, form: str, **values: float) -> None:
    """Set inputs in one package, and wait until it was taken."""
    recipe = wire.asked("I", ",".join(values).encode())[:1]
    assert recipe != b"\0"
    wire.say("U", recipe + struct.pack(f">{form}", *values.values()))
    wire.asked("v")


def test_the_slider_is_set_where_its_mask_says_so(controller: Controller, wire: Wire) -> None:
    put(wire, "Id", speed_slider_mask=0, speed_slider_fraction=0.4)
    assert told(controller, "target_speed_fraction") == 1.0
    put(wire, "Id", speed_slider_mask=1, speed_slider_fraction=0.4)
    assert told(controller, "target_speed_fraction") == 0.4


def test_digital_outputs_are_set_and_told(controller: Controller, wire: Wire) -> None:
    put(wire, "BB", standard_digital_output_mask=4, standard_digital_output=255)
    put(wire, "BB", tool_digital_output_mask=2, tool_digital_output=2)
    assert told(controller, "actual_digital_output_bits") == 1 << 2 | 1 << 17


def test_analogue_outputs_are_volts_or_milliamperes(controller: Controller, wire: Wire) -> None:
    values = {"standard_analog_output_mask": 3, "standard_analog_output_type": 1}
    put(wire, "BBdd", **values, standard_analog_output_0=0.25, standard_analog_output_1=0.5)
    assert told(controller, "standard_analog_output0") == pytest.approx(2.5)
    assert told(controller, "standard_analog_output1") == pytest.approx(0.012)
    assert told(controller, "analog_io_types") == 0b0100


def test_bit_registers_are_written_as_one_number(controller: Controller, wire: Wire) -> None:
    put(wire, "I", input_bit_registers32_to_63=1 << 31 | 5)
    assert told(controller, "input_bit_registers32_to_63") == 1 << 31 | 5
    assert [number for number, bit in enumerate(controller.registers.bits_in) if bit] == [32, 34, 63]


@pytest.mark.parametrize("names", ["", "actual_q,actual_dance"])
def test_a_recipe_that_cannot_run_is_not_started(wire: Wire, names: str) -> None:
    answer = wire.asked("O", struct.pack(">d", 125.0) + names.encode())
    assert ("NOT_FOUND" in answer.decode()) == bool(names)
    assert wire.asked("S") == b"\0"


def test_joints_tell_whether_they_have_power(controller: Controller) -> None:
    assert told(controller, "joint_mode") == (253,) * 6
    controller.power_off()
    assert controller.robot_mode is RobotMode.POWER_OFF
    assert told(controller, "joint_mode") == (239,) * 6


def test_the_target_s_speed_is_that_of_the_set_points(controller: Controller) -> None:
    arm = controller.arm
    turning = np.array([0.0, 0.0, 0.0, 0.0, 0.0, 0.5])
    seen = arm.measured
    arm.measured = type(seen)(**{**seen.__dict__, "target_speeds_rad_s": turning})
    speed = np.array(told(controller, "target_TCP_speed"))
    assert np.linalg.norm(speed[3:]) == pytest.approx(0.5, abs=1e-3)
    assert np.linalg.norm(speed[:3]) < 1e-6
