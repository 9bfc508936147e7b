"""The controller of the made-up arm: a wire of the twin."""

from __future__ import annotations

import json
import queue
import socket
from typing import Any

import numpy as np

from bracket_sim.twin.cell import TwinCell
from bracket_sim.twin.sockets import Port

WAITS_S = 0.1  # without a line of who moves it the arm stops by itself
BRAKING_RAD_S2 = 10.0


class TcpController(Port):
    """Tells samples to any number of clients, and obeys one."""

    def __init__(self, cell: TwinCell, role: str) -> None:
        settings = cell.settings[role]
        host = str(settings.get("host", "127.0.0.1"))
        self.cell, self.arm, self.banner = cell, cell.arm, f"{role}: {host}:{settings['port']}"
        self._listeners: set[queue.Queue[bytes]] = set()
        self._mover: socket.socket | None = None
        self._heard_s, self._stopped = 0.0, ""
        cell.each_period(self._cycle)
        cell.offer("protective_stop", "the arm stops by itself", lambda: self._stop("something pushed it"))
        cell.offer("mended", "everything is as it should be", lambda: self._stop(""))
        super().__init__(host, int(settings["port"]))

    def serve(self, client: socket.socket) -> None:
        """One client, by its purpose."""
        with client.makefile("rb") as lines:
            purpose = json.loads(lines.readline())["purpose"]
            if purpose == "tell":
                self._tell(client)
            elif purpose == "move":
                self._move(client, lines)
            else:
                with self.cell.lock:
                    self._stop("")
                client.sendall(b'{"refused": ""}\n')

    def _tell(self, client: socket.socket) -> None:
        samples: queue.Queue[bytes] = queue.Queue()
        self._listeners.add(samples)
        try:
            while True:
                client.sendall(samples.get())
        finally:
            self._listeners.discard(samples)

    def _move(self, client: socket.socket, lines: Any) -> None:
        with self.cell.lock:
            self._mover = client
            self.cell.person_comes()
        for line in lines:
            order = json.loads(line)
            with self.cell.lock:
                self._heard_s = self.cell.now_s()
                if "to" in order and not self._stopped:
                    self.arm.servo(np.array(order["to"]))
        with self.cell.lock:
            if self._mover is client:
                self._mover = None

    def _cycle(self, time_s: float) -> None:
        if self.arm.held_back:
            self._stop(self.arm.held_back)
            self.arm.freeze()
        if time_s - self._heard_s > WAITS_S:
            self.arm.stop(BRAKING_RAD_S2)
        seen = self.arm.measured
        told = {
            "time": seen.time_s,
            "at": seen.positions_rad.tolist(),
            "speed": seen.velocities_rad_s.tolist(),
            "moment": seen.moments_nm.tolist(),
            "mode": "protective_stop" if self._stopped else "normal",
            "why": self._stopped,
            "moves": self._mover is not None,
        }
        line = json.dumps(told).encode() + b"\n"
        for samples in tuple(self._listeners):
            samples.put(line)

    def _stop(self, why: str) -> None:
        self._stopped = why
        self.arm.stop(BRAKING_RAD_S2)
