"""Values of a run as plain data: numbers, texts, lists, arrays and records of a closed list; nothing of it is code."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Mapping
from enum import Enum
from types import MappingProxyType
from typing import Any

import numpy as np

from bracket_cell.wiring.records import hints_of, name_of

# Packages whose objects a run and its replay both have.
OWN = ("bracket_ground", "btxml", "bracket_cell", "bracket_sim", "bracket_lab")
LISTS: dict[str, Any] = {"tuple": tuple, "set": set, "frozenset": frozenset, "deque": deque, "list": list}
KEPT = {"kept": True}


class StateWriter:
    """Turns values into plain data; one object that stands in several places is written once.

    Args:
        named: what is named and not written.
        records: classes whose objects are written, by name; of other things it says that the run kept them.
    """

    def __init__(self, named: Mapping[str, Any], records: Mapping[str, type]) -> None:
        self._names = {id(value): name for name, value in reversed(list(named.items()))}
        self._named, self._records = named, records  # they live as long as their numbers are used
        self._known: dict[int, tuple[int, Any]] = {}

    def fields(self, values: Mapping[str, Any]) -> dict[str, Any]:
        return {name: self(value) for name, value in values.items()}

    def record(self, value: Any) -> dict[str, Any]:
        """The fields of a dataclass."""
        kind: type = type(value)
        return self.fields({name: getattr(value, name) for name in hints_of(kind)})

    def __call__(self, value: Any) -> Any:
        if value is None or isinstance(value, bool) or type(value) is int:
            return value
        if type(value) is float:
            return value if math.isfinite(value) else {"float": str(value)}
        if (name := self._names.get(id(value))) is not None:
            return {"named": name}
        if isinstance(value, str) and not isinstance(value, Enum):
            return str(value)
        if isinstance(value, Enum):
            return {"enum": [name_of(type(value)), value.name]}
        if id(value) in self._known:
            return {"ref": self._known[id(value)][0]}
        self._known[id(value)] = number, _ = len(self._known), value
        return {"n": number, **self._of(value)}

    def _of(self, value: Any) -> dict[str, Any]:
        kind = type(value)
        if kind.__name__ in LISTS and kind is LISTS[kind.__name__]:
            items = sorted(value, key=repr) if kind in (set, frozenset) else value
            return {kind.__name__: [self(item) for item in items]}
        if isinstance(value, dict | MappingProxyType):
            return {
                "frozen" if isinstance(value, MappingProxyType) else "dict": [
                    [self(key), self(item)] for key, item in value.items()
                ]
            }
        if isinstance(value, np.ndarray | np.generic) and value.dtype.kind in "biuf":
            return {"array": [value.dtype.str, list(np.shape(value)), np.asarray(value).tobytes().hex()]}
        if self._records.get(name_of(kind)) is not kind:
            return KEPT
        return {"record": name_of(kind), "of": self.record(value)}


def is_own(value: object) -> bool:
    """Whether it is a thing of this program, and neither a class nor of an enumeration."""
    return type(value).__module__.partition(".")[0] in OWN and not isinstance(value, type | Enum)
