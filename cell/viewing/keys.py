"""Single keys that a person presses on the terminal, without waiting for them."""

from __future__ import annotations

import os
import select
import sys
import termios
import tty
from collections.abc import Iterator
from contextlib import contextmanager


class Keys:
    """What was pressed since it was last asked.

    Args:
        descriptor: of the terminal; None where there is none.
    """

    def __init__(self, descriptor: int | None) -> None:
        self._descriptor = descriptor

    def pressed(self, within_s: float) -> str:
        """The keys of the next moments; empty where there is no terminal, after the same time."""
        waits = [] if self._descriptor is None else [self._descriptor]
        ready, _, _ = select.select(waits, [], [], within_s)
        return os.read(self._descriptor, 64).decode(errors="ignore") if ready and self._descriptor is not None else ""


@contextmanager
def keys() -> Iterator[Keys]:
    """Take single keys from standard input for a while."""
    if not sys.stdin.isatty():
        yield Keys(None)
        return
    descriptor = sys.stdin.fileno()
    before = termios.tcgetattr(descriptor)
    tty.setcbreak(descriptor)
    try:
        yield Keys(descriptor)
    finally:
        termios.tcsetattr(descriptor, termios.TCSADRAIN, before)
