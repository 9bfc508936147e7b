"""The state of a run between two ticks as plain data, so that a replay may begin there: what is kept is never code.

Nodes, blackboard, memory and supervisor are walked field by field. What a fresh run has by itself, such as planners,
kinematics and files, is named and not written. On the way back objects are filled with their fields; nothing is called.
"""

from __future__ import annotations

import dataclasses
import math
import re
import sys
from collections import defaultdict, deque
from collections.abc import Iterator, Mapping
from enum import Enum
from functools import partial
from importlib import import_module
from types import CellType, CodeType, FunctionType, MappingProxyType, MethodType
from typing import Any

import numpy as np

from cell.errors import InputError
from cell.files.model import Model
from cell.running.supervisor import Supervisor
from trees.engine.blackboard import UNSET, Entry
from trees.engine.node import TreeNode
from trees.engine.ports import Connection
from trees.engine.script import Script
from trees.engine.tree import Tree
from trees.nodes.services import Services

OWN = ("cell", "trees", "skills", "learned", "sim")  # packages whose objects may be filled with what a log says
FILLED = ("cell.interfaces", "cell.running", "trees.", "skills.", "learned.")
OPENING = ("skills.drivers",)
OF_ENGINE = frozenset(
    ("runtime", "note_change", "children", "decorated", "services", "name", "uid", "full_path", "conditions", "_made")
)
LISTS: dict[str, Any] = {"tuple": tuple, "set": set, "frozenset": frozenset, "deque": deque, "list": list}
KEPT = {"kept": True}
OF_MOTION = ("hold", "lying")
OF_ENTRY = ("value", "revision", "carried", "declared", "text")
NUMBER = re.compile(r"::\d+")
MISSING: Any = object()


class StateError(InputError):
    """A state that cannot be written, or does not fit the tree that is to go on with it."""


def state_of(tree: Tree, services: Services, supervisor: Supervisor) -> dict[str, Any]:
    """What a replay needs to go on after this tick; `lost` says why it cannot, where a monitor's hook is in the way."""
    if hooked := next((node.full_path for node in tree.nodes if "execute" in vars(node)), None):
        return {"lost": f"{hooked}: a monitor has put a hook on it"}
    try:
        return _written(tree, services, supervisor)
    except RecursionError:
        return {"lost": "a node keeps what is too deep for a log"}


def go_on_from(state: Mapping[str, Any], tree: Tree, services: Services, supervisor: Supervisor) -> list[str]:
    """Put a tree, its services and a supervisor, all set up and fresh, where a run was.

    Where the tree is another one, nodes of the same class and place go on, and entries of the same name.

    Args:
        services: the tick that they hold is the one after which the state was written.

    Returns:
        Paths of nodes and names of entries that begin anew.

    Raises:
        StateError: the state is none of this program.
    """
    try:
        for parts in state["learned"][len(services.learned) :]:
            services.learn(tuple(parts))
        read = _Reader(_named(tree, services))
        fresh = [*_nodes(state["nodes"], tree, read), *_entries(state["entries"], tree, read)]
        tree._runtime.ticks, tree._runtime.agreed = map(int, state["runtime"])
        for name, value in read.fields(state["memory"], services.memory.values()).items():
            setattr(services.memory, name, value)
        for name in OF_MOTION:
            setattr(services.tools.motion, name, read(state["motion"][name]))
        services.now.display = read(state["display"])
        services._solved_view, services._solved = (read(one) for one in state["solved"])
        supervisor.state = [read(one, was) for one, was in zip(state["supervisor"], supervisor.state, strict=True)]
    except (KeyError, ValueError, TypeError, AttributeError, IndexError, StopIteration, RecursionError) as error:
        raise StateError(f"the state of the run does not fit this program: {type(error).__name__}: {error}") from None
    return fresh


def _written(tree: Tree, services: Services, supervisor: Supervisor) -> dict[str, Any]:
    write = _Writer(_named(tree, services))
    return {
        "nodes": [[node.full_path, type(node).__name__, write.fields(_kept_by(node))] for node in tree.nodes],
        "entries": [
            [scope, key, write.fields({name: getattr(entry, name) for name in OF_ENTRY})]
            for (scope, key), entry in _entries_of(tree).items()
            if entry.revision
        ],
        "runtime": [tree._runtime.ticks, tree._runtime.agreed],
        "learned": [list(parts) for parts in services.learned],
        "memory": write.fields(services.memory.values()),
        "display": write(services.now.display),
        "motion": {name: write(getattr(services.tools.motion, name)) for name in OF_MOTION},
        "solved": [write(services._solved_view), write(services._solved)],
        "supervisor": [write(one) for one in supervisor.state],
    }


def _nodes(written: list[Any], tree: Tree, read: _Reader) -> list[str]:
    """Fill the nodes; paths of those that nothing was written for."""
    if [(path, kind) for path, kind, _ in written] == [(node.full_path, type(node).__name__) for node in tree.nodes]:
        pairs = list(zip(tree.nodes, written, strict=True))
    else:
        places: dict[tuple[str, str], tuple[list[TreeNode], list[Any]]] = defaultdict(lambda: ([], []))
        for node in tree.nodes:
            places[NUMBER.sub("", node.full_path), type(node).__name__][0].append(node)
        for one in written:
            places[NUMBER.sub("", one[0]), one[1]][1].append(one)
        alike = [two for two in places.values() if len(two[0]) == len(two[1])]
        pairs = [pair for nodes, ones in alike for pair in zip(nodes, ones, strict=True)]
    found = {id(one): node for node, one in pairs}
    numbers = {id(one): number for number, one in enumerate(written, 1)}
    read.named |= {f"node {numbers[key]}": node for key, node in found.items()}
    for one in written:
        filled = found.get(id(one))
        if filled is None:
            read.skip(one[2])
        else:
            vars(filled).update(read.fields(one[2], vars(filled)))
    known = {node.uid for node, _ in pairs}
    return [node.full_path for node in tree.nodes if node.uid not in known]


def _entries(written: list[Any], tree: Tree, read: _Reader) -> list[str]:
    entries, lost = _entries_of(tree), []
    for scope, key, fields in written:
        entry = entries.get((scope, key))
        if entry is None:
            read.skip(fields)
            lost.append(key)
            continue
        for name, value in read.fields(fields, {name: getattr(entry, name) for name in OF_ENTRY}).items():
            setattr(entry, name, value)
    return lost


def _entries_of(tree: Tree) -> dict[tuple[str, str], Entry]:
    """All entries, each once, by the outermost scope that has it and its name there."""
    found: dict[int, tuple[str, str, Entry]] = {}
    for scope in tree.scopes:
        for key in scope:
            found.setdefault(id(scope.entry(key)), (scope.name, key, scope.entry(key)))
    return {(scope, key): entry for scope, key, entry in found.values()}


def _kept_by(node: TreeNode) -> dict[str, Any]:
    """What a node keeps between two ticks, with its status and its words."""
    kept = {name: value for name, value in vars(node).items() if name not in OF_ENGINE}
    return {name: value for name, value in kept.items() if not isinstance(value, Connection | Script)}


def _named(tree: Tree, services: Services) -> dict[str, Any]:
    """What both have, the run and its replay, by name; it is not written."""
    seen, tools = services.now.observation, services.tools
    named: dict[str, Any] = {"unset": UNSET, "services": services, "now": services.now, "memory": services.memory}
    named |= {"seen": seen, "runtime": tree._runtime, "clock": tree._runtime.clock}
    named |= {f"seen.{name}": value for name, value in vars(seen).items() if _is_own(value)}
    named |= {f"tools.{one.name}": getattr(tools, one.name) for one in dataclasses.fields(tools)}
    named |= {"tools": tools, **dict(_below("motion", tools.motion, 3))}
    named |= {f"entry {scope} {key}": entry for (scope, key), entry in _entries_of(tree).items()}
    return named | {f"node {node.uid}": node for node in tree.nodes}


def _below(name: str, thing: Any, depth: int) -> Iterator[tuple[str, Any]]:
    for key, value in vars(thing).items() if depth else ():
        if _is_own(value) and key not in OF_MOTION:
            yield f"{name}.{key}", value
            if hasattr(value, "__dict__"):
                yield from _below(f"{name}.{key}", value, depth - 1)


def _is_own(value: object) -> bool:
    return type(value).__module__.partition(".")[0] in OWN and not isinstance(value, type | Enum)


class _Writer:
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
                "function": [*_class(value), _column(value.__code__)],
                "of": {name: self(cell.cell_contents) for name, cell in cells},
            }
        if isinstance(value, partial):
            return {"partial": [self(value.func), self(value.args), self(value.keywords)]}
        if isinstance(value, MethodType):
            return {"method": [self(value.__self__), value.__name__]}
        if (not _is_own(value) and not dataclasses.is_dataclass(kind)) or isinstance(value, Model):
            return KEPT
        if not hasattr(value, "__dict__") and not dataclasses.is_dataclass(kind):
            return KEPT
        fields = dict(_fields(value))
        return {"object": _class(kind), "of": self.fields(fields)}


class _Reader:
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
        old = dict(_fields(was)) if type(was) is kind else {}
        for name, value in {**old, **self.fields(written["of"], old)}.items():
            object.__setattr__(made, name, value)
        return made


def _fields(value: Any) -> Iterator[tuple[str, Any]]:
    """What an object holds, by attribute."""
    if hasattr(value, "__dict__"):
        yield from vars(value).items()
    for kind in type(value).__mro__:
        for name in getattr(kind, "__slots__", ()):
            if name not in ("__dict__", "__weakref__") and hasattr(value, name):
                yield name, getattr(value, name)


def _class(kind: type | FunctionType) -> list[str]:
    return [kind.__module__, kind.__qualname__]


def _content(cell: CellType) -> Any:
    try:
        return cell.cell_contents
    except ValueError:  # empty, as of a function that was just made
        return MISSING


def _column(code: CodeType) -> list[int | None]:
    """Where in its file a function ends, which tells those of one name apart."""
    return list([*code.co_positions()][-1])


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
    code = next(one for one in within if _column(one) == column)
    return FunctionType(code, vars(import_module(module)), None, None, tuple(CellType() for _ in code.co_freevars))


def _known_class(module: str, name: str) -> type:
    """A class of this program, or of a file with nodes that was loaded with the tree."""
    found: Any = import_module(module) if module.startswith(FILLED) else sys.modules.get(module)
    for part in name.split("."):
        found = getattr(found, part, None)
    if not isinstance(found, type):
        raise StateError(f"the state of the run holds a {module}.{name}, which this program does not know")
    return found
