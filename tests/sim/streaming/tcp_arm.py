"""A driver for an arm whose controller speaks lines of JSON over TCP: one connection tells, one takes set points."""

from __future__ import annotations

import json
import socket
from collections.abc import Callable
from contextlib import suppress
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray
from pydantic import BaseModel

from bracket_cell import Clock, DeviceFault, RobotModel, Sample, StreamingArm

ANSWER_S = 2.0
PERIOD_S = 0.008


class TcpSettings(BaseModel):
    """What stands next to `kind`."""

    host: str = "127.0.0.1"
    port: int
    lag_s: float = 0.045


class Line:
    """A connection for one purpose: tell, move or reset."""

    def __init__(self, settings: TcpSettings, purpose: str, limit_s: float) -> None:
        self.socket = socket.create_connection((settings.host, settings.port), limit_s)
        self.socket.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        self._lines = self.socket.makefile("rb")
        self.say({"purpose": purpose})

    def say(self, what: dict[str, Any]) -> None:
        """Send a line; raises OSError."""
        self.socket.sendall(json.dumps(what).encode() + b"\n")

    def hear(self) -> dict[str, Any]:
        """The next line; raises OSError."""
        line = self._lines.readline()
        if not line.endswith(b"\n"):
            raise ConnectionResetError("it hung up")
        heard: dict[str, Any] = json.loads(line)
        return heard

    def close(self) -> None:
        """Hang up."""
        with suppress(OSError):
            self.socket.shutdown(socket.SHUT_RDWR)
        self._lines.close()
        self.socket.close()


class Samples(Line):
    """Tells where the joints are."""

    period_s = PERIOD_S

    def receive(self) -> Sample:
        """The next sample."""
        told = self.hear()
        at, speed, moment = (np.array(told[name]) for name in ("at", "speed", "moment"))
        return Sample(told["time"], at, speed, moment, told["mode"], told["why"], told["moves"])


class Points(Line):
    """Takes set points, in the process that streams."""

    def send(self, joints_rad: NDArray[np.float64]) -> None:
        """The set point of this period."""
        self.say({"to": joints_rad.tolist()})

    def idle(self) -> None:
        """Nothing to follow yet."""
        self.say({})

    def load(self, mass_kg: float, centre_m: tuple[float, float, float]) -> None:
        """This controller does not ask."""


class TcpArm(StreamingArm):
    """Implements `Arm`."""

    Settings = TcpSettings
    twin = "tcp_server:TcpController"  # what `cell twin` serves in the arm's place

    def __init__(self, settings: TcpSettings, clock: Clock, robot: RobotModel) -> None:
        self._settings = settings
        super().__init__(clock, robot, f"{settings.host}:{settings.port}", settings.lag_s)

    def connect(self) -> Samples:
        """Where samples come from."""
        return Samples(self._settings, "tell", ANSWER_S * self.slower)

    def link(self) -> Callable[[], Points]:
        """Where set points go."""
        return partial(Points, self._settings, "move", ANSWER_S * self.slower)

    def bring_back(self) -> None:
        """Unlock a protective stop."""
        try:
            line = Line(self._settings, "reset", ANSWER_S * self.slower)
            refused = line.hear()["refused"]
            line.close()
        except OSError as error:
            raise DeviceFault("arm", f"no answer: {error}") from None
        if refused:
            raise DeviceFault("arm", refused)
