"""The controller's other ports: the dashboard's text lines, and programs, state and calibration at the primary ones.

Sources: Universal Robots, "Dashboard server" and "Remote control via TCP/IP".
"""

from __future__ import annotations

import select
import socket
import struct
import time
from collections.abc import Callable

from bracket_sim.twin.controller import Controller, RobotMode, Runtime, Safety
from bracket_sim.twin.sockets import Port

DASHBOARD_PORT = 29999
STATE_S = 0.1  # between two states at a primary port
LONGEST_PROGRAM = 1 << 20
GREETING = "Connected: Universal Robots Dashboard Server\n"
ROBOT_STATE, VERSION_MESSAGE = 16, 20
MODE_DATA, KINEMATICS_INFO = 0, 5
PROGRAM_STATES = {Runtime.STOPPED: "STOPPED", Runtime.PLAYING: "PLAYING", Runtime.PAUSED: "PAUSED"}
SAFETY_WORDS = {
    Safety.NORMAL: "NORMAL",
    Safety.REDUCED: "REDUCED",
    Safety.PROTECTIVE: "PROTECTIVE_STOP",
    Safety.SAFEGUARD: "SAFEGUARD_STOP",
    Safety.EMERGENCY: "ROBOT_EMERGENCY_STOP",
}
UNLOCK_REFUSED = "Cannot unlock protective stop until 5s after occurrence. Always inspect cause of protective stop"


class Dashboard(Port):
    """One line asked, one line answered; what changes something is refused in local mode."""

    def __init__(self, controller: Controller, host: str) -> None:
        self._of = controller
        super().__init__(host, DASHBOARD_PORT)

    def serve(self, client: socket.socket) -> None:
        """Answer until the client is gone or quits."""
        client.sendall(GREETING.encode())
        with client.makefile("r", encoding="utf-8") as lines:
            for line in lines:
                asked = line.strip()
                with self._of.cell.lock:
                    answer = self._answer(asked)
                client.sendall(f"{answer}\n".encode())
                if asked == "quit":
                    return

    def _answer(self, asked: str) -> str:
        of = self._of
        told: dict[str, Callable[[], str]] = {
            "robotmode": lambda: f"Robotmode: {of.robot_mode.name}",
            "safetystatus": lambda: f"Safetystatus: {SAFETY_WORDS[of.safety_mode]}",
            "safetymode": lambda: f"Safetymode: {SAFETY_WORDS[of.safety_mode]}",
            "programState": lambda: f"{PROGRAM_STATES[of.runtime]} twin.urp",
            "running": lambda: f"Program running: {str(of.runtime is Runtime.PLAYING).lower()}",
            "is in remote control": lambda: str(of.remote).lower(),
            "get robot model": lambda: of.model.name,
            "get serial number": lambda: "20263000001",
            "PolyscopeVersion": lambda: "URSoftware {}.{}.{}.{} (twin)".format(*of.model.version),
            "get loaded program": lambda: "Loaded program: /programs/twin.urp",
            "quit": lambda: "Disconnected",
        }
        if asked in told:
            return told[asked]()
        if not of.remote:
            return "Command is not allowed due to safety reasons: the controller is in local control"
        return self._done(asked)

    def _done(self, asked: str) -> str:
        of = self._of
        if asked == "unlock protective stop":
            return "Protective stop releasing" if of.unlock() else UNLOCK_REFUSED
        acts: dict[str, tuple[Callable[[], None], str]] = {
            "power on": (of.power_on, "Powering on"),
            "brake release": (of.release_brakes, "Brake releasing"),
            "stop": (of.stop_program, "Stopped"),
            "pause": (of.pause, "Pausing program"),
            "play": (of.play, "Starting program"),
            "close safety popup": (lambda: None, "closing safety popup"),
            "close popup": (lambda: None, "closing popup"),
            "restart safety": (lambda: None, "Restarting safety"),
        }
        if asked not in acts:
            return f"could not understand: '{asked}'"
        act, words = acts[asked]
        act()
        return words


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
