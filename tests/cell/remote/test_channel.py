"""What is said arrives as it was said; what is no message, is too long or never comes ends the connection alone."""

from __future__ import annotations

import pickle
import socket
import struct
from collections.abc import Iterator
from typing import Any

import can
import numpy as np
import pytest

from bracket_cell.remote.channel import Channel, Failure
from bracket_cell.remote.detecting import Look
from bracket_ground.errors import CellError, DeviceFault, InputError, ModelError, SettingError
from bracket_ground.interfaces.command import JointTrajectory
from bracket_ground.interfaces.frame import Frame
from bracket_ground.interfaces.observation import ArmState
from bracket_ground.interfaces.pose import Pose
from bracket_sim.process import messages as said

ANY = said.FromController | said.ToController | Look
LIMIT_S = 30.0
TICK = said.Snapshot(
    1.5,
    ArmState(1.5, (0.1,) * 6, (0.0,) * 6, moving=True),
    None,
    {"gripper": Failure.of(DeviceFault("gripper", "no heartbeat"))},
    None,
    (Frame("wrist", 7, 1.25, np.arange(24, dtype=np.uint8).reshape(2, 4, 3), Pose((0.0, 0.0, 1.0))),),
)


@pytest.fixture
def ends() -> Iterator[tuple[Channel[Any], socket.socket]]:
    ours, theirs = socket.socketpair()
    channel: Channel[Any] = Channel(ours, ANY, 1 << 20)
    yield channel, theirs
    channel.close()
    theirs.close()


def told(message: Any) -> Any:
    """A message at the other end."""
    ours, theirs = socket.socketpair()
    with ours, theirs:
        Channel[Any](ours, ANY).send(message, LIMIT_S)
        return Channel[Any](theirs, ANY).receive(LIMIT_S)


def test_a_snapshot_arrives_as_it_was_sent() -> None:
    came = told(TICK)
    assert came == TICK  # images are not compared
    assert (came.frames[0].image == TICK.frames[0].image).all()
    assert came.frames[0].image.dtype == np.uint8
    assert type(came.arm.positions_rad) is tuple


def test_a_trajectory_arrives_to_the_bit() -> None:
    trajectory = JointTrajectory(np.linspace(0.0, 1.0, 5), np.random.default_rng(3).normal(size=(5, 6)))
    came = told(said.Follow(trajectory)).trajectory
    assert (came.times_s == trajectory.times_s).all()
    assert (came.positions_rad == trajectory.positions_rad).all()


def test_a_can_frame_arrives_as_it_was_sent() -> None:
    frame = can.Message(arbitration_id=0x181, data=b"\x01\x02\x03", is_extended_id=False)
    (came,) = told(said.Can({"bus": [frame]})).frames["bus"]
    assert came.equals(frame, timestamp_delta=None, check_direction=False)


@pytest.mark.parametrize(
    "error",
    [
        DeviceFault("arm", "it does not answer"),
        InputError("no such file"),
        ModelError("damaged"),
        SettingError((("devices", "gripper"), "no such bus")),
    ],
)
def test_an_error_of_ours_stays_what_a_user_must_do_about_it(error: CellError) -> None:
    came = told(Failure.of(error)).error()
    assert str(came) == str(error)
    assert isinstance(came, InputError if not isinstance(error, DeviceFault) else DeviceFault)


def test_another_error_is_a_fault_of_who_raised_it() -> None:
    assert str(told(Failure.of(ZeroDivisionError("by 0"))).error("renderer")) == "renderer: ZeroDivisionError: by 0"


HOSTILE = {
    "garbage": b"\x05\x00\x00\x00hello",
    "more than is taken": struct.pack("<I", 1 << 31),
    "a pickle": struct.pack("<I", len(pickle.dumps(print))) + pickle.dumps(print),
    "another type": b"\x04\x00\x00\x00\x81\xa1a\x01",
    "a list that claims four thousand million entries": b"\x05\x00\x00\x00\xdd\xff\xff\xff\xff",
    "a map of that size": b"\x05\x00\x00\x00\xdf\xff\xff\xff\xff",
    "lists in lists": struct.pack("<I", 100_000) + b"\x91" * 100_000,
    "nothing": b"\x00\x00\x00\x00",
}


@pytest.mark.parametrize("data", HOSTILE.values(), ids=HOSTILE.keys())
def test_what_is_no_message_ends_the_connection(ends: tuple[Channel[Any], socket.socket], data: bytes) -> None:
    channel, theirs = ends
    theirs.sendall(data)
    with pytest.raises(EOFError):
        channel.receive(LIMIT_S)


def test_an_array_of_objects_is_no_message(ends: tuple[Channel[Any], socket.socket]) -> None:
    channel, theirs = ends
    sender: Channel[Any] = Channel(theirs, ANY)
    sender.send(Look("overhead", 1, 0.0, Pose((0.0, 0.0, 0.0)), image=np.array([b"8bytes.."], dtype="S8")), LIMIT_S)
    with pytest.raises(EOFError, match="an array of"):
        channel.receive(LIMIT_S)


def test_a_message_that_is_not_whole_is_waited_for_within_its_limit(ends: tuple[Channel[Any], socket.socket]) -> None:
    channel, theirs = ends
    theirs.sendall(b"\x05\x00\x00\x00he")
    assert channel.taken() is None
    with pytest.raises(TimeoutError):
        channel.receive(0.0)
    theirs.close()
    with pytest.raises(EOFError, match="it hung up"):
        channel.receive(LIMIT_S)


def test_who_does_not_read_is_not_waited_for(ends: tuple[Channel[Any], socket.socket]) -> None:
    channel, _ = ends
    image = np.zeros((1000, 1000, 3), np.uint8)
    with pytest.raises(TimeoutError):
        channel.send(Look("overhead", 1, 0.0, Pose((0.0, 0.0, 0.0)), image=image), 0.01)
