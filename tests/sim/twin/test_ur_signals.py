"""Signals on the terminals of a UR, beside whoever moves the arm: read, set, told as facts, and lost in words."""

from __future__ import annotations

from collections.abc import Callable, Iterator

import pytest
from pydantic import ValidationError

from bracket_cell.skills.drivers.settings import UrSignalSettings
from bracket_cell.skills.drivers.ur_signals import UrSignals
from bracket_ground.errors import DeviceFault
from bracket_ground.interfaces.clock import WallClock
from bracket_sim.twin.controller import UrWires
from tests.sim.twin.rig import light_cell, own_host, slower_now

INPUTS = {"gate": "digital 3", "button": "configurable 1", "tool": "tool 0", "plc": "register 70", "reduced": "reduced",
          "open": "safeguard_stop", "pressed": "analog 1 > 4.5", "flows": "tool analog 0 > 0.012"}  # fmt: skip
OUTPUTS = {"light": "digital 2", "lamp": "configurable 7", "valve": "tool 1", "ready": "register 64"}


@pytest.fixture(scope="module")
def wires() -> Iterator[tuple[UrWires, str, float]]:
    host, slower = own_host(61), slower_now()
    cell = light_cell({role: {"kind": "ur", "host": host} for role in ("arm", "signals")}, "ur10", slower)
    (served,) = cell.serve()
    assert isinstance(served, UrWires)
    yield served, host, slower
    cell.close()


@pytest.fixture
def signals(wires: tuple[UrWires, str, float]) -> Iterator[UrSignals]:
    _, host, slower = wires
    found = UrSignals(UrSignalSettings(host=host, inputs=INPUTS, outputs=OUTPUTS), WallClock(slower))
    yield found
    found.close()


def wait_for(true: Callable[[], bool], clock: WallClock, limit_s: float = 5.0) -> bool:
    until_s = clock.now_s() + limit_s
    while not true() and clock.now_s() < until_s:
        clock.sleep_until(clock.now_s() + 0.02)
    return true()


def test_terminals_registers_and_facts_are_read(wires: tuple[UrWires, str, float], signals: UrSignals) -> None:
    of, clock = wires[0].controller, WallClock(wires[2])
    told = signals.read()
    assert {name: told[name] for name in INPUTS} == dict.fromkeys(INPUTS, False)
    of.inputs = 1 << 3 | 1 << 9 | 1 << 16
    of.registers.bits_out[70] = True
    of.analog |= {"standard_analog_input1": 4.6, "tool_analog_input0": 0.0121}
    of.safeguard(closed=False)
    expected = {**dict.fromkeys(INPUTS, True), "reduced": False}
    assert wait_for(lambda: {name: signals.read()[name] for name in INPUTS} == expected, clock)
    of.mend()


def test_reduced_mode_is_a_fact(wires: tuple[UrWires, str, float], signals: UrSignals) -> None:
    of, clock = wires[0].controller, WallClock(wires[2])
    of.reduce(on=True)
    assert wait_for(lambda: signals.read()["reduced"], clock)
    of.reduce(on=False)
    assert wait_for(lambda: not signals.read()["reduced"], clock)


def test_outputs_are_set_and_others_left_alone(wires: tuple[UrWires, str, float], signals: UrSignals) -> None:
    of, clock = wires[0].controller, WallClock(wires[2])
    of.outputs |= 1 << 5
    for name in OUTPUTS:
        signals.write(name, True)
    assert wait_for(lambda: of.outputs == 1 << 2 | 1 << 15 | 1 << 17 | 1 << 5, clock)
    assert wait_for(lambda: of.registers.bits_in[64], clock)
    signals.write("light", False)
    assert wait_for(lambda: of.outputs == 1 << 15 | 1 << 17 | 1 << 5, clock)
    assert signals.read()["lamp"]
    with pytest.raises(DeviceFault, match="no output 'horn'; there are: light, lamp, valve, ready"):
        signals.write("horn", True)


def test_who_sets_a_terminal_already_is_named(wires: tuple[UrWires, str, float], signals: UrSignals) -> None:
    signals.write("light", True)
    settings = UrSignalSettings(host=wires[1], outputs={"lamp": "digital 0"})
    with pytest.raises(DeviceFault, match="standard_digital_output is IN_USE"):
        UrSignals(settings, WallClock(wires[2]))


def test_nobody_there_is_said_in_words() -> None:
    with pytest.raises(DeviceFault, match=r"signals: no controller answers at 127\.9\.9\.9"):
        UrSignals(UrSignalSettings(host="127.9.9.9"), WallClock())


@pytest.mark.parametrize("terminal", ["digital 8", "tool 2", "register 63", "register 128", "analog 1", "digital"])
def test_a_terminal_that_there_is_not_is_refused(terminal: str) -> None:
    with pytest.raises(ValidationError, match="gate"):
        UrSignalSettings(host="192.0.2.1", inputs={"gate": terminal})
