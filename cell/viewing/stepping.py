"""Pausing a monitored tree before its actions begin, and letting them begin one at a time, by breakpoints."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping
from typing import Any
from xml.etree import ElementTree

from cell.errors import InputError

RUNNING = 1
PRE = 0
AS_IT_IS = "SKIPPED"  # in the protocol: the node answers by itself
WAITS = "waits at a breakpoint"

Order = Callable[[str, bytes], object]


class Stepper:
    """Breakpoints before all actions of one tree; conditions, and so the guard, are asked on.

    Args:
        order: sends an order about hooks; raises InputError where they are off.

    Attributes:
        paused: no action begins unless it is let.
        told: what came of the last key.
    """

    def __init__(self, xml: ElementTree.Element, order: Order) -> None:
        actions = {model.get("ID") for model in xml.findall("TreeNodesModel/Action")}
        self._leaves = {
            int(element.get("_uid", "0")): element.get("name") or element.tag
            for tree in xml.iter("BehaviorTree")
            for element in tree.iter()
            if element.tag in actions and not len(element)
        }
        self._order = order
        self._stopped: set[int] = set()
        self._waiting: list[int] = []  # the one that has waited longest comes first
        self.paused = False
        self.told = ""

    def press(self, key: str, said: Mapping[int, str]) -> None:
        """What a key means: p pauses or goes on, s lets the next action begin."""
        try:
            if key == "p" and self.paused:
                self._go_on()
            elif key == "p":
                self.paused, self.told = True, "paused: running actions finish, no new one begins"
            elif key == "s":
                self._step(said)
        except InputError as error:
            self.paused, self.told = False, str(error)

    def leave(self) -> None:
        """Take the breakpoints away, so that nothing waits for a person who has left."""
        if self._stopped:
            try:
                self._go_on()
            except InputError:
                self._stopped.clear()  # the run has ended

    def keep(self, statuses: Mapping[int, int], said: Mapping[int, str]) -> None:
        """While paused, stop what has ended before it begins again."""
        self._queue(said)
        idle = [uid for uid in self._leaves if uid not in self._stopped]
        idle = [uid for uid in idle if statuses.get(uid, 0) != RUNNING and said.get(uid) != WAITS]
        if not self.paused or not idle:
            return
        hooks = [{"uid": uid, "mode": 0, "once": False, "position": PRE, "desired_status": AS_IT_IS} for uid in idle]
        try:
            self._send("I", hooks)
            self._stopped.update(idle)
        except InputError as error:
            self.paused, self.told = False, str(error)

    def _step(self, said: Mapping[int, str]) -> None:
        self._queue(said)
        if not self._waiting:
            self.told = "no action waits" if self.paused else "press p first"
            return
        first = self._waiting.pop(0)
        order = {"uid": first, "position": PRE, "desired_status": AS_IT_IS, "remove_when_done": True}
        self._send("U", order)
        self._stopped.discard(first)
        following = f"; next: {self._leaves[self._waiting[0]]}" if self._waiting else ""
        self.told = f"{self._leaves[first]} may begin{following}"

    def _queue(self, said: Mapping[int, str]) -> None:
        """Line up what waits, so that no branch of a Parallel keeps the others from their turn."""
        waits = [uid for uid in sorted(self._stopped) if said.get(uid) == WAITS]
        self._waiting = [uid for uid in self._waiting if uid in waits]
        self._waiting += [uid for uid in waits if uid not in self._waiting]

    def _go_on(self) -> None:
        self._send("A", {})
        self._stopped.clear()
        self.paused, self.told = False, "goes on"

    def _send(self, kind: str, body: Any) -> None:
        self._order(kind, json.dumps(body).encode())
