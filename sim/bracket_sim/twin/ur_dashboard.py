"""The controller's dashboard: a line asked, a line answered, as far as its software's version has the command.

Source: Universal Robots, "Dashboard server", and the versions in the maker's client library (dashboard client).
"""

from __future__ import annotations

import socket
from collections.abc import Callable, Mapping
from typing import NamedTuple

from bracket_sim.twin.controller import Controller, Runtime, Safety
from bracket_sim.twin.sockets import Port

DASHBOARD_PORT = 29999
GREETING = "Connected: Universal Robots Dashboard Server\n"
PROGRAM = "/programs/twin.urp"
UNLOCK_REFUSED = "Cannot unlock protective stop until 5s after occurrence. Always inspect cause of protective stop"
LOCAL = "Command is not allowed due to safety reasons: the controller is in local control"
SAFETY_WORDS = {
    Safety.NORMAL: "NORMAL",
    Safety.REDUCED: "REDUCED",
    Safety.PROTECTIVE: "PROTECTIVE_STOP",
    Safety.SAFEGUARD: "SAFEGUARD_STOP",
    Safety.EMERGENCY: "ROBOT_EMERGENCY_STOP",
}
Version = tuple[int, int]
NEVER: Version = (99, 0)


class Command(NamedTuple):
    """One command.

    Attributes:
        answer: carries it out; takes what stands behind the command's words.
        cb3, e_series: the software's version that has it first.
        acts: it is refused in local control.
    """

    answer: Callable[[Controller, str], str]
    cb3: Version = (3, 0)
    e_series: Version = (5, 0)
    acts: bool = False


def _act(act: Callable[[Controller], object], done: str, refused: str = "", cb3: Version = (3, 0)) -> Command:
    """Does something; what returns False is refused."""
    return Command(lambda of, _: refused if act(of) is False else done, cb3, acts=True)


def _told(tell: Callable[[Controller], str], cb3: Version = (3, 0), e_series: Version = (5, 0)) -> Command:
    return Command(lambda of, _: tell(of), cb3, e_series)


def _version(of: Controller) -> str:
    return ".".join(map(str, of.model.version))


COMMANDS: Mapping[str, Command] = {
    "robotmode": _told(lambda of: f"Robotmode: {of.robot_mode.name}"),
    "safetymode": _told(lambda of: f"Safetymode: {SAFETY_WORDS[of.safety_mode]}"),
    "safetystatus": _told(lambda of: f"Safetystatus: {SAFETY_WORDS[of.safety_mode]}", NEVER, (5, 4)),
    "programState": _told(lambda of: f"{of.runtime.name} twin.urp"),
    "running": _told(lambda of: f"Program running: {str(of.runtime is Runtime.PLAYING).lower()}"),
    "is in remote control": _told(lambda of: str(of.remote).lower(), NEVER, (5, 6)),
    "get operational mode": _told(lambda _: "NONE", NEVER, (5, 6)),
    "get robot model": _told(lambda of: of.model.name, (3, 12), (5, 6)),
    "get serial number": _told(lambda _: "20263000001", (3, 12), (5, 6)),
    "PolyscopeVersion": _told(lambda of: f"URSoftware {_version(of)} (twin)"),
    "version": _told(_version, NEVER),
    "get loaded program": _told(lambda _: f"Loaded program: {PROGRAM}"),
    "isProgramSaved": _told(lambda _: "true twin.urp"),
    "quit": _told(lambda _: "Disconnected"),
    "addToLog": _told(lambda _: "Added log message"),
    "popup": _told(lambda _: "showing popup"),
    "close popup": _told(lambda _: "closing popup"),
    "close safety popup": _told(lambda _: "closing safety popup", (3, 1)),
    "load installation": Command(lambda _, file: f"File not found: {file}", (3, 2), acts=True),
    "load": Command(lambda _, file: f"File not found: {file}", acts=True),
    "unlock protective stop": _act(Controller.unlock, "Protective stop releasing", UNLOCK_REFUSED, (3, 1)),
    "power on": _act(Controller.power_on, "Powering on"),
    "power off": _act(Controller.power_off, "Powering off"),
    "brake release": _act(Controller.release_brakes, "Brake releasing"),
    "stop": _act(Controller.stop_program, "Stopped"),
    "pause": _act(Controller.pause, "Pausing program"),
    "play": _act(Controller.play, "Starting program", "Failed to execute: play"),
    "restart safety": _act(lambda _: None, "Restarting safety", cb3=(3, 7)),
    "shutdown": _act(Controller.power_off, "Shutting down"),
}


class Dashboard(Port):
    """Serves it."""

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
                    answer = answered(self._of, asked)
                client.sendall(f"{answer}\n".encode())
                if asked == "quit":
                    return


def answered(of: Controller, asked: str) -> str:
    """What a controller answers to a line, once it has done what that asks for."""
    words = max((words for words in COMMANDS if f"{asked} ".startswith(f"{words} ")), key=len, default="")
    command = COMMANDS.get(words)
    if command is None or of.model.version[:2] < (command.cb3 if of.old else command.e_series):
        return f"could not understand: '{asked}'"
    if command.acts and not of.remote:
        return LOCAL
    return command.answer(of, asked[len(words) :].strip())
