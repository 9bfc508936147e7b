"""The process that streams set points to a controller by `ur-rtde`, and stands on the path when nobody speaks to it."""

from __future__ import annotations

import os
import socket
import time
from pathlib import Path
from typing import Any

import numpy as np

from bracket_cell.remote.channel import Channel, Message
from bracket_ground.interfaces.command import JointTrajectory
from bracket_ground.interfaces.devices import KEEP_ALIVE_S
from bracket_ground.interfaces.paced_path import PacedPath
from bracket_ground.interfaces.pose import Array

WATCHDOG_HZ = 10.0  # the controller's program ends where nothing comes for longer than this
BLEND_S = 0.3  # in which a path is reached that begins beside the set points
BRAKING_RAD_S2 = 10.0
HURRY_PERIODS = 2.0  # a cycle that begins later than this is left out, not made up for
STANDING_CYCLES = 5  # set points that do not change are told so often: who reads nothing for long is taken for gone
LEAVE_S = 0.02  # from the last set point to the stop that takes what is left of the motion
LISTENS_S = 0.5
USED = ("already in use", "in use")


class Start(Message, frozen=True):
    """Stream from where the arm is, (6,); so soon (6,) may its joints be fast, and so they brake."""

    at_rad: Array
    acceleration_rad_s2: Array


class Begin(Message, frozen=True):
    """Follow a trajectory from a place on it, as its time."""

    trajectory: JointTrajectory
    from_s: float = 0.0


class Share(Message, frozen=True):
    """Go on at this share of the speed."""

    share: float


class Stop(Message, frozen=True):
    """Give the path up, at rest on it."""


class Payload(Message, frozen=True):
    """What hangs on the flange, with its centre from there."""

    mass_kg: float
    centre_m: tuple[float, float, float]


class Leave(Message, frozen=True):
    """Stand, and end."""


class Ready(Message, frozen=True):
    """The controller's program runs."""


class Lost(Message, frozen=True):
    """The controller takes no more set points; the process ends."""

    reason: str


class Sent(Message, frozen=True):
    """A set point went out.

    Attributes:
        time_s: of the machine.
        path_s: how far along the trajectory it is; None without one.
        moving: the trajectory's end is not reached.
        path: number of the trajectory, from 1.
    """

    time_s: float
    path_s: float | None
    moving: bool
    path: int


ToStream = Start | Begin | Share | Stop | Payload | Leave
FromStream = Ready | Lost | Sent


def serve(
    host: str,
    rate_hz: float,
    slower: float,
    lookahead_s: float,
    gain: float,
    upper: bool,
    tcp: tuple[float, ...],
    payload: Payload,
    connection: socket.socket,
) -> None:
    """The process: connect, stream until told to leave or nobody is there, and let the arm rest on its path.

    Args:
        upper: use registers 24 to 47, as somebody else owns the lower ones.
    """
    channel: Channel[Any] = Channel(connection, ToStream)
    with Path(os.devnull).open("w") as nobody:  # what the client tells the terminal, `Lost` says
        os.dup2(nobody.fileno(), 1)
        os.dup2(nobody.fileno(), 2)
    try:
        control = _connected(host, rate_hz, upper)
        control.setTcp(list(tcp))
        control.setPayload(payload.mass_kg, list(payload.centre_m))
        control.setWatchdog(WATCHDOG_HZ)
    except RuntimeError as error:
        channel.send(Lost(str(error)), LISTENS_S)
        return
    stream = _Stream(control, channel, 1 / rate_hz, slower, lookahead_s, gain)
    try:
        stream.run()
        control.servoStop(BRAKING_RAD_S2)
        control.stopScript()
        control.disconnect()
    except RuntimeError as error:  # the link is gone, and with it the program: the controller's watchdog stops the arm
        stream.say(Lost(f"the controller takes no set points: {error}"))


def _connected(host: str, rate_hz: float, upper: bool) -> Any:
    """The genuine client.

    Raises:
        RuntimeError: as it raised it.
    """
    from rtde_control import RTDEControlInterface as Control

    flags = Control.FLAG_UPLOAD_SCRIPT | (Control.FLAG_UPPER_RANGE_REGISTERS if upper else 0)
    return Control(host, rate_hz, flags)


class _Stream:
    """One set point a cycle; a path goes on only while somebody says so."""

    def __init__(
        self, control: Any, channel: Channel[Any], period_s: float, slower: float, lookahead_s: float, gain: float
    ) -> None:
        self._control, self._channel, self._period_s, self._slower = control, channel, period_s, slower
        self._servo = (0.0, 0.0, period_s, lookahead_s, gain)
        self._path: PacedPath | None = None
        self._target: Array = np.zeros(6)
        self._beside: Array = np.zeros(6)  # from the path to the set point, as the path began
        self._blended, self._paths = 1.0, 0
        self._share, self._heard_s = 0.0, -1.0
        self._leaving, self._untold = False, 0

    def run(self) -> None:
        """Until it is to leave and the arm stands.

        Raises:
            RuntimeError: the controller is lost.
        """
        if not self.say(Ready()):
            return
        due_s, rest_s = time.monotonic(), 0.0
        while rest_s < LEAVE_S:
            self._hear()
            if self._path is not None:
                self._advance(self._path)
                if not self._control.servoJ(self._target.tolist(), *self._servo):
                    raise RuntimeError("its program does not run any more")
            elif self._leaving:
                return
            else:
                self._control.kickWatchdog()
            if not self._control.isConnected():  # else the client goes on to say that it sends
                raise RuntimeError("it hung up")
            standing = self._path is None or not self._path.moving
            rest_s = rest_s + self._period_s if self._leaving and standing else 0.0
            due_s = self._slept(due_s)

    def _advance(self, path: PacedPath) -> None:
        silent = time.monotonic() - self._heard_s > KEEP_ALIVE_S * self._slower
        there = path.advance(0.0 if silent else self._share, self._period_s)
        self._blended = min(1.0, self._blended + self._period_s / BLEND_S)
        left = 0.5 * (1 + np.cos(np.pi * self._blended))
        target, self._untold = there + self._beside * left, self._untold + 1
        if self._untold >= STANDING_CYCLES or not np.array_equal(target, self._target):
            self._untold = 0
            self.say(Sent(time.monotonic(), path.path_s, path.moving, self._paths))
        self._target = target

    def _slept(self, due_s: float) -> float:
        """Wait for the next cycle; returns when it is due."""
        period_s = self._period_s * self._slower
        due_s, now_s = due_s + period_s, time.monotonic()
        if now_s > due_s + HURRY_PERIODS * period_s:
            return now_s
        time.sleep(max(0.0, due_s - now_s))
        return due_s

    def _hear(self) -> None:
        try:
            while not self._leaving and (message := self._channel.taken()) is not None:
                self._do(message)
        except EOFError:
            self._leave()

    def _do(self, message: ToStream) -> None:
        match message:
            case Start(at_rad, acceleration_rad_s2):
                self._path, self._target = PacedPath(at_rad, self._period_s, acceleration_rad_s2), at_rad
            case Begin(trajectory, from_s) if self._path is not None:
                self._path.follow(trajectory, self._share, from_s)
                self._beside, self._blended = self._target - self._path.at_rad, 0.0
                self._paths += 1
                self._heard_s = time.monotonic()
            case Share(share):
                self._share, self._heard_s = share, time.monotonic()
            case Stop() if self._path is not None:
                self._path.stop()
            case Payload(mass_kg, centre_m):
                self._control.setPayload(mass_kg, list(centre_m))
            case Leave():
                self._leave()

    def _leave(self) -> None:
        self._leaving = True
        if self._path is not None:
            self._path.stop()

    def say(self, message: Message) -> bool:
        """Whether somebody listens; who does not is gone."""
        try:
            if not self._leaving:
                self._channel.send(message, 0.0)
        except (EOFError, TimeoutError):
            self._leave()
        return not self._leaving
