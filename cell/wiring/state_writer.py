"""Values of a run as plain data: nothing of it is code."""

from __future__ import annotations

import dataclasses
import math
from collections import deque
from collections.abc import Iterator, Mapping
from enum import Enum
from functools import partial
from types import CodeType, FunctionType, MappingProxyType, MethodType
from typing import Any

import numpy as np

from cell.files.model import Model

OWN = ("cell", "trees", "skills", "learned", "sim")  # packages whose objects may be filled with what a log says
LISTS: dict[str, Any] = {"tuple": tuple, "set": set, "frozenset": frozenset, "deque": deque, "list": list}
KEPT = {"kept": True}


class StateWriter:
    """Turns values into plain data; one object that stands in several places is written once.

    Args:
        named: what is named and not written.
    """

    def __init__(self, named: Mapping[str, Any]) -> None:
        self._names = {id(value): name for name, value in reversed(list(named.items()))}
        self._named = named  # they live as long as their numbers are used
        self._known: dict[int, tuple[int, Any]] = {}

    def fields(self, values: Mapping[str, Any]) -> dict[str, Any]:
        return {name: self(value) for name, value in values.items()}

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
            return {"enum": [*_class(type(value)), value.name]}
        if id(value) in self._known:
            return {"ref": self._known[id(value)][0]}
        self._known[id(value)] = number, _ = len(self._known), value
        return {"n": number, **self._of(value)}

    def _of(self, value: Any) -> dict[str, Any]:
        kind = type(value)
        if kind.__name__ in LISTS and kind is LISTS[kind.__name__]:
            items = sorted(value, key=repr) if kind in (set, frozenset) else value
            return {kind.__name__: [self(one) for one in items]}
        if isinstance(value, dict | MappingProxyType):
            return {
                "frozen" if isinstance(value, MappingProxyType) else "dict": [
                    [self(key), self(one)] for key, one in value.items()
                ]
            }
        if isinstance(value, np.ndarray | np.generic) and value.dtype.kind in "biuf":
            return {"array": [value.dtype.str, list(np.shape(value)), np.asarray(value).tobytes().hex()]}
        if isinstance(value, FunctionType):
            cells = zip(value.__code__.co_freevars, value.__closure__ or (), strict=True)
            return {
                "function": [*_class(value), column_of(value.__code__)],
                "of": {name: self(cell.cell_contents) for name, cell in cells},
            }
        if isinstance(value, partial):
            return {"partial": [self(value.func), self(value.args), self(value.keywords)]}
        if isinstance(value, MethodType):
            return {"method": [self(value.__self__), value.__name__]}
        if (not is_own(value) and not dataclasses.is_dataclass(kind)) or isinstance(value, Model):
            return KEPT
        if not hasattr(value, "__dict__") and not dataclasses.is_dataclass(kind):
            return KEPT
        fields = dict(fields_of(value))
        return {"object": _class(kind), "of": self.fields(fields)}


def is_own(value: object) -> bool:
    """Whether it is a thing of this program, and neither a class nor of an enumeration."""
    return type(value).__module__.partition(".")[0] in OWN and not isinstance(value, type | Enum)


def fields_of(value: Any) -> Iterator[tuple[str, Any]]:
    """What an object holds, by attribute."""
    if hasattr(value, "__dict__"):
        yield from vars(value).items()
    for kind in type(value).__mro__:
        for name in getattr(kind, "__slots__", ()):
            if name not in ("__dict__", "__weakref__") and hasattr(value, name):
                yield name, getattr(value, name)


def column_of(code: CodeType) -> list[int | None]:
    """Where in its file a function ends, which tells those of one name apart."""
    return list([*code.co_positions()][-1])


def _class(kind: type | FunctionType) -> list[str]:
    return [kind.__module__, kind.__qualname__]
