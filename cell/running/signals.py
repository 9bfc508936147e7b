"""Signals of the operating system set a flag, whatever the program does; only a hanging tick is broken off, once."""

from __future__ import annotations

import signal
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from types import FrameType
from typing import TypeVar

Answer = TypeVar("Answer")
STOPPING = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)


class Interrupted(Exception):
    """A second signal ended a tick that did not end by itself."""


class StopSignals:
    """Remembers that SIGINT, SIGTERM or SIGHUP came.

    Attributes:
        name: of the last signal; empty before the first.
    """

    def __init__(self) -> None:
        self.name = ""
        self._interruptible = False

    @contextmanager
    def heard(self) -> Iterator[None]:
        """From here to the end of the block no signal raises, but within `interruptible`."""
        before = {number: signal.signal(number, self._note) for number in STOPPING}
        try:
            yield
        finally:
            for number, handler in before.items():
                signal.signal(number, handler)

    def interruptible(self, work: Callable[[], Answer]) -> Answer:
        """Do work that a second signal may break off.

        Raises:
            Interrupted: it did. The handler raises at most once, and only between the two outer lines of this `try`.
        """
        try:
            try:
                self._interruptible = True
                return work()
            finally:
                self._interruptible = False
        except KeyboardInterrupt:
            raise Interrupted("interrupted in mid-tick") from None

    def _note(self, number: int, _: FrameType | None) -> None:
        again, self.name = bool(self.name), signal.Signals(number).name
        if again and self._interruptible:
            self._interruptible = False
            raise KeyboardInterrupt
