"""The process that streams pieces of a path: where it is held up, the arm goes on, and so must the path."""

from __future__ import annotations

import socket
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest

from bracket_cell.remote.channel import Channel
from bracket_cell.remote.child import Child
from bracket_cell.skills.drivers import stream, streaming
from bracket_cell.skills.drivers.streaming import StreamingArm
from bracket_ground.interfaces.command import JointTrajectory
from bracket_ground.interfaces.pose import Array

PERIOD_S, SPEED_RAD_S, WAY_RAD = 0.008, 2.0, 3.0
ACCELERATION_RAD_S2 = np.array([8.0])


class Machine:
    """Time that passes where somebody sleeps, or holds up what runs.

    Attributes:
        held_up: how long, by the moment at which it happens, both in [s].
    """

    def __init__(self, held_up: dict[float, float]) -> None:
        self.now_s, self.held_up = 100.0, {100.0 + at_s: for_s for at_s, for_s in held_up.items()}

    def monotonic(self) -> float:
        return self.now_s

    def sleep(self, seconds: float) -> None:
        self.now_s += seconds + sum(self.held_up.pop(at_s) for at_s in list(self.held_up) if at_s <= self.now_s)


class Arm:
    """Follows the newest piece by itself, to its end; implements `PieceLink`.

    Attributes:
        jumps_rad: from where it was to where a piece began.
    """

    piece_s, each_s = 0.25, 0.1

    def __init__(self, machine: Machine) -> None:
        self._machine, self._begun_s = machine, machine.now_s
        self._points = np.zeros((1, 1))
        self.jumps_rad: list[float] = []

    @property
    def at_rad(self) -> float:
        times = self._begun_s + PERIOD_S * np.arange(len(self._points))
        return float(np.interp(self._machine.now_s, times, self._points[:, 0]))

    def send_piece(self, points_rad: Array) -> None:
        self.jumps_rad.append(abs(float(points_rad[0, 0]) - self.at_rad))
        self._points, self._begun_s = points_rad, self._machine.now_s

    def send(self, joints_rad: Array) -> None:
        self.send_piece(joints_rad[np.newaxis])

    def idle(self) -> None:
        pass

    def load(self, mass_kg: float, centre_m: tuple[float, float, float]) -> None:
        pass

    def close(self) -> None:
        pass


def followed(
    monkeypatch: pytest.MonkeyPatch, held_up: dict[float, float], share_s: float = 9.0, first: float = 1.0
) -> Arm:
    """An arm that followed a path over 3 rad, and is told to go on until a moment."""
    machine = Machine(held_up)
    arm, began_s = Arm(machine), machine.now_s
    monkeypatch.setattr(stream, "time", machine)
    times_s = np.linspace(0.0, WAY_RAD / SPEED_RAD_S, 50)
    path = JointTrajectory(times_s, (times_s * SPEED_RAD_S)[:, np.newaxis])
    told: list[Any] = [stream.Start(np.zeros(1), ACCELERATION_RAD_S2), stream.Share(first), stream.Begin(path)]

    def taken() -> Any:
        if not told:
            now_s = machine.now_s - began_s
            share = first if now_s < 0.43 else 1.0  # between two pieces
            told.extend([stream.Share(share * (now_s < share_s)) if now_s < 4.0 else stream.Leave(), None])
        return told.pop(0)

    channel: Any = SimpleNamespace(taken=taken, send=lambda *_: None)
    stream._Stream(arm, channel, PERIOD_S, 1.0).run()
    return arm


@pytest.mark.parametrize("held_up_s", [0.0, 0.02, 0.05, 0.15, 0.6])
def test_a_process_that_is_held_up_goes_on_where_the_arm_is(monkeypatch: pytest.MonkeyPatch, held_up_s: float) -> None:
    arm = followed(monkeypatch, {0.5: held_up_s, 0.9: held_up_s})
    assert max(arm.jumps_rad) < 1.1 * PERIOD_S * SPEED_RAD_S
    assert arm.at_rad == pytest.approx(WAY_RAD)


def test_a_path_is_no_faster_than_the_arm_before_the_next_piece(monkeypatch: pytest.MonkeyPatch) -> None:
    arm = followed(monkeypatch, {}, first=0.5)
    assert max(arm.jumps_rad[1:]) < 1e-3
    assert arm.at_rad == pytest.approx(WAY_RAD)


def test_an_arm_that_shall_stand_is_not_moved_on(monkeypatch: pytest.MonkeyPatch) -> None:
    arm = followed(monkeypatch, {1.5: 0.5}, share_s=0.6)
    assert max(arm.jumps_rad) < 1.1 * PERIOD_S * SPEED_RAD_S
    assert 1.0 < arm.at_rad < 2.0


@pytest.mark.parametrize(
    ("goes_on_s", "moving", "expected"),
    [(0.25, True, (0.55, 0.60)), (0.0, True, (0.5, 0.5)), (0.25, False, (0.5, 0.5)), (0.07, True, (0.55, 0.57))],
)
def test_an_arm_with_a_piece_goes_on_where_no_set_point_is_told(
    goes_on_s: float, moving: bool, expected: tuple[float, float]
) -> None:
    """Otherwise its place would stand and then jump, as if it went farther than anybody had ordered."""
    times_s = np.linspace(10.0, 10.5, 63)
    arm: Any = SimpleNamespace(goes_on_s=goes_on_s)
    at_s = times_s[-1] + np.array([0.05, 0.10])
    places_s = (times_s - times_s[-1] + 0.5).tolist()
    assert StreamingArm._places_s(arm, at_s, times_s, places_s, moving) == pytest.approx(expected)


def test_an_arm_that_is_held_does_not_go_on() -> None:
    arm: Any = SimpleNamespace(goes_on_s=0.25)
    times_s = np.linspace(10.0, 10.03, 4)
    places = StreamingArm._places_s(arm, times_s[-1] + np.array([0.05, 0.10]), times_s, [0.3, 0.31, 0.31, 0.31], True)
    assert places == (0.31, 0.31)


@pytest.mark.parametrize(("busy_s", "streams"), [(30.0, True), (200.0, False)])
def test_an_arm_is_streamed_to_while_its_detectors_get_ready(
    monkeypatch: pytest.MonkeyPatch, busy_s: float, streams: bool
) -> None:
    """Of an e-series, whose period is 2 ms, 3 s filled the connection that nobody reads meanwhile."""
    machine = Machine({})
    arm, until_s = Arm(machine), machine.now_s + busy_s
    monkeypatch.setattr(stream, "time", machine)
    monkeypatch.setattr(streaming, "time", machine)
    ours, theirs = socket.socketpair()
    with ours, theirs:
        child = cast(Child, SimpleNamespace(name="process that streams set points"))
        heard = streaming.Stream(child, Channel(ours, stream.FromStream))
        heard.heard_s = heard.listened_s = machine.now_s
        heard.say(stream.Start(np.zeros(1), ACCELERATION_RAD_S2))
        listened: list[str] = []

        def sleep(seconds: float) -> None:
            machine.now_s += seconds
            if machine.now_s > until_s:
                heard.hear(1.0)
                listened.append(heard.lost)
            if len(listened) > 500:
                heard.say(stream.Leave())

        monkeypatch.setattr(machine, "sleep", sleep)
        stream._Stream(arm, Channel(theirs, stream.ToStream), 0.002, 1.0).run()
    assert set(listened) == ({""} if streams else set())


def test_a_process_that_hangs_is_noticed_by_a_loop_that_is_slow() -> None:
    ours, theirs = socket.socketpair()
    with ours, theirs:
        heard = streaming.Stream(cast(Child, SimpleNamespace(name="stream")), Channel(ours, stream.FromStream))
        Channel[Any](theirs, stream.ToStream).send(stream.Sent(heard.heard_s, None, False, 0), 1.0)
        heard.hear(1.0)
        assert not heard.lost
        for _ in range(3):
            heard.listened_s -= 0.2
            heard.heard_s -= 0.2
            heard.hear(1.0)
    assert "sent no set point" in heard.lost
