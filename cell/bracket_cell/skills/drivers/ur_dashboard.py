"""Asks a Universal Robots controller by its dashboard, and brings an arm back that stopped.

Source: Universal Robots, "Dashboard server": one line asked, one line answered.
"""

from __future__ import annotations

import socket
import time
from types import TracebackType
from typing import Self

from bracket_ground.errors import DeviceFault, words_of

PORT = 29999
ANSWER_S, LEAST_S = 2.0, 0.001
LONGEST = 4096  # bytes of a line
REFUSALS = ("could not understand", "not allowed", "failed to execute")


class Dashboard:
    """A connection to the dashboard, for one `with` block.

    Raises:
        DeviceFault: it does not answer.
    """

    def __init__(self, host: str, slower: float = 1.0) -> None:
        self._host, self._limit_s, self._came = host, ANSWER_S * slower, b""
        try:
            self._socket = socket.create_connection((host, PORT), self._limit_s)
        except OSError as error:
            raise DeviceFault("arm", f"no dashboard at {host}:{PORT}: {words_of(error)}") from None
        try:
            self._line()
        except DeviceFault:
            self._close()
            raise

    def __enter__(self) -> Self:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, _: TracebackType | None) -> None:
        self._close()

    def _close(self) -> None:
        self._socket.close()

    def ask(self, line: str) -> str:
        """The answer to a line; raises DeviceFault where none comes."""
        try:
            self._socket.sendall(f"{line}\n".encode())
        except OSError as error:
            raise DeviceFault("arm", f"the dashboard at {self._host} hung up: {words_of(error)}") from None
        return self._line()

    def order(self, line: str) -> None:
        """Have something done; raises DeviceFault where the controller does not know it or does not allow it."""
        answer = self.ask(line)
        if any(words in answer.lower() for words in REFUSALS):
            raise DeviceFault("arm", f"the dashboard answers to {line!r}: {answer}")

    def _line(self) -> str:
        """The next line, within the limits of time and length."""
        until_s = time.monotonic() + self._limit_s
        while b"\n" not in self._came:
            if self._came and (len(self._came) > LONGEST or time.monotonic() > until_s):
                raise DeviceFault("arm", f"the dashboard at {self._host} does not end a line; is it another server?")
            try:
                self._socket.settimeout(max(LEAST_S, until_s - time.monotonic()))
                part = self._socket.recv(LONGEST)
            except OSError as error:
                raise DeviceFault("arm", f"the dashboard at {self._host} does not answer: {words_of(error)}") from None
            if not part:
                raise DeviceFault("arm", f"the dashboard at {self._host} hung up")
            self._came += part
        line, _, self._came = self._came.partition(b"\n")
        return line.decode(errors="replace").strip()

    @property
    def local(self) -> bool:
        """Whether the pendant has control; an older controller, which has no such mode, never says so."""
        return self.ask("is in remote control").lower() == "false"


def stop_program(host: str, slower: float) -> None:
    """End a program that is left paused: it must not go on by itself; whatever hinders that is told elsewhere."""
    try:
        with Dashboard(host, slower) as dashboard:
            dashboard.ask("stop")
    except DeviceFault:
        return


def bring_back(host: str, slower: float, limit_s: float = 30.0) -> None:
    """Unlock, power on and release the brakes, as far as the controller lets it; waits for seconds.

    Raises:
        DeviceFault: a person must do something first; the words say what.
    """
    until_s = time.monotonic() + limit_s * slower
    with Dashboard(host, slower) as dashboard:
        if dashboard.local:
            raise DeviceFault("arm", "the pendant has control: switch it to remote control, then acknowledge")
        while time.monotonic() < until_s:
            safety = dashboard.ask("safetymode").partition(": ")[2]
            mode = dashboard.ask("robotmode").partition(": ")[2]
            if "EMERGENCY" in safety:
                raise DeviceFault("arm", "an emergency stop is still pressed: release it, then acknowledge")
            if "SAFEGUARD" in safety:
                raise DeviceFault("arm", "the safeguard is open: close it, then acknowledge")
            if safety in ("VIOLATION", "FAULT"):
                raise DeviceFault("arm", f"the controller says {safety}: clear it at the pendant")
            if safety == "PROTECTIVE_STOP":
                dashboard.order("unlock protective stop")
            elif safety in ("NORMAL", "REDUCED") and mode == "RUNNING":
                return
            elif mode == "POWER_OFF":
                dashboard.ask("close safety popup")
                dashboard.order("power on")
            elif mode == "IDLE":
                dashboard.order("brake release")
            time.sleep(0.2 * slower)
    raise DeviceFault("arm", f"it is not back after {limit_s:g} s: {safety.lower()}, {mode.lower()}")
