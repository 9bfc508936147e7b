"""Who comes to a world's address changes nothing for the controller that works there, whatever it says or does not."""

from __future__ import annotations

import os
import pickle
import socket
import stat
import struct
import threading
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path

import pytest

from bracket_ground.errors import DeviceFault, InputError
from bracket_ground.interfaces.clock import ManualClock
from bracket_ground.interfaces.devices import Devices
from bracket_ground.interfaces.observation import ArmState
from bracket_sim.process import server
from bracket_sim.process.buses import CarriedBuses
from bracket_sim.process.client import RemoteCell, connected
from bracket_sim.process.messages import Advance, Drawn, Pace
from bracket_sim.process.opening import drawn_from
from bracket_sim.process.server import NEWCOMERS, WorldServer
from tests.cell.fakes import FakeArm, FakeCamera, FakeGripper, FakePanel

PERIOD_S, JOIN_S = 0.008, 30.0
THIS = {"product": "this"}


class World:
    """A world of fakes, served in a thread."""

    def __init__(self, address: Path) -> None:
        self.clock = ManualClock()
        self.arm, self.address = FakeArm(self.clock), address
        devices = Devices(
            clock=self.clock,
            arm=self.arm,
            gripper=FakeGripper(self.clock),
            overhead=FakeCamera(self.clock),
            wrist=FakeCamera(self.clock),
            panel=FakePanel(),
        )
        self.server = WorldServer(devices, CarriedBuses(()), address, PERIOD_S, THIS, Drawn(3, "g1"))
        self.thread = threading.Thread(target=self.server.serve, daemon=True)
        self.thread.start()

    def controller(self, pace: Pace = "fast") -> RemoteCell:
        return RemoteCell(connected(self.address), "world", pace, THIS, CarriedBuses(()))


@pytest.fixture
def world(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[World]:
    monkeypatch.setattr(server, "HELLO_S", 0.2)
    made = World(tmp_path / "w.sock")
    yield made
    made.server.end()
    made.thread.join(JOIN_S)
    assert not made.thread.is_alive()
    assert not made.address.exists()


def works(cell: RemoteCell) -> bool:
    before_s = cell.clock.now_s()
    cell.clock.sleep_until(before_s + 0.2)
    return cell.fault is None and cell.clock.now_s() > before_s


def stranger(world: World, said: bytes = b"") -> socket.socket:
    one = connected(world.address)
    one.settimeout(JOIN_S)
    if said:
        one.sendall(said)
    return one


PICKLE = b"cnowhere\nThing\n."
SAID = {
    "garbage": b"\x00\x00\x00\x05hello",
    "huge length": b"\xff\xff\xff\x7f",
    "pickle": struct.pack("<I", len(PICKLE)) + PICKLE,
    "pickle as it was sent by multiprocessing": struct.pack("!i", len(PICKLE)) + PICKLE,
    "what only a controller may say": struct.pack("<I", 11) + b"\x81\xa4type\xa4Stop",
    "hello without a product": struct.pack("<I", 12) + pickle.dumps("hello")[:12],
}


@pytest.mark.parametrize("said", SAID.values(), ids=SAID.keys())
def test_whatever_a_stranger_says_ends_its_own_connection_alone(world: World, said: bytes) -> None:
    cell = world.controller()
    with stranger(world, said) as one:
        assert works(cell)
        assert one.recv(1) == b"", "it was hung up on"
    assert works(cell)
    cell.close()


def test_a_stranger_that_hangs_up_at_once_changes_nothing(world: World) -> None:
    cell = world.controller()
    for _ in range(3):
        stranger(world).close()
        assert works(cell)
    cell.close()


def test_strangers_that_say_nothing_are_hung_up_on_and_are_no_more_than_a_few(world: World) -> None:
    cell = world.controller()
    mute = [stranger(world) for _ in range(NEWCOMERS)]
    assert works(cell)
    with stranger(world) as one_more:
        while works(cell) and len(world.server._newcomers) == NEWCOMERS:
            pass
        assert one_more.recv(1) == b""
    for one in mute:
        one.recv(4096)  # why
        assert one.recv(1) == b""
        one.close()
    assert works(cell)
    cell.close()


def test_a_second_world_at_the_address_is_refused_and_changes_nothing(world: World) -> None:
    cell = world.controller()
    with pytest.raises(InputError, match="no world can be reached there"):
        World(world.address)
    assert works(cell)
    assert drawn_from(world.address) == Drawn(3, "g1")
    cell.close()


def test_the_address_is_this_users_from_its_first_moment_on(world: World, monkeypatch: pytest.MonkeyPatch) -> None:
    assert stat.S_IMODE(world.address.stat().st_mode) == 0o600
    monkeypatch.setattr(os, "geteuid", lambda: 4711)
    with stranger(world) as one:
        assert one.recv(1) == b"", "a process of another user"


def test_a_world_that_does_not_answer_is_a_fault_in_a_fifth_of_a_second(world: World) -> None:
    cell, held = world.controller("real"), threading.Event()
    cell.clock.sleep_until(0.1)
    plain = world.arm.state

    def state() -> ArmState:
        held.wait(JOIN_S)
        return plain()

    world.arm.state = state  # type: ignore[method-assign]
    cell.clock.sleep_until(0.2)
    with pytest.raises(DeviceFault, match=r"world: does not answer for 0\.2 s"):
        cell.devices.arm.state()
    assert cell.devices.gone()
    assert cell.devices.report() == {}
    held.set()
    cell.close()


def test_a_controller_that_does_not_read_its_answers_is_let_go(world: World, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(server, "SEND_S", 0.05)
    cell = world.controller()
    for _ in range(20_000):
        try:
            cell._channel.send(Advance(0.1), 0.0)
        except (TimeoutError, EOFError):
            break
    other = None
    while other is None:
        with suppress(InputError):  # as long as the first one is there
            other = world.controller()
    assert works(other)
    other.close()
    cell.close()
