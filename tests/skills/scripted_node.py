"""A gripper node for tests: ideal fingers on a virtual bus, and every fault that a bus can have."""

from __future__ import annotations

from collections.abc import Mapping

import can
import cantools.database
from cantools.database.can import Database

from bracket_cell.skills.drivers.gripper_database import SHIPPED

PERIOD_S = 0.020
HEARTBEAT_EVERY = 5


class ScriptedNode:
    """Moves at once at the commanded speed, stops at a part, sends what the database promises.

    Attributes:
        part_m: width of the part between the fingers, None for none.
        mute_heartbeat, mute_status, deaf: leave out frames, or ignore commands.
        fault: register gFLT.
        copies: how often every frame is sent.
        commands: all command frames as received.
    """

    def __init__(self, channel: str) -> None:
        database = cantools.database.load_file(SHIPPED)
        assert isinstance(database, Database)
        self._database = database
        self.bus = can.Bus(interface="virtual", channel=channel)
        self.part_m: float | None = None
        self.mute_heartbeat = self.mute_status = self.deaf = False
        self.fault = 0
        self.copies = 1
        self.commands: list[bytes] = []
        self._opening_m = 0.085
        self._request: Mapping[str, float] = {"rACT": 0, "rGTO": 0, "rPR": 85.0, "rSP": 20.0}
        self._active_in = 10
        self._cycle = 0

    def step(self) -> None:
        """One cycle of 20 ms."""
        while (message := self.bus.recv(timeout=0)) is not None:
            self.commands.append(bytes(message.data))
            if not self.deaf:
                values = self._database.decode_message("GripperCommand", bytes(message.data), decode_choices=False)
                assert isinstance(values, dict)
                self._request = {name: float(str(value)) for name, value in values.items()}
        if self._request["rACT"]:
            self._active_in = max(0, self._active_in - 1)
        status = self._move()
        if not self.mute_status:
            self.send("GripperStatus", self._status(status))
        if self._cycle % HEARTBEAT_EVERY == 0 and not self.mute_heartbeat:
            self.send("GripperHeartbeat", {"NodeState": 5})
        self._cycle += 1

    def restart(self) -> None:
        """Lose power for a moment: nothing that was commanded, or waits to be read, is remembered."""
        while self.bus.recv(timeout=0) is not None:
            pass
        self._request = {"rACT": 0, "rGTO": 0, "rPR": 85.0, "rSP": 20.0}
        self._active_in = 10
        self.send("GripperHeartbeat", {"NodeState": 0})

    def send(self, name: str, values: Mapping[str, float]) -> None:
        """Send a frame of the database."""
        message = self._database.get_message_by_name(name)
        self.send_raw(message.frame_id, message.encode(dict(values)))

    def send_raw(self, identifier: int, data: bytes) -> None:
        """Send any frame."""
        for _ in range(self.copies):
            self.bus.send(can.Message(arbitration_id=identifier, data=data, is_extended_id=False))

    def _move(self) -> int:
        if self._active_in or not self._request["rGTO"]:
            return 0
        goal = self._request["rPR"] / 1000
        stop = goal if self.part_m is None or self._opening_m < self.part_m else max(goal, self.part_m)
        step = self._request["rSP"] / 1000 * PERIOD_S
        self._opening_m += min(max(stop - self._opening_m, -step), step)
        if abs(self._opening_m - stop) > 1e-6:
            return 0
        return 3 if abs(stop - goal) < 1e-6 else 2

    def _status(self, object_status: int) -> dict[str, float]:
        request = self._request
        state = 3 if not self._active_in else (1 if request["rACT"] else 0)
        return {
            "gACT": request["rACT"],
            "gGTO": request["rGTO"],
            "gSTA": state,
            "gOBJ": object_status,
            "gFLT": self.fault,
            "gPR": request["rPR"],
            "gPO": self._opening_m * 1000,
            "gCU": 0.1,
        }


class NodeClock:
    """A clock that steps a node as its time advances."""

    def __init__(self, node: ScriptedNode) -> None:
        self._node, self._cycles = node, 0

    def now_s(self) -> float:
        return self._cycles * PERIOD_S

    def sleep_until(self, time_s: float) -> None:
        while self.now_s() < time_s - 1e-9:
            self._node.step()
            self._cycles += 1
