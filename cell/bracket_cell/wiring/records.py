"""What the state of a run may be made of: dataclasses and enumerations of a closed list, each field of its own type."""

from __future__ import annotations

import dis
import sys
import typing
from collections import deque
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import fields, is_dataclass
from enum import Enum
from functools import cache
from importlib import import_module
from types import FunctionType, ModuleType, NoneType, UnionType
from typing import Any, Literal, Union, get_args, get_origin

import numpy as np

from btxml.engine.node import TreeNode

MODULES = {  # with records, by package
    "bracket_ground.interfaces": "command grip memory observation operator perception planning pose resume skill",
    "bracket_cell.running": "fault_checks gripper_checks hand_checks supervisor",
    "bracket_cell.skills": "follow_policy lying move_aside move_to pick_and_place put_down",
    "bracket_cell.skills.grasping": "contact handling phases straight take_lower way_down",
    "bracket_cell.skills.motion": "arm_monitor collision grasp_pose lying_grasp motions planner separation",
    "bracket_cell.trees": "guard",
    "btxml.engine": "status",
    "bracket_cell.trees.nodes": "mistakes moving people pointing poses telling watching ported.moveit_pro",
}
COUNTED = (int, np.integer)
MEASURED = (int, float, np.number)


@cache
def _own() -> Mapping[str, type]:
    modules = [import_module(f"{package}.{name}") for package, names in MODULES.items() for name in names.split()]
    return {name_of(kind): kind for module in modules for kind in _records(module)}


def records(nodes: Iterable[TreeNode]) -> Mapping[str, type]:
    """All that a state may be made of, by name: the program's, and those beside the nodes of a tree."""
    modules = {name: sys.modules[name] for name in {type(node).__module__ for node in nodes}}
    return {**{name_of(kind): kind for module in modules.values() for kind in _records(module)}, **_own()}


def name_of(kind: type) -> str:
    """A class's name in a log."""
    return f"{kind.__module__}.{kind.__qualname__}"


def _records(module: ModuleType) -> Iterator[type]:
    own = [var for var in vars(module).values() if isinstance(var, type) and var.__module__ == module.__name__]
    return (kind for kind in own if (is_dataclass(kind) or issubclass(kind, Enum)) and not issubclass(kind, TreeNode))


@cache
def hints_of(kind: type) -> Mapping[str, Any]:
    """The type of each field of a dataclass."""
    hints = typing.get_type_hints(kind)
    return {field.name: hints[field.name] for field in fields(kind)}


@cache
def stored_by(kind: type) -> frozenset[str]:
    """Names of the attributes that a node's own code sets; none of them is a method."""
    functions = [var for base in kind.__mro__ for var in vars(base).values() if isinstance(var, FunctionType)]
    names = {
        step.argval for function in functions for step in dis.get_instructions(function) if step.opname == "STORE_ATTR"
    }
    return frozenset(name for name in names if not _is_code(getattr(kind, name, None)))


def _is_code(member: Any) -> bool:
    return callable(member) or hasattr(type(member), "__get__")


def fits(value: Any, hint: Any) -> bool:
    """Whether a value is of a type, at any depth; a record was looked at when it was made."""
    origin: Any = get_origin(hint)
    inner: Any = get_args(hint)
    if hint is Any or hint is object:
        return True
    if origin in (Union, UnionType):
        return any(fits(value, alternative) for alternative in inner)
    if origin is Literal:
        return isinstance(value, str | int | NoneType) and value in inner
    kind = origin or (NoneType if hint is None else hint)
    if kind in (float, int) and not isinstance(value, bool):
        return isinstance(value, MEASURED if kind is float else COUNTED)
    if not isinstance(value, kind) or (kind is not bool and isinstance(value, bool)):
        return False
    return not inner or _contents_fit(value, kind, inner)


def _contents_fit(value: Any, kind: type, inner: tuple[Any, ...]) -> bool:
    if isinstance(value, Mapping):
        return all(fits(key, inner[0]) and fits(item, inner[1]) for key, item in value.items())
    if isinstance(value, tuple) and inner[-1] is not Ellipsis and kind is tuple:
        return len(value) == len(inner) and all(fits(item, of) for item, of in zip(value, inner, strict=True))
    return not isinstance(value, list | tuple | set | frozenset | deque) or all(fits(item, inner[0]) for item in value)
