"""A lock that goes to who has waited longest."""

from __future__ import annotations

import threading
from collections import deque
from types import TracebackType


class TurnLock:
    """Reentrant, like `threading.RLock`, and first come, first served.

    A thread that releases an `RLock` and takes it again at once gets it before who waits: on a busy machine the
    world of a twin would keep its wires waiting for seconds.
    """

    def __init__(self) -> None:
        self._inner = threading.Lock()
        self._waiting: deque[threading.Lock] = deque()
        self._owner: int | None = None
        self._depth = 0
        self._free = True

    def __enter__(self) -> None:
        me = threading.get_ident()
        if self._owner != me:
            self._wait_for_turn()
            self._owner = me
        self._depth += 1

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, _: TracebackType | None) -> None:
        self._depth -= 1
        if self._depth:
            return
        self._owner = None
        with self._inner:
            self._hand_on()

    def _hand_on(self) -> None:
        self._free = not self._waiting
        if self._waiting:
            self._waiting.popleft().release()

    def _wait_for_turn(self) -> None:
        with self._inner:
            if self._free:
                self._free = False
                return
            turn = threading.Lock()
            turn.acquire()
            self._waiting.append(turn)
        try:
            turn.acquire()
        except BaseException:  # who is interrupted waits no longer; a turn that came meanwhile goes to the next
            with self._inner:
                if turn in self._waiting:
                    self._waiting.remove(turn)
                else:
                    self._hand_on()
            raise
