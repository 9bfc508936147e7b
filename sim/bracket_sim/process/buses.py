"""CAN buses that exist only within a process, carried over to another one."""

from __future__ import annotations

from collections.abc import Iterable
from contextlib import ExitStack

import can

from bracket_ground.interfaces.can_bus import open_bus
from bracket_sim.process.messages import CanFrames

VIRTUAL = "virtual"


class CarriedBuses:
    """One end of each virtual bus of a cell; a real bus reaches every process by itself.

    Args:
        channels: their names, each once.
    """

    def __init__(self, channels: Iterable[str]) -> None:
        self._buses: dict[str, can.BusABC] = {}
        self._stack = ExitStack()
        for channel in channels:
            bus = self._buses[channel] = open_bus(VIRTUAL, channel)
            self._stack.callback(bus.shutdown)

    def take(self) -> CanFrames:
        """What came since the last call, in order."""
        return {channel: frames for channel, bus in self._buses.items() if (frames := _waiting(bus))}

    def put(self, carried: CanFrames) -> None:
        """Send what was taken at the other end; what no bus of this end is for is left out."""
        for channel in carried.keys() & self._buses.keys():
            for frame in carried[channel]:
                self._buses[channel].send(frame)

    def close(self) -> None:
        """Let go of the buses."""
        self._stack.close()


def _waiting(bus: can.BusABC) -> tuple[can.Message, ...]:
    frames: list[can.Message] = []
    while (frame := bus.recv(timeout=0)) is not None:
        frames.append(frame)
    return tuple(frames)
