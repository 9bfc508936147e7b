"""A simulated I/O module on the bus: some of its inputs follow outputs, as a machine that answers."""

from __future__ import annotations

import can

from bracket_ground.interfaces.can_bus import open_bus
from bracket_sim.scene.settings import SimSignals

INPUTS, OUTPUTS, NETWORK = 0x180, 0x200, 0x000
PERIOD_S = 0.1


class SignalNode:
    """Tells its inputs when they change, and every 0.1 s, once the master has started it.

    Attributes:
        outputs: bits that the master set.
    """

    def __init__(self, settings: SimSignals) -> None:
        self._settings = settings
        self._bus = open_bus("virtual", settings.channel)
        self._changes: list[tuple[float, int]] = []  # (when, outputs) that inputs still have to follow
        self._started = False
        self._inputs = -1
        self._told_s = 0.0
        self.outputs = 0

    def update(self, time_s: float, dt_s: float) -> None:  # noqa: ARG002 - the period does not matter
        """Read outputs, let inputs follow, tell them."""
        while (message := self._bus.recv(timeout=0)) is not None:
            self._take(message, time_s)
        while self._changes and self._changes[0][0] <= time_s:
            followed = self._changes.pop(0)[1]
            self._follow(followed, time_s)
        if self._started and (self._inputs < 0 or time_s - self._told_s >= PERIOD_S):
            self._follow(self.outputs if self._inputs < 0 else None, time_s)

    def close(self) -> None:
        """Let go of the bus."""
        self._bus.shutdown()

    def _take(self, message: can.Message, time_s: float) -> None:
        if message.arbitration_id == NETWORK and bytes(message.data)[1:2] in (b"\0", bytes([self._settings.node_id])):
            self._started = True
        elif message.arbitration_id == OUTPUTS + self._settings.node_id:
            self.outputs = int.from_bytes(message.data, "little")
            self._changes.append((time_s + self._settings.delay_s, self.outputs))

    def _follow(self, outputs: int | None, time_s: float) -> None:
        """Take over what inputs follow, and tell all of them."""
        if outputs is not None:
            self._inputs = sum(1 << own for own, other in self._settings.wires.items() if outputs >> other & 1)
        data = max(0, self._inputs).to_bytes(8, "little")
        self._bus.send(can.Message(arbitration_id=INPUTS + self._settings.node_id, data=data, is_extended_id=False))
        self._told_s = time_s
