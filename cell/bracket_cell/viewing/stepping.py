"""Pausing a monitored tree before its actions begin, and letting them begin one at a time, by breakpoints."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterable, Mapping, Set
from difflib import get_close_matches
from typing import Any
from xml.etree import ElementTree

from bracket_ground.errors import InputError

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
        self._names: dict[int, set[str]] = {
            int(element.get("_uid", "0")): {element.get("name", ""), element.get("ID", ""), element.tag}
            - {"SubTree", ""}
            for tree in xml.iter("BehaviorTree")
            for element in tree.iter()
            if element.get("_uid")
        }
        self._order = order
        self._named: set[int] = set()  # breakpoints that stay
        self._stopped: set[int] = set()
        self._waiting: list[int] = []  # the one that has waited longest comes first
        self.paused = False
        self.message = ""

    def press(self, key: str, said: Mapping[int, str]) -> None:
        """What a key means: p pauses or goes on, s lets the next action begin."""
        try:
            if key == "p" and self.paused:
                self._go_on()
            elif key == "p":
                self.paused, self.message = True, "paused: running actions finish, no new one begins"
            elif key == "s":
                self._step(said)
        except InputError as error:
            self.paused, self.message = False, str(error)

    def stop_at(self, name: str) -> None:
        """Let nodes of this name, or of this kind, wait before they begin; a second time takes that away."""
        word = name.strip().lower()
        found = {uid for uid, names in self._names.items() if word in {name.lower() for name in names}}
        if not found:
            known = sorted({name for names in self._names.values() for name in names})
            near = get_close_matches(name.strip(), known, 3, 0.6)
            self.message = f"there is no node {name.strip()!r}" + (f"; near to it: {', '.join(near)}" if near else "")
            return
        away = found <= self._named
        try:
            self.stop_before(self._named - found if away else self._named | found)
        except InputError as error:
            self.message = str(error)
        else:
            self.message = (
                f"goes past {name.strip()} again" if away else f"waits before {name.strip()}; s lets it begin"
            )

    def stop_before(self, wanted: Set[int]) -> None:
        """Let these nodes wait before they begin, each time, and no others.

        Raises:
            InputError: breakpoints are off.
        """
        for uid in self._named - wanted - self._stopped:
            self._send("R", {"uid": uid, "position": PRE})
        if new := wanted - self._named:
            self._insert(new)
        self._named = set(wanted)

    def let(self, uid: int) -> None:
        """Let a node begin that waits.

        Raises:
            InputError: it does not wait.
        """
        stays = uid in self._named
        order = {"uid": uid, "position": PRE, "desired_status": AS_IT_IS, "remove_when_done": not stays}
        self._send("U", order)
        self._stopped.discard(uid)

    def leave(self) -> None:
        """Take the breakpoints away, so that nothing waits for a person who has left."""
        held = self._stopped | self._named
        self._named.clear()
        if held:
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
        try:
            self._insert(idle)
            self._stopped.update(idle)
        except InputError as error:
            self.paused, self.message = False, str(error)

    def _insert(self, uids: Iterable[int]) -> None:
        hook = {"mode": 0, "once": False, "position": PRE, "desired_status": AS_IT_IS}
        self._send("I", [{"uid": uid, **hook} for uid in uids])

    def _step(self, said: Mapping[int, str]) -> None:
        self._queue(said)
        if not self._waiting:
            self.message = "no action waits" if self.paused or self._named else "press p first, or b and a name"
            return
        first = self._waiting.pop(0)
        self.let(first)
        following = f"; next: {self._called(self._waiting[0])}" if self._waiting else ""
        self.message = f"{self._called(first)} may begin{following}"

    def _queue(self, said: Mapping[int, str]) -> None:
        """Line up what waits, so that no branch of a Parallel keeps the others from their turn."""
        waits = [uid for uid in sorted(self._stopped | self._named) if said.get(uid) == WAITS]
        self._waiting = [uid for uid in self._waiting if uid in waits]
        self._waiting += [uid for uid in waits if uid not in self._waiting]

    def _go_on(self) -> None:
        self._send("A", {})
        self._stopped.clear()
        if self._named:
            self._insert(self._named)
        self.paused, self.message = False, "goes on"

    def _called(self, uid: int) -> str:
        return self._leaves.get(uid) or min(self._names[uid], key=len)

    def _send(self, kind: str, body: Any) -> None:
        self._order(kind, json.dumps(body).encode())
