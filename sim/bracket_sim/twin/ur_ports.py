"""The controller's primary ports: programs, state and calibration.

Source: Universal Robots, "Remote control via TCP/IP".
"""

from __future__ import annotations

import select
import socket
import struct
import time

from bracket_sim.twin.controller import Controller, RobotMode, Runtime, Safety
from bracket_sim.twin.sockets import Port

STATE_S = 0.1  # between two states at a primary port
LONGEST_PROGRAM = 1 << 20
ROBOT_STATE, VERSION_MESSAGE = 16, 20
MODE_DATA, KINEMATICS_INFO = 0, 5


class PrimaryPort(Port):
    """Takes programs, and tells state and calibration ten times a second; 30011 only tells."""

    def __init__(self, controller: Controller, host: str, port: int) -> None:
        self._of, self._tells, self._takes = controller, port != 30003, port != 30011
        super().__init__(host, port)

    def serve(self, client: socket.socket) -> None:
        """Until the client is gone."""
        if self._tells:
            client.sendall(_version(self._of) + self._state(True))
        text, due_s = "", time.monotonic() + STATE_S
        while True:
            if select.select([client], [], [], max(0.0, due_s - time.monotonic()))[0]:
                part = client.recv(65536)
                if not part:
                    return
                text = self._uploaded(text + part.decode("utf-8", "replace"))
            if time.monotonic() >= due_s:
                due_s = time.monotonic() + STATE_S
                if self._tells:
                    client.sendall(self._state(False))

    def _uploaded(self, text: str) -> str:
        """Take a program that is whole: it ends with the line `end`; returns what is left."""
        if not self._takes or len(text) > LONGEST_PROGRAM:
            return ""
        whole, end, rest = text.partition("\nend\n")
        if not end:
            return text
        with self._of.cell.lock:
            self._of.upload(whole)
        return rest

    def _state(self, first: bool) -> bytes:
        with self._of.cell.lock:
            parts = _sub(MODE_DATA, _mode_data(self._of))
            if first:
                parts += _sub(KINEMATICS_INFO, _kinematics(self._of))
        return _message(ROBOT_STATE, parts)


def _version(of: Controller) -> bytes:
    """The message that a client gets first."""
    name, (major, minor, bugfix, build) = b"URControl", of.model.version
    body = struct.pack(">QbB", int(of.now_s * 1e6), -2, 3) + bytes([len(name)]) + name
    return _message(VERSION_MESSAGE, body + struct.pack(">BBii", major, minor, bugfix, build) + b"twin\0")


def _mode_data(of: Controller) -> bytes:
    powered = of.robot_mode in (RobotMode.IDLE, RobotMode.RUNNING)
    flags = (
        *(True, True, powered, of.safety is Safety.EMERGENCY, of.safety is Safety.PROTECTIVE),
        *(of.runtime is Runtime.PLAYING, of.runtime is Runtime.PAUSED),
    )
    body = struct.pack(">Q7?BBddd", int(of.now_s * 1e6), *flags, of.robot_mode, 0, of.slider, 1.0, 1.0)
    return body if of.old else body + b"\0"


def _kinematics(of: Controller) -> bytes:
    """Calibration: checksums, then theta, a, d and alpha of all six rows, and that it is valid."""
    rows = [value for values in of.model.rows.model_dump().values() for value in values]
    return struct.pack(">6I24dI", *of.model.checksums, *rows, 1)


def _sub(kind: int, body: bytes) -> bytes:
    return struct.pack(">iB", len(body) + 5, kind) + body


_message = _sub  # whole messages have the same header
