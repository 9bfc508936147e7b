"""Faults of a kind in one signal of a device: stuck, late, early, repeated, scaled, offset, flipped or lost."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable
from enum import Enum
from typing import Any, Literal, get_args

Kind = Literal["stuck", "late", "early", "repeated", "scaled", "offset", "flipped", "lost"]
KINDS: tuple[Kind, ...] = get_args(Kind)
LATE_S = 0.2  # how late or early
SCALE = 1.3
OFFSETS = {  # by signal, in its own unit
    "positions_rad": 0.1, "velocities_rad_s": 0.5, "path_s": 0.3, "time_s": 0.3, "opening_m": 0.02, "current_a": 1.0,
    "gPO": 20.0, "gPR": 20.0, "gCU": 1.0,
}  # fmt: skip
OTHERS = {"normal": "protective_stop", "operational": "stopped", "stopped": "operational"}  # of signals that are words


class SignalFault:
    """One kind of fault in one signal.

    Args:
        signal: a field of a state, or a register of a CAN frame.
    """

    def __init__(self, signal: str, kind: Kind) -> None:
        self.signal, self.kind = signal, kind
        self._kept: deque[tuple[float, Any]] = deque(maxlen=64)
        self._told: Any = None
        self._again = False

    def told(self, value: Any, time_s: float, *, active: bool = True) -> Any:
        """What the signal says in place of its value; to be asked before the fault, too, as some need what was."""
        self._kept.append((time_s, value))
        if not active or (self.kind == "repeated" and self._again):
            self._told = value
        elif self.kind not in ("stuck", "repeated"):
            self._told = self._changed(value, time_s)
        self._again = not self._again
        return self._told

    def _changed(self, value: Any, time_s: float) -> Any:
        late = next((old for when_s, old in reversed(self._kept) if when_s <= time_s - LATE_S), self._kept[0][1])
        changes: dict[str, Callable[[Any, Any], Any]] = {
            "early": lambda now, old: now + (now - old),
            "scaled": lambda now, _: now * SCALE,
            "offset": lambda now, _: now + OFFSETS.get(self.signal, 1.0),
            "flipped": lambda now, _: -now,
            "lost": lambda _, __: math.nan,
        }
        if self.kind == "late":
            return late
        if self.kind == "flipped" and not isinstance(value, float | tuple):
            return _other(value)
        if self.kind == "lost" and not isinstance(value, float):
            return () if isinstance(value, tuple) else None
        if isinstance(value, tuple):
            return tuple(changes[self.kind](now, old) for now, old in zip(value, late, strict=True))
        return changes[self.kind](value, late) if isinstance(value, float) and isinstance(late, float) else value


def _other(value: Any) -> Any:
    """Another value of something that is no measure."""
    if isinstance(value, bool):
        return not value
    if isinstance(value, Enum):
        return type(value)(value.value ^ 1)
    return OTHERS.get(value, value)
