"""The way back from plain data to values of a run: records are filled with fields of their own types."""

from __future__ import annotations

import re
from collections import defaultdict
from collections.abc import Mapping
from enum import Enum
from types import MappingProxyType
from typing import Any

import numpy as np

from bracket_cell.wiring.records import fits, hints_of
from bracket_cell.wiring.state_writer import LISTS
from bracket_ground.errors import InputError

MISSING: Any = object()
NUMBERS = re.compile(r"[<>|][biuf]\d")  # types of arrays


class StateError(InputError):
    """A state that cannot be written, or does not fit the tree that is to go on with it."""


class _Unreadable(Exception):
    """Why a value cannot be made; becomes a StateError with its place."""


class StateReader:
    """The way back.

    Where a value is read, `was` is what stands in its place; it gives what was not written.

    Args:
        named: things that are named and not written.
        records: classes whose objects may be made, by name.
    """

    def __init__(self, named: dict[str, Any], records: Mapping[str, type]) -> None:
        self.named, self._records = named, records
        self._known: dict[int, Any] = {}
        self._lenient = False

    def fields(
        self, written: Mapping[str, Any], was: Mapping[str, Any], hints: Mapping[str, Any], owner: str
    ) -> dict[str, Any]:
        """Values by name.

        Args:
            hints: the type of each field that there is.
            owner: what has them, for messages.
        """
        if unknown := sorted(written.keys() - hints.keys()):
            raise StateError(f"{owner} has no field {unknown[0][:40]!r}")
        read = {
            name: self.value(item, hints[name], f"{owner}.{name}", was.get(name, MISSING))
            for name, item in written.items()
        }
        return {name: value for name, value in read.items() if value is not MISSING}

    def fill(self, written: Mapping[str, Any], record: Any) -> None:
        """Give a dataclass that is there already other fields."""
        kind: type = type(record)
        for name, value in self.fields(written, vars(record), hints_of(kind), kind.__name__).items():
            setattr(record, name, value)

    def skip(self, written: Mapping[str, Any]) -> None:
        """Read what has no place, as other things may be the same objects."""
        self._lenient = True
        self.fields(written, {}, dict.fromkeys(written, Any), "a node")
        self._lenient = False

    def value(self, written: Any, hint: Any, place: str, was: Any = MISSING) -> Any:
        """A value of a type; `place` says where it stands, for messages."""
        try:
            value = self(written, was)
        except _Unreadable as error:
            raise StateError(f"{place} {error}") from None
        if value is MISSING or fits(value, hint):
            return value
        raise StateError(f"{place} is {type(value).__name__} and not {getattr(hint, '__name__', hint)}")

    def __call__(self, written: Any, was: Any = MISSING) -> Any:
        if not isinstance(written, dict):
            return written
        if "named" in written:
            return self.named.get(written["named"], MISSING)
        if "float" in written:
            return float(written["float"])
        if "enum" in written:
            return self._enum(*written["enum"])
        if "ref" in written:
            return self._known[written["ref"]]
        made = self._made(written, was)
        self._known[written["n"]] = made
        return made

    def _made(self, written: Mapping[str, Any], was: Any) -> Any:
        if "kept" in written:
            if was is MISSING and not self._lenient:
                raise _Unreadable("is a thing that only the run had; a dataclass beside the node can be kept")
            return was
        for name, kind in LISTS.items():
            if name in written:
                old = list(was) if isinstance(was, list | tuple) else []
                old += [MISSING] * (len(written[name]) - len(old))
                items = [self(item, before) for item, before in zip(written[name], old, strict=False)]
                return kind(item for item in items if item is not MISSING)
        if (pairs := written.get("dict", written.get("frozen"))) is not None:
            before: Mapping[Any, Any] = was if isinstance(was, Mapping) else {}
            made: dict[Any, Any] = defaultdict(was.default_factory) if isinstance(was, defaultdict) else {}
            made.update({(key := self(raw)): self(value, before.get(key, MISSING)) for raw, value in pairs})
            return MappingProxyType(made) if "frozen" in written else made
        if "array" in written:
            kind, shape, data = written["array"]
            if not NUMBERS.fullmatch(kind):
                raise _Unreadable(f"is an array of {kind[:20]!r}, which is no number")
            array = np.frombuffer(bytes.fromhex(data), np.dtype(kind)).reshape(shape).copy()
            return array if shape else array[()]
        return self._record(written, was)

    def _record(self, written: Mapping[str, Any], was: Any) -> Any:
        kind = self._class(written["record"])
        made: Any = object.__new__(kind)
        self._known[written["n"]] = made  # it may hold itself
        old, hints = vars(was) if type(was) is kind else {}, hints_of(kind)
        read = self.fields(written["of"], old, hints, kind.__name__)
        values = {**{name: old[name] for name in hints if name in old}, **read}
        if lacking := [name for name in hints if name not in values]:
            raise StateError(f"a {kind.__name__} lacks {', '.join(lacking)}")
        for name, value in values.items():
            object.__setattr__(made, name, value)
        if kind.__dataclass_params__.frozen and hasattr(made, "__post_init__"):  # it checks itself
            made.__post_init__()
        return made

    def _enum(self, name: str, member: str) -> Enum:
        kind = self._class(name)
        if not issubclass(kind, Enum):
            raise _Unreadable(f"is of {name}, which is no enumeration")
        found: Enum = kind[member]
        return found

    def _class(self, name: str) -> Any:
        if (kind := self._records.get(name)) is None:
            raise _Unreadable(f"is a {str(name)[:80]}, which is no part of a run's state")
        return kind
