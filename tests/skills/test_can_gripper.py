"""The CAN driver against a scripted node: the contract, the bus's faults, and what the recorder is told."""

from __future__ import annotations

import errno
import os
import re
from collections.abc import Callable, Iterator
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path

import can
import cantools.database
import pytest
from can.interfaces.virtual import VirtualBus
from cantools.database.can import Database
from hypothesis import given
from hypothesis import strategies as st

from bracket_cell.skills.drivers.can_gripper import CanFrame, CanGripper
from bracket_cell.skills.drivers.gripper_database import SHIPPED, load_gripper_database
from bracket_cell.skills.drivers.settings import CanSettings
from bracket_ground.contracts import gripper as gripper_contract
from bracket_ground.errors import DeviceFault, SettingError
from bracket_ground.interfaces.can_bus import open_bus
from bracket_ground.interfaces.command import GripperCommand
from bracket_ground.interfaces.observation import ObjectStatus
from tests.skills.scripted_node import NodeClock, ScriptedNode

STATUS_ID, HEARTBEAT_ID, EMERGENCY_ID, COMMAND_ID = 0x18A, 0x70A, 0x08A, 0x20A


@dataclass
class Rig:
    """Driver and node on one bus."""

    channel: str
    node: ScriptedNode
    clock: NodeClock
    gripper: CanGripper
    frames: list[CanFrame] = field(default_factory=list)

    @property
    def bench(self) -> gripper_contract.Bench:
        def put(width_m: float) -> None:
            self.node.part_m = width_m

        return gripper_contract.Bench(self.gripper, self.clock, put, speed_m_s=(0.020, 0.150), force_n=(20.0, 235.0))


@pytest.fixture
def rig(request: pytest.FixtureRequest) -> Iterator[Rig]:
    settings = CanSettings(channel=request.node.nodeid)
    node = ScriptedNode(settings.channel)
    clock = NodeClock(node)
    frames: list[CanFrame] = []
    gripper = CanGripper(settings, clock)
    gripper.tap(frames.append)
    yield Rig(settings.channel, node, clock, gripper, frames)
    gripper.close()
    node.bus.shutdown()


@pytest.mark.contract
@pytest.mark.parametrize("check", gripper_contract.CHECKS)
def test_contract(rig: Rig, check: Callable[[gripper_contract.Bench], None]) -> None:
    check(rig.bench)


@pytest.mark.contract
@pytest.mark.parametrize("check", gripper_contract.CHECKS)
def test_contract_holds_with_every_frame_doubled(rig: Rig, check: Callable[[gripper_contract.Bench], None]) -> None:
    rig.node.copies = 2
    check(rig.bench)


def test_before_the_first_frame_nothing_is_known(rig: Rig) -> None:
    state = rig.gripper.state()
    assert not state.activated
    assert state.object_status is ObjectStatus.MOVING


def test_a_silent_node_is_a_fault_after_start_up(rig: Rig) -> None:
    rig.node.mute_heartbeat = rig.node.mute_status = True
    rig.gripper.state()  # from now on somebody waits
    rig.clock.sleep_until(0.96)
    rig.gripper.state()
    rig.clock.sleep_until(1.04)
    with pytest.raises(DeviceFault, match="no heartbeat"):
        rig.gripper.state()


def test_a_lost_heartbeat_is_a_fault_after_one_and_a_half_periods(rig: Rig) -> None:
    rig.bench.wait(0.4)
    last_s = max(frame.time_s for frame in rig.frames if frame.identifier == HEARTBEAT_ID)
    rig.node.mute_heartbeat = True
    rig.clock.sleep_until(last_s + 0.14)
    rig.gripper.state()
    rig.clock.sleep_until(last_s + 0.16)
    with pytest.raises(DeviceFault, match=r"no heartbeat for 0\.160 s, limit 0\.150 s"):
        rig.gripper.state()


def test_a_slow_tick_is_no_lost_heartbeat(rig: Rig) -> None:
    rig.bench.wait(0.4)
    rig.clock.sleep_until(3.0)
    rig.gripper.state()


class FullQueue(VirtualBus):
    """An adapter that is busy: so many frames from now on do not fit into its queue."""

    full = 0

    def send(self, msg: can.Message, timeout: float | None = None) -> None:
        if self.full:
            self.full -= 1
            raise can.CanOperationError("Failed to transmit: No buffer space available", errno.ENOBUFS)
        super().send(msg, timeout)


def full_queue(rig: Rig) -> FullQueue:
    bus = FullQueue(rig.channel, receive_own_messages=True)

    def changed(before: can.BusABC, _: Database) -> can.BusABC:
        before.shutdown()
        return bus

    rig.gripper.change_bus(changed)
    return bus


def test_a_queue_that_is_full_for_a_moment_is_no_lost_gripper(rig: Rig) -> None:
    rig.bench.activated()
    bus = full_queue(rig)
    bus.full = 2
    rig.gripper.command(GripperCommand(0.020, 0.15))
    state = rig.gripper.state()
    assert state.bus_errors == "the queue of what is to be sent is full"
    assert rig.bench.settle().opening_m == pytest.approx(0.020, abs=0.001)


def test_a_queue_that_stays_full_is_a_lost_gripper(rig: Rig) -> None:
    rig.bench.activated()
    full_queue(rig).full = 1000
    rig.gripper.command(GripperCommand(0.020))
    with pytest.raises(DeviceFault, match="No buffer space available"):
        rig.bench.wait(0.12)


@pytest.mark.parametrize("fault", [0x08, 0x09, 0x0C, 0x0E])
def test_major_faults_stop_the_cell(rig: Rig, fault: int) -> None:
    rig.bench.activated()
    rig.node.fault = fault
    with pytest.raises(DeviceFault, match=f"0x{fault:02X}"):
        rig.bench.wait(0.1)


@pytest.mark.parametrize("fault", [0x05, 0x07])
def test_minor_faults_are_reported(rig: Rig, fault: int) -> None:
    rig.bench.wait(0.2)
    rig.node.fault = fault
    assert rig.bench.wait(0.1).fault == fault


def test_an_emergency_is_a_fault_until_it_clears(rig: Rig) -> None:
    rig.bench.activated()
    rig.node.send("GripperEmergency", {"ErrorCode": 0xFF0E, "ErrorRegister": 1, "FaultStatus": 0x0E})
    with pytest.raises(DeviceFault, match="overcurrent"):
        rig.gripper.state()
    rig.node.send("GripperEmergency", {"ErrorCode": 0, "ErrorRegister": 0, "FaultStatus": 0})
    assert rig.gripper.state().fault == 0


def test_an_emergency_that_clears_before_anybody_looks_is_told_once(rig: Rig) -> None:
    rig.bench.activated()
    for code in (0xFF0E, 0, 0xFF0E, 0):
        rig.node.send("GripperEmergency", {"ErrorCode": code, "ErrorRegister": 1, "FaultStatus": 0x0E * (code > 0)})
    with pytest.raises(DeviceFault, match="overcurrent"):
        rig.gripper.state()
    assert rig.gripper.state().fault == 0


@pytest.mark.parametrize(
    ("identifier", "data"),
    [
        (STATUS_ID, b"\xf9"),
        (STATUS_ID, b""),
        (HEARTBEAT_ID, b"\x05\x05"),
        (EMERGENCY_ID, b"\x0e"),
    ],
)
def test_odd_frames_are_counted_and_change_nothing(rig: Rig, identifier: int, data: bytes) -> None:
    before = rig.bench.activated()
    rig.node.send_raw(identifier, data)
    assert rig.gripper.state() == before
    assert rig.gripper.ignored_frames == 1


def test_a_lost_command_is_repeated(rig: Rig) -> None:
    rig.bench.activated()
    rig.node.deaf = True
    rig.gripper.command(GripperCommand(0.020, 0.15, 60.0))
    assert rig.bench.wait(0.2).object_status is ObjectStatus.MOVING
    rig.node.deaf = False
    assert rig.bench.settle().opening_m == pytest.approx(0.020, abs=0.001)


def test_commands_keep_coming_so_that_the_gripper_does_not_time_out(rig: Rig) -> None:
    rig.bench.activated()
    count = len(rig.node.commands)
    rig.bench.wait(2.0)
    assert len(rig.node.commands) >= count + 5
    assert len(set(rig.node.commands[count:])) == 1


def test_the_tap_sees_every_frame_with_the_injected_time(rig: Rig) -> None:
    rig.bench.activated()
    sent = [frame for frame in rig.frames if frame.sent]
    assert [frame.data for frame in sent] == rig.node.commands
    assert {frame.identifier for frame in sent} == {COMMAND_ID}
    received = [frame for frame in rig.frames if not frame.sent]
    assert {frame.identifier for frame in received} == {STATUS_ID, HEARTBEAT_ID}
    times = [frame.time_s for frame in rig.frames]
    assert times == sorted(times)
    assert times[-1] <= rig.clock.now_s()


def test_a_dead_bus_is_a_device_fault(rig: Rig, monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(*_: object, **__: object) -> None:
        raise can.CanOperationError("bus off")

    monkeypatch.setattr(VirtualBus, "send", refuse)
    with pytest.raises(DeviceFault, match="bus off"):
        rig.gripper.activate()


def test_a_gripper_that_restarts_is_not_activated_again_unasked(rig: Rig) -> None:
    rig.bench.activated()
    rig.gripper.command(GripperCommand(0.020, 0.15, 60.0))
    rig.bench.settle()
    rig.node.restart()
    count = len(rig.node.commands)
    state = rig.bench.wait(2.0)
    assert not state.activated
    assert not any(command[0] & 1 for command in rig.node.commands[count:])
    assert state.opening_m == pytest.approx(0.020, abs=0.001)
    rig.gripper.activate()
    assert rig.bench.wait(0.5).activated


def test_a_restart_whose_boot_up_frame_is_lost_shows_in_the_status(rig: Rig) -> None:
    rig.bench.activated()
    rig.node.mute_heartbeat = True
    rig.node.restart()
    rig.node.mute_heartbeat = False
    count = len(rig.node.commands)
    assert not rig.bench.wait(1.0).activated
    assert not any(command[0] & 1 for command in rig.node.commands[count + 1 :])


def test_an_active_gripper_is_adopted_with_what_it_holds(rig: Rig) -> None:
    rig.bench.activated()
    rig.node.part_m = 0.034
    rig.gripper.command(GripperCommand(0.020, 0.15, 60.0))
    held = rig.bench.settle()
    assert held.holding
    second = CanGripper(CanSettings(channel=rig.channel), rig.clock)
    bench = gripper_contract.Bench(second, rig.clock, lambda _: None)
    adopted = bench.wait(1.5)
    assert adopted.activated
    assert adopted.holding
    assert adopted.opening_m == held.opening_m
    second.hold()
    assert bench.wait(0.5).opening_m == held.opening_m
    second.command(GripperCommand(0.080, 0.15, 60.0))
    assert bench.settle().opening_m == pytest.approx(0.080, abs=0.001)
    second.close()


def test_a_node_that_starts_up_after_the_first_command_is_activated(rig: Rig) -> None:
    rig.gripper.activate()
    rig.node.send("GripperHeartbeat", {"NodeState": 0})
    assert rig.bench.wait(0.5).activated
    assert rig.bench.wait(2.0).activated


def test_the_state_of_the_node_is_told(rig: Rig) -> None:
    rig.bench.wait(0.2)
    for raw, state in ((4, "stopped"), (0x7F, "pre_operational"), (5, "operational"), (3, "unknown")):
        rig.node.send("GripperHeartbeat", {"NodeState": raw})
        assert rig.gripper.state().node_state == state


class LosesWhatIsSent:
    """A bus whose frames do not go out any more once it is deaf."""

    def __init__(self, bus: can.BusABC) -> None:
        self._bus, self.deaf = bus, False

    def send(self, message: can.Message) -> None:
        if not self.deaf:
            self._bus.send(message)

    def __getattr__(self, name: str) -> object:
        return getattr(self._bus, name)


@pytest.mark.parametrize(("echo", "seen"), [(True, True), (False, False)])
def test_commands_that_do_not_go_out_are_noticed_by_their_missing_echo(echo: bool, seen: bool) -> None:
    settings = CanSettings(channel=f"deaf bus {echo}")
    node = ScriptedNode(settings.channel)
    clock = NodeClock(node)
    bus = LosesWhatIsSent(open_bus(settings.interface, settings.channel, echo=echo))
    gripper = CanGripper(settings, clock, bus)  # type: ignore[arg-type]  # it only looks like one
    bench = gripper_contract.Bench(gripper, clock, lambda _: None)
    bench.activated()
    bench.wait(1.0)  # as long as frames go out nothing is said
    bus.deaf, began_s = True, clock.now_s()
    if seen:
        with pytest.raises(DeviceFault, match="commands do not go out"):
            bench.wait(0.8)
        assert clock.now_s() - began_s <= 0.21
    else:
        bench.wait(0.8)
    gripper.close()
    node.bus.shutdown()


def test_a_status_that_stays_away_keeps_its_age(rig: Rig) -> None:
    before = rig.bench.activated()
    rig.node.mute_status = True
    after = rig.bench.wait(0.5)
    assert after.time_s == pytest.approx(before.time_s, abs=0.021)


def test_a_dead_network_is_a_device_fault(rig: Rig, monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(*_: object, **__: object) -> None:
        raise OSError(100, "Network is down")

    monkeypatch.setattr(VirtualBus, "recv", refuse)
    with pytest.raises(DeviceFault, match="Network is down"):
        rig.gripper.state()


BAD_FRAMES = {
    "empty": lambda _: "",
    "binary": lambda _: "\x00\x01\x02",
    "no command": lambda text: text.replace("GripperCommand", "Other"),
    "no status": lambda text: text.replace("GripperStatus", "Other"),
    "no heartbeat": lambda text: text.replace("BO_ 1802 GripperHeartbeat", "BO_ 1802 Other"),
    "no fault": lambda text: text.replace("gFLT", "gXYZ"),
    "no position": lambda text: text.replace(" SG_ rPR", " SG_ rQQ"),
    "length": lambda text: text.replace("BO_ 522 GripperCommand: 8", "BO_ 522 GripperCommand: 4"),
    "flipped": lambda text: text.replace("rPR : 24|8@1+ (-0.333333333333,85)", "rPR : 24|8@1+ (0.333333333333,0)"),
    "factor": lambda text: text.replace("(0.843137254901,20)", "(1e300,20)"),
    "twice": lambda text: text + '\nBO_ 700 GripperHeartbeat: 1 Gripper\n SG_ NodeState : 1|7@1+ (1,0) [0|127] "" X\n',
    "identifier": lambda text: text + '\nBO_ 394 Lamp: 8 Gripper\n SG_ on : 0|1@1+ (1,0) [0|1] "" Controller\n',
    "no such signal": lambda text: text + '\nVAL_ 394 nothing 0 "off" ;\n',
    "overlap": lambda text: text.replace("rSP : 32|8", "rSP : 28|8"),
}


@pytest.mark.parametrize("change", BAD_FRAMES.values(), ids=BAD_FRAMES.keys())
def test_frames_that_do_not_fit_are_refused(change: Callable[[str], str], tmp_path: Path) -> None:
    path = tmp_path / "mine.dbc"
    path.write_text(change(SHIPPED.read_text()))
    with pytest.raises(SettingError, match=re.escape(str(path))):
        load_gripper_database(path)


SIGNAL = re.compile(r"SG_ (\w+) : (\d+)\|(\d+)@1\+ \(([-.\d]+),([-.\d]+)\)")
ELSEWHERE: dict[str, Callable[[list[str]], str]] = {
    "start": lambda told: "SG_ {0} : {start}|{2}@1+ ({3},{4})".format(*told, start=63 - int(told[2])),
    "length": lambda told: "SG_ {0} : {1}|{length}@1+ ({3},{4})".format(*told, length=1 if told[2] != "1" else 2),
    "order": lambda told: "SG_ {} : {}|{}@0+ ({},{})".format(*told),
    "sign": lambda told: "SG_ {} : {}|{}@1- ({},{})".format(*told),
    "factor": lambda told: "SG_ {0} : {1}|{2}@1+ ({factor},{4})".format(*told, factor=1.5 * float(told[3])),
    "offset": lambda told: "SG_ {0} : {1}|{2}@1+ ({3},{offset})".format(*told, offset=float(told[4]) + 20),
}


@pytest.mark.parametrize("change", ELSEWHERE)
@pytest.mark.parametrize("name", [told[1] for told in SIGNAL.finditer(SHIPPED.read_text())])
def test_a_register_that_is_elsewhere_or_means_something_else_is_refused(
    name: str, change: str, tmp_path: Path
) -> None:
    path, text = tmp_path / "mine.dbc", SHIPPED.read_text()
    told = next(one for one in SIGNAL.finditer(text) if one[1] == name)
    path.write_text(text.replace(told[0], ELSEWHERE[change](list(told.groups()))))
    with pytest.raises(SettingError, match=f"{name}|signals .* are overlapping"):
        load_gripper_database(path)


def test_frames_of_other_nodes_in_the_file_are_no_statuses(tmp_path: Path) -> None:
    path = tmp_path / "mine.dbc"
    path.write_text(SHIPPED.read_text() + '\nBO_ 700 Lamp: 8 Gripper\n SG_ on : 0|1@1+ (1,0) [0|1] "" Controller\n')
    node = ScriptedNode("lamp")
    gripper = CanGripper(CanSettings(channel="lamp", database=path), NodeClock(node))
    with suppress(DeviceFault):
        node.send_raw(700, bytes(8))
        gripper.state()
    gripper.close()
    assert gripper.ignored_frames == 0


def test_a_file_that_never_ends_is_refused(tmp_path: Path) -> None:
    os.mkfifo(path := tmp_path / "mine.dbc")
    with pytest.raises(SettingError, match="this is not a file"):
        load_gripper_database(path)


@pytest.mark.parametrize("interface", ["kvaser", "serial", "robotell", "socketcand", "udp_multicast", "cantact"])
def test_an_adapter_that_is_not_there_is_told(interface: str, caplog: pytest.LogCaptureFixture) -> None:
    with pytest.raises(SettingError, match=f"no CAN bus '{interface}' '0': "):
        open_bus(interface, "0")
    assert not caplog.records


def test_other_identifiers_and_a_finer_scale_are_a_file_of_ones_own(tmp_path: Path) -> None:
    path, text = tmp_path / "mine.dbc", SHIPPED.read_text()
    path.write_text(
        text.replace("522", "523").replace("gPO : 32|8@1+ (-0.333333333333,85)", "gPO : 32|8@1+ (-0.34,86)")
    )
    assert load_gripper_database(path).get_message_by_name("GripperCommand").frame_id == 523


def test_another_master_is_told(rig: Rig) -> None:
    rig.bench.activated()
    assert not rig.gripper.state().other_master
    rig.node.send("GripperCommand", {"rACT": 1, "rGTO": 1, "rATR": 0, "rARD": 0, "rPR": 85, "rSP": 20, "rFR": 20})
    assert rig.gripper.state().other_master
    assert not rig.gripper.state().other_master, "once for each time"


def test_a_gripper_that_another_master_resets_is_not_activated_again_before_that_is_known(rig: Rig) -> None:
    rig.bench.activated()
    rig.gripper.command(GripperCommand(0.020))
    rig.bench.wait(0.5)
    rig.clock.sleep_until(rig.clock.now_s() + 0.1)  # a command is due
    other = can.Bus(interface="virtual", channel=rig.channel)
    other.send(can.Message(arbitration_id=COMMAND_ID, data=bytes(8), is_extended_id=False))
    other.shutdown()
    assert rig.gripper.state().other_master
    rig.node.step()
    assert rig.node.commands[-1] == bytes(8), "activated again, its fingers would open"


def test_a_status_that_does_not_repeat_the_command_is_no_answer_to_it(rig: Rig) -> None:
    rig.bench.activated()
    rig.node.mute_status = True
    rig.gripper.command(GripperCommand(0.020, 0.15, 60.0))
    state = rig.gripper.state()
    assert not state.echoed
    assert state.object_status is ObjectStatus.MOVING


def test_heartbeats_of_two_nodes_are_told(rig: Rig) -> None:
    rig.bench.activated()
    for state in (5, 127, 5, 127):
        rig.node.send("GripperHeartbeat", {"NodeState": state})
    assert rig.gripper.state().bus_errors == "heartbeats contradict one another"


def test_a_state_that_no_node_has_is_told(rig: Rig) -> None:
    rig.bench.activated()
    rig.node.send("GripperHeartbeat", {"NodeState": 77})
    assert rig.gripper.state().bus_errors == "a heartbeat tells the state 77, which there is not"


def test_a_node_that_says_that_it_has_started_is_not_active_whatever_its_status_says(rig: Rig) -> None:
    rig.bench.activated()
    rig.node.send("GripperHeartbeat", {"NodeState": 0})
    assert not rig.gripper.state().activated
    rig.gripper.activate()
    assert rig.bench.wait(2.0).activated


class WithFrames:
    """A bus with frames before those that really come."""

    def __init__(self, bus: can.BusABC) -> None:
        self._bus, self.frames = bus, list[can.Message]()
        self.read = 0

    def recv(self, timeout: float | None = None) -> can.Message | None:
        self.read += 1
        return self.frames.pop(0) if self.frames else self._bus.recv(timeout)

    def __getattr__(self, name: str) -> object:
        return getattr(self._bus, name)


def crowded(rig: Rig) -> WithFrames:
    """The rig's bus with room for more frames."""
    made: list[WithFrames] = []

    def change(bus: can.BusABC, _: object) -> can.BusABC:
        made.append(WithFrames(bus))
        return made[0]  # type: ignore[return-value]  # it only looks like one

    rig.gripper.change_bus(change)
    return made[0]


def test_error_frames_are_told(rig: Rig) -> None:
    bus = crowded(rig)
    rig.bench.activated()
    bus.frames = [can.Message(is_error_frame=True, arbitration_id=4, data=bytes(8))] * 3
    assert rig.gripper.state().bus_errors == "error frames"
    assert rig.gripper.state().bus_errors == ""


def test_a_burst_of_frames_is_read_over_several_ticks_and_makes_no_old_status_new(rig: Rig) -> None:
    bus = crowded(rig)
    before = rig.bench.activated()
    rig.node.mute_status = True
    old = can.Message(arbitration_id=STATUS_ID, data=bytes.fromhex("3900000000000000"), is_extended_id=False)
    bus.frames, bus.read = [old] * 3000, 0
    for tick in range(1, 6):
        rig.clock.sleep_until(rig.clock.now_s() + 0.04)
        state = rig.gripper.state()
        assert bus.read == 500 * tick
        assert state.bus_errors == "more than 500 frames wait"
        assert state.time_s <= before.time_s + 0.041, "nobody knows how old what waited is"


def test_frames_of_others_hold_up_no_status(rig: Rig) -> None:
    """A filter of python-can ends the reading of a tick at the first of them, and statuses grow old behind them."""
    rig.bench.activated()
    for _ in range(100):
        rig.node.send_raw(0x123, b"\x01\x02")
    rig.node.send("GripperHeartbeat", {"NodeState": 4})
    assert rig.gripper.state().node_state == "stopped"
    assert rig.gripper.ignored_frames == 0
    assert 0x123 not in {frame.identifier for frame in rig.frames}


@pytest.mark.parametrize("path", ["nowhere.dbc", "."])
def test_frames_that_cannot_be_read_are_refused(path: str) -> None:
    with pytest.raises(SettingError, match=re.escape(path)):
        load_gripper_database(Path(path))


def test_the_database_has_the_manuals_bits() -> None:
    database = _database()
    data = database.encode_message(
        "GripperCommand", {"rACT": 1, "rGTO": 1, "rATR": 0, "rARD": 0, "rPR": 0, "rSP": 150, "rFR": 235}
    )
    assert data.hex() == "090000ffffff0000"
    status = database.decode_message("GripperStatus", bytes.fromhex("b9000000ff0a0000"))
    assert isinstance(status, dict)
    assert status["gSTA"] == "active"
    assert status["gOBJ"] == "contact while closing"
    assert status["gPO"] == pytest.approx(0.0, abs=1e-6)
    assert status["gCU"] == pytest.approx(0.10)


@given(
    opening_mm=st.floats(0, 85),
    speed_mm_s=st.floats(20, 150),
    force_n=st.floats(20, 235),
)
def test_encoding_rounds_to_the_registers_step(opening_mm: float, speed_mm_s: float, force_n: float) -> None:
    values = {"rACT": 1, "rGTO": 1, "rATR": 0, "rARD": 0, "rPR": opening_mm, "rSP": speed_mm_s, "rFR": force_n}
    back = DATABASE.decode_message("GripperCommand", DATABASE.encode_message("GripperCommand", values))
    assert isinstance(back, dict)
    assert back["rPR"] == pytest.approx(opening_mm, abs=85 / 255 / 2 + 1e-6)
    assert back["rSP"] == pytest.approx(speed_mm_s, abs=130 / 255 / 2 + 1e-6)
    assert back["rFR"] == pytest.approx(force_n, abs=215 / 255 / 2 + 1e-6)


def _database() -> Database:
    database = cantools.database.load_file(SHIPPED)
    assert isinstance(database, Database)
    return database


DATABASE = _database()


class LostBus(VirtualBus):
    """An adapter that is off its bus for a while: reading and writing raise."""

    off = False

    def recv(self, timeout: float | None = None) -> can.Message | None:
        if self.off:
            raise can.CanOperationError("bus off")
        return super().recv(timeout)

    def send(self, msg: can.Message, timeout: float | None = None) -> None:
        if self.off:
            raise can.CanOperationError("bus off")
        super().send(msg, timeout)


def lost_bus(rig: Rig) -> LostBus:
    bus = LostBus(rig.channel, receive_own_messages=True)

    def changed(before: can.BusABC, _: Database) -> can.BusABC:
        before.shutdown()
        return bus

    rig.gripper.change_bus(changed)
    return bus


def wait_lost(rig: Rig, for_s: float) -> None:
    """Tick as a controller does that holds the fingers."""
    until_s = rig.clock.now_s() + for_s
    while rig.clock.now_s() < until_s:
        rig.clock.sleep_until(rig.clock.now_s() + 0.04)
        with pytest.raises(DeviceFault):
            rig.gripper.state()
        with pytest.raises(DeviceFault):
            rig.gripper.hold()


@pytest.mark.parametrize("off_s", [0.3, 5.0, 29.0])
@pytest.mark.parametrize("part_m", [0.03, None], ids=["gripping", "at rest"])
def test_a_bus_that_was_off_is_as_it_was_before(rig: Rig, off_s: float, part_m: float | None) -> None:
    rig.bench.activated()
    rig.node.part_m = part_m
    rig.gripper.command(GripperCommand(0.01, 0.15))
    before = rig.bench.settle()
    bus = lost_bus(rig)
    rig.bench.wait(0.2)
    bus.off = True
    wait_lost(rig, off_s)
    bus.off = False
    for _ in range(8):  # a heartbeat comes by then
        rig.clock.sleep_until(rig.clock.now_s() + 0.04)
        with suppress(DeviceFault):
            rig.gripper.state()
    rig.gripper.command(GripperCommand(0.01, 0.15))
    after = rig.bench.settle()
    assert (after.holding, after.activated, after.echoed) == (before.holding, True, True)
    assert after.opening_m == pytest.approx(before.opening_m, abs=0.001)


def test_a_gripper_that_restarted_while_its_bus_was_off_is_not_activated_unasked(rig: Rig) -> None:
    rig.bench.activated()
    bus = lost_bus(rig)
    rig.bench.wait(0.2)
    bus.off = True
    wait_lost(rig, 1.0)
    rig.node.restart()
    while VirtualBus.recv(bus, 0) is not None:  # an adapter that was off has heard nothing
        pass
    rig.node.commands.clear()
    bus.off = False
    for _ in range(20):
        with suppress(DeviceFault):
            rig.gripper.hold()
        with suppress(DeviceFault):
            rig.gripper.state()
        rig.clock.sleep_until(rig.clock.now_s() + 0.04)
    assert not any(data[0] & 1 for data in rig.node.commands), "nothing told it to activate itself"
    assert not rig.gripper.state().activated


@pytest.mark.parametrize("every", [1, 4, 20])
@pytest.mark.parametrize("part_m", [0.03, None], ids=["gripping", "at rest"])
def test_another_node_with_old_statuses_under_our_identifier_is_told(
    rig: Rig, every: int, part_m: float | None
) -> None:
    rig.bench.activated()
    old = rig.node._status(3)
    rig.node.part_m = part_m
    rig.gripper.command(GripperCommand(0.01, 0.15))
    assert not rig.bench.settle().two_nodes
    for number in range(60):
        if number % every == 0:
            rig.node.send("GripperStatus", old)
        rig.clock.sleep_until(rig.clock.now_s() + 0.02)
        state = rig.gripper.state()
    assert state.two_nodes
    rig.bench.wait(2.5)
    assert not rig.gripper.state().two_nodes


def test_fingers_that_are_held_and_go_on_again_and_again_are_one_node(rig: Rig) -> None:
    """As where a hand comes and goes beside an arm that grips: what was told to hold is told to go on."""
    rig.bench.activated()
    for _ in range(6):
        rig.gripper.command(GripperCommand(0.01, 0.15))
        rig.bench.wait(0.3)
        assert not rig.gripper.state().two_nodes
        rig.gripper.hold()
        rig.bench.wait(0.3)
        assert not rig.gripper.state().two_nodes


def test_between_two_openings_and_back_they_are_one_node(rig: Rig) -> None:
    rig.bench.activated()
    for opening_m in (0.06, 0.03) * 4:
        rig.gripper.command(GripperCommand(opening_m, 0.15))
        rig.bench.wait(0.3)
        assert not rig.gripper.state().two_nodes


@pytest.mark.parametrize("copies", [1, 2])
def test_fingers_that_open_and_close_are_one_node(rig: Rig, copies: int) -> None:
    rig.bench.activated()
    rig.node.copies = copies
    for opening_m in (0.0, 0.08, 0.01, 0.06, 0.0):
        rig.gripper.command(GripperCommand(opening_m, 0.15))
        rig.bench.wait(0.2)
        assert not rig.gripper.state().two_nodes
        rig.gripper.hold()
        rig.bench.wait(0.04)
        assert not rig.gripper.state().two_nodes
