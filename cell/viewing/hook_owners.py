"""Whose hooks are whose: those of a `cell monitor` that is gone are taken away.

A client is known by the number in the header of its requests. Groot2 draws a new one for each; `cell monitor` keeps
one, and is known as such by asking why nodes wait.
"""

from __future__ import annotations

import time
from collections.abc import Collection, Iterable, Mapping
from typing import Any

Key = tuple[Any, Any]


class Owners:
    """Which view set which hook, and when each was last heard of."""

    def __init__(self) -> None:
        self._heard_s: dict[int, float] = {}
        self._owner: dict[Key, int] = {}
        self._known: set[Key] = set()

    def heard(self, session: int, view: bool) -> None:
        """A request came; a view is one that asks what only views ask."""
        if view or session in self._heard_s:
            self._heard_s[session] = time.monotonic()

    def inserted(self, session: int, hooks: Iterable[Mapping[str, Any]]) -> None:
        """All hooks that there are after a client set some: those that are new are its own."""
        keys = {key_of(hook) for hook in hooks}
        self._owner = {key: owner for key, owner in self._owner.items() if key in keys}
        if session in self._heard_s:
            self._owner |= dict.fromkeys(keys - self._known, session)
        self._known = keys

    def gone(self, silent_s: float) -> Collection[Key]:
        """Hooks of views that were not heard of for so long; they are forgotten with this."""
        now_s = time.monotonic()
        silent = {session for session, heard_s in self._heard_s.items() if now_s - heard_s > silent_s}
        if not silent:
            return ()
        found = {key for key, owner in self._owner.items() if owner in silent}
        for session in silent:
            del self._heard_s[session]
        self._owner = {key: owner for key, owner in self._owner.items() if key not in found}
        self._known -= found
        return found


def key_of(hook: Mapping[str, Any]) -> Key:
    """What tells a hook from the others."""
    return hook["uid"], hook["position"]
