"""Digital signals over CAN, from the tree file to the simulated module and back, and in the log."""

from __future__ import annotations

from pathlib import Path
from typing import cast

import can
import pytest

from bracket_cell.skills.drivers.can_signals import CanSignals
from bracket_cell.skills.drivers.settings import SignalSettings
from bracket_ground.errors import DeviceFault, InputError
from bracket_ground.interfaces.clock import ManualClock
from bracket_sim.cell import SimCell
from bracket_sim.devices.signal_node import SignalNode
from bracket_sim.scene.settings import SimSignals
from tests.integration.cell_rig import BENCH, CAN, CONFIGURATION, PRODUCT, SIMULATION, run_tree

TREE = """<root BTCPP_format="4"><BehaviorTree ID="Main"><Sequence>
  <WaitForSignal signal="ready" value="false" timeout_s="1"/>
  <SetSignal signal="start"/>
  <WaitForSignal signal="ready" timeout_s="2"/>
  <SetSignal signal="start" value="false"/>
  <WaitForSignal signal="ready" value="false" timeout_s="2"/>
  <Inverter><SignalIs signal="ready"/></Inverter>
</Sequence></BehaviorTree></root>"""


def settings(channel: str) -> SignalSettings:
    return SignalSettings(channel=channel, inputs={"ready": 3}, outputs={"start": 1, "lamp": 9})


def test_an_input_follows_an_output_and_silence_is_a_fault() -> None:
    clock = ManualClock()
    node = SignalNode(SimSignals(channel="there and back", wires={3: 1}, delay_s=0.2))
    master = CanSignals(settings("there and back"), clock)

    def after(time_s: float) -> dict[str, bool]:
        while clock.now_s() < time_s - 1e-9:
            clock.sleep_until(clock.now_s() + 0.01)
            node.update(clock.now_s(), 0.01)
        return master.read()

    assert master.read() == {"start": False, "lamp": False}
    assert after(0.05) == {"ready": False, "start": False, "lamp": False}
    master.write("start", True)
    assert after(0.15)["ready"] is False
    assert after(0.30)["ready"] is True
    master.write("lamp", True)
    after(0.6)
    assert node.outputs == 0b1000000010
    with pytest.raises(DeviceFault, match="no output 'lamb'; there are: start, lamp"):
        master.write("lamb", True)
    clock.sleep_until(2.0)
    with pytest.raises(DeviceFault, match="no word of the inputs for"):
        master.read()
    node.close()
    master.close()


def test_an_input_that_the_module_does_not_tell_is_a_fault_and_not_off() -> None:
    bus = can.Bus(interface="virtual", channel="one byte")
    master = CanSignals(SignalSettings(channel="one byte", inputs={"near": 3, "far": 8}), ManualClock())
    bus.send(can.Message(arbitration_id=0x1A0, data=b"\x08\x00", is_extended_id=False))
    assert master.read() == {"near": True, "far": False}
    bus.send(can.Message(arbitration_id=0x1A0, data=b"\x08", is_extended_id=False))
    with pytest.raises(DeviceFault, match="the module tells 8 inputs; far is bit 8"):
        master.read()
    bus.shutdown()
    master.close()


def test_a_bus_that_is_never_empty_is_a_fault_and_no_endless_tick() -> None:
    """A node that babbles faster than frames are read."""
    left = [0]

    class Babbles:
        def send(self, _: can.Message) -> None: ...

        def recv(self, timeout: float) -> can.Message | None:
            left[0] -= 1
            assert left[0] > -10_000, f"it reads for ever (timeout {timeout})"
            return can.Message(arbitration_id=0x1A0, data=b"\x08", is_extended_id=False)

    master = CanSignals(settings("babbles"), ManualClock(), cast("can.BusABC", Babbles()))
    with pytest.raises(DeviceFault, match="more than 500 frames wait"):
        master.read()


def test_a_tree_sets_signals_and_waits_for_them(tmp_path: Path) -> None:
    file = tmp_path / "tree.xml"
    file.write_text(TREE)
    module = SimSignals(channel="tree and module", wires={3: 1})
    simulation = SIMULATION.model_copy(update={"signals": module})
    devices = CONFIGURATION.devices.model_copy(update={"signals": settings("tree and module")})
    configuration = CONFIGURATION.model_copy(update={"devices": devices})
    cell = SimCell(PRODUCT, BENCH, simulation, *CAN, 1, "g0", worker=False, clutter=())
    try:
        outcome, _ = run_tree(cell, file, configuration=configuration)
    finally:
        cell.close()
    assert outcome.end == "finished"
    assert 0.4 < outcome.sim_time_s < 2.0


def test_a_signal_that_nobody_knows_is_told_before_anything_moves(tmp_path: Path) -> None:
    file = tmp_path / "tree.xml"
    file.write_text(TREE)
    cell = SimCell(PRODUCT, BENCH, SIMULATION, *CAN, 1, "g0", worker=False, clutter=())
    try:
        with pytest.raises(InputError, match=r"tree\.xml:2:26: the bench has no signal 'ready'"):
            run_tree(cell, file)
    finally:
        cell.close()
