"""The way back from plain data to values of a run: objects are filled with their fields, and nothing is called."""

from __future__ import annotations

import sys
from collections import defaultdict
from collections.abc import Mapping
from functools import partial
from importlib import import_module
from types import CellType, CodeType, FunctionType, MappingProxyType
from typing import Any

import numpy as np

from cell.errors import InputError
from cell.wiring.state_writer import LISTS, column_of, fields_of
from trees.engine.node import TreeNode

FILLED = ("cell.interfaces", "cell.running", "trees.", "skills.", "learned.")
OPENING = ("skills.drivers",)
MISSING: Any = object()


class StateError(InputError):
    """A state that cannot be written, or does not fit the tree that is to go on with it."""


class StateReader:
    """The way back, for objects of this program's data and of the modules of the tree's nodes.

    Where a value is read, `was` is what stands in its place; it gives what was not written.
    """

    def __init__(self, named: dict[str, Any]) -> None:
        self.named = named
        self._modules = {type(one).__module__ for one in named.values() if isinstance(one, TreeNode)}
        self._known: dict[int, Any] = {}
        self._lenient = False

    def fields(self, written: Mapping[str, Any], was: Mapping[str, Any]) -> dict[str, Any]:
        read = {}
        for name, one in written.items():
            try:
                read[name] = self(one, was.get(name, MISSING))
            except StateError as error:
                raise StateError(f"{name}: {error}") from None
        return {name: value for name, value in read.items() if value is not MISSING}

    def skip(self, written: Mapping[str, Any]) -> None:
        """Read what has no place, as other things may be the same objects."""
        self._lenient = True
        self.fields(written, {})
        self._lenient = False

    def __call__(self, written: Any, was: Any = MISSING) -> Any:
        if not isinstance(written, dict):
            return written
        if "named" in written:
            return self.named.get(written["named"], MISSING)
        if "float" in written:
            return float(written["float"])
        if "enum" in written:
            module, name, member = written["enum"]
            return _known_class(module, name)[member]  # type: ignore[index]
        if "ref" in written:
            return self._known[written["ref"]]
        made = self._made(written, was)
        self._known[written["n"]] = made
        return made

    def _made(self, written: Mapping[str, Any], was: Any) -> Any:
        if "kept" in written:
            if was is MISSING and not self._lenient:
                raise StateError("it is a thing that only the run had")
            return was
        for name, kind in LISTS.items():
            if name in written:
                old = list(was) if isinstance(was, list | tuple) else []
                old += [MISSING] * (len(written[name]) - len(old))
                items = [self(one, before) for one, before in zip(written[name], old, strict=False)]
                return kind(one for one in items if one is not MISSING)
        if (pairs := written.get("dict", written.get("frozen"))) is not None:
            before: Mapping[Any, Any] = was if isinstance(was, Mapping) else {}
            made: dict[Any, Any] = defaultdict(was.default_factory) if isinstance(was, defaultdict) else {}
            made.update({(key := self(one)): self(value, before.get(key, MISSING)) for one, value in pairs})
            return MappingProxyType(made) if "frozen" in written else made
        if "array" in written:
            kind, shape, data = written["array"]
            array = np.frombuffer(bytes.fromhex(data), np.dtype(kind)).reshape(shape).copy()
            return array if shape else array[()]
        if "method" in written:
            return getattr(self(written["method"][0], getattr(was, "__self__", MISSING)), written["method"][1])
        if "partial" in written:
            function, arguments, named = (self(one) for one in written["partial"])
            return partial(function, *arguments, **named)
        return self._function(written, was) if "function" in written else self._object(written, was)

    def _function(self, written: Mapping[str, Any], was: Any) -> Any:
        """The same function, with what it keeps; a skill's own are made anew, from the code of this program."""
        if not isinstance(was, FunctionType):
            was = _skills_function(*written["function"])
        self._known[written["n"]] = was
        for name, cell in zip(was.__code__.co_freevars, was.__closure__ or (), strict=True):
            cell.cell_contents = self(written["of"][name], _content(cell))
        return was

    def _object(self, written: Mapping[str, Any], was: Any) -> Any:
        kind = _known_class(*written["object"])
        module = kind.__module__
        if not (module.startswith(FILLED) and not module.startswith(OPENING)) and module not in self._modules:
            raise StateError(f"a {kind.__name__} is no part of a run's state")
        made: Any = object.__new__(kind)
        self._known[written["n"]] = made
        old = dict(fields_of(was)) if type(was) is kind else {}
        for name, value in {**old, **self.fields(written["of"], old)}.items():
            object.__setattr__(made, name, value)
        return made


def _content(cell: CellType) -> Any:
    try:
        return cell.cell_contents
    except ValueError:  # empty, as of a function that was just made
        return MISSING


def _skills_function(module: str, name: str, column: list[int | None]) -> FunctionType:
    """A function of a skill; one that is defined in another has empty cells for what it keeps."""
    if not module.startswith("skills.") or module.startswith(OPENING):
        raise StateError(f"the function {module}.{name} is no part of a run's state")
    outer, *inner = name.split(".<locals>.")
    found: Any = import_module(module)
    for part in outer.split("."):
        found = getattr(found, part)
    if not inner and isinstance(found, FunctionType):
        return found
    within = [found.__code__]
    for part in inner:
        consts = [one for code in within for one in code.co_consts]
        within = [one for one in consts if isinstance(one, CodeType) and one.co_name == part]
    code = next(one for one in within if column_of(one) == column)
    return FunctionType(code, vars(import_module(module)), None, None, tuple(CellType() for _ in code.co_freevars))


def _known_class(module: str, name: str) -> type:
    """A class of this program, or of a file with nodes that was loaded with the tree."""
    found: Any = import_module(module) if module.startswith(FILLED) else sys.modules.get(module)
    for part in name.split("."):
        found = getattr(found, part, None)
    if not isinstance(found, type):
        raise StateError(f"the state of the run holds a {module}.{name}, which this program does not know")
    return found
