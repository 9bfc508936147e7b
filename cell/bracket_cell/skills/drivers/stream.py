"""The process that streams set points to a controller, and stands on the path when nobody speaks to it."""

from __future__ import annotations

import copy
import os
import pickle
import socket
import sys
import time
from pathlib import Path
from typing import Any, Protocol, runtime_checkable

import numpy as np

from bracket_cell.remote.channel import Channel, Message
from bracket_ground.errors import words_of
from bracket_ground.interfaces.command import JointTrajectory
from bracket_ground.interfaces.devices import KEEP_ALIVE_S
from bracket_ground.interfaces.paced_path import PacedPath
from bracket_ground.interfaces.pose import Array

BLEND_S = 0.3  # in which a path is reached that begins beside the set points
HURRY_PERIODS = 2.0  # a cycle that is later than this is left out; made up for where an arm goes on by itself
STANDING_CYCLES = 5  # set points that do not change are told so often
UNREAD_S = 120.0  # who reads nothing for so long is taken for gone; a start, with all detectors, takes up to 60 s
LEAVE_S = 0.02  # from the last set point to the end, which takes what is left of the motion
LISTENS_S = 0.5
RESTS = (0, 0.0)  # a piece that ends where it begins
SLOWER, EQUAL = 0.02, 1e-9  # share of speed by which a piece may be too fast until the next is due


class Link(Protocol):
    """The wire to a controller that takes a set point in each of its periods; whatever it raises, the link is lost."""

    def send(self, joints_rad: Array) -> None:
        """The set point (n,) of this period."""
        ...

    def idle(self) -> None:
        """Called in each period before the first set point: keep the link alive."""
        ...

    def load(self, mass_kg: float, centre_m: tuple[float, float, float]) -> None:
        """This hangs on the flange from now on."""
        ...

    def close(self) -> None:
        """The arm stands: end the controller's program, and hang up."""
        ...


@runtime_checkable
class PieceLink(Link, Protocol):
    """The wire to a controller that takes pieces of a path, each in place of the one before, by the same `Link`.

    Each piece ends at rest on the path, so that an arm that gets no further one stands there by itself.

    Attributes:
        piece_s: how far a piece goes on before it slows down.
        each_s: after which the next is sent.
    """

    piece_s: float
    each_s: float

    def send_piece(self, points_rad: Array) -> None:
        """Set points (m, n) of this period and those to come; in place of `send`."""
        ...


class Start(Message, frozen=True):
    """Stream from where the arm is, (n,); so soon (n,) may its joints be fast, and so they brake."""

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


def serve(link: bytes, folder: str, period_s: float, slower: float, connection: socket.socket) -> None:
    """The process: connect, stream until told to leave or nobody is there, and let the arm rest on its path.

    Args:
        link: what makes a `Link`, pickled by the driver that began this process.
        folder: where its module is looked for first; empty for that of a package.
    """
    sys.path[:0] = [folder] * bool(folder)
    channel: Channel[Any] = Channel(connection, ToStream)
    with Path(os.devnull).open("w") as nobody:  # what a maker's client tells the terminal, `Lost` says
        os.dup2(nobody.fileno(), 1)
        os.dup2(nobody.fileno(), 2)
    try:
        wire: Link = pickle.loads(link)()
    except Exception as error:  # a maker's client may raise anything, here and below: the outermost loop
        channel.send(Lost(words_of(error)), LISTENS_S)
        return
    stream = _Stream(wire, channel, period_s, slower)
    try:
        stream.run()
        wire.close()
    except Exception as error:  # the controller's own watchdog stops the arm
        stream.say(Lost(f"the controller takes no set points: {words_of(error)}"))


def _left(blended: float) -> float:
    """Share of the way from the path that is still there."""
    return float(0.5 * (1 + np.cos(np.pi * blended)))


class _Stream:
    """One set point a cycle; a path goes on only while somebody says so."""

    def __init__(self, link: Link, channel: Channel[Any], period_s: float, slower: float) -> None:
        self._link, self._channel, self._period_s, self._slower = link, channel, period_s, slower
        self._path: PacedPath | None = None
        self._target: Array = np.zeros(0)
        self._beside: Array = np.zeros(0)  # from the path to the set point, as the path began
        self._blended, self._paths = 1.0, 0
        self._share, self._heard_s, self._read_s = 0.0, -1.0, time.monotonic()
        self._leaving, self._untold = False, 0
        self._piece_s = 0.0
        self._piece = RESTS  # the newest: of which path, at which share

    def run(self) -> None:
        """Until it is to leave and the arm stands; raises what the link raised."""
        if not self.say(Ready()):
            return
        due_s, rest_s = time.monotonic(), 0.0
        while rest_s < LEAVE_S:
            self._hear()
            if self._path is not None:
                self._advance(self._path)
                self._hand_on(self._path)
            elif self._leaving:
                return
            else:
                self._link.idle()
            standing = self._path is None or not self._path.moving
            rest_s = rest_s + self._period_s if self._leaving and standing else 0.0
            due_s = self._slept(due_s)

    @property
    def _allowed(self) -> float:
        """Share of the speed; none while nobody says so."""
        silent = time.monotonic() - self._heard_s > KEEP_ALIVE_S * self._slower
        return 0.0 if silent else self._share

    def _hand_on(self, path: PacedPath) -> None:
        """The set point, or the piece that begins with it where it is due."""
        link = self._link
        if not isinstance(link, PieceLink):
            link.send(self._target)
            return
        now_s, share = time.monotonic(), 0.0 if path.stopping else self._allowed
        known = self._piece[0] == self._paths and share > self._piece[1] - (SLOWER if share > 0.0 else 0.0) - EQUAL
        rests = not path.moving or path.rate == share == 0.0
        if (known and now_s < self._piece_s + link.each_s * self._slower) or (rests and self._piece == RESTS):
            link.idle()
            return
        self._piece, self._piece_s = RESTS if rests else (self._paths, share), now_s
        link.send_piece(self._ahead(path, share, round(link.piece_s / self._period_s)))

    def _ahead(self, path: PacedPath, share: float, periods: int) -> Array:
        """Set points (m, n): so many periods at a share of the speed, then to rest."""
        ahead, blended, points = copy.copy(path), self._blended, [self._target]
        while ahead.moving and (periods > 0 or ahead.rate > 0.0):
            there = ahead.advance(share if periods > 0 else 0.0, self._period_s)
            blended, periods = min(1.0, blended + self._period_s / BLEND_S), periods - 1
            points.append(there + self._beside * _left(blended))
        return np.array(points)

    def _step(self, path: PacedPath, share: float) -> Array:
        """The set point (n,) after another period."""
        there = path.advance(share, self._period_s)
        self._blended = min(1.0, self._blended + self._period_s / BLEND_S)
        return there + self._beside * _left(self._blended)

    def _advance(self, path: PacedPath) -> None:
        share = self._allowed
        if self._piece[0] == self._paths:  # the arm has a piece, and is no faster before it has the next
            share = min(share, self._piece[1])
        target, self._untold = self._step(path, share), self._untold + 1
        if self._untold >= STANDING_CYCLES or not np.array_equal(target, self._target):
            self._untold = 0
            self.say(Sent(time.monotonic(), path.path_s, path.moving, self._paths))
        self._target = target

    def _slept(self, due_s: float) -> float:
        """Wait for the next cycle; returns when it is due."""
        period_s = self._period_s * self._slower
        due_s, now_s = due_s + period_s, time.monotonic()
        time.sleep(max(0.0, due_s - now_s))
        if isinstance(self._link, PieceLink) and self._path is not None:
            return due_s + period_s * self._made_up(self._path, due_s, self._link.piece_s)
        return now_s if now_s > due_s + HURRY_PERIODS * period_s else due_s

    def _made_up(self, path: PacedPath, due_s: float, piece_s: float) -> int:
        """Whole periods that were left out: the arm went on along its piece, and so does the path; returns how many."""
        periods = max(0, int((time.monotonic() - due_s) / (self._period_s * self._slower)))
        for period in range(periods):
            gone_s = (due_s - self._piece_s) / self._slower + period * self._period_s
            share = self._piece[1] if gone_s < piece_s + self._period_s / 2 else 0.0
            self._target = self._step(path, share)
        return periods

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
                self._beside = np.zeros_like(at_rad)
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
                self._link.load(mass_kg, centre_m)
            case Leave():
                self._leave()

    def _leave(self) -> None:
        self._leaving = True
        if self._path is not None:
            self._path.stop()

    def say(self, message: Message) -> bool:
        """Whether somebody listens; who is busy misses it, who is so for long is gone."""
        now_s = time.monotonic()
        try:
            if not self._leaving:
                self._channel.send(message, 0.0)  # so short that it goes whole or not at all
                self._read_s = now_s
        except TimeoutError:
            if now_s - self._read_s > UNREAD_S:
                self._leave()
        except EOFError:
            self._leave()
        return not self._leaving
