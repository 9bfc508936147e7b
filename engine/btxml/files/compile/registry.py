"""Which node classes tree files may name."""

from __future__ import annotations

import sys
import typing
from collections.abc import Callable, Iterable, Mapping
from enum import Enum
from typing import Any

from btxml.engine import choices, controls, decorators, leaves, loops, parallel
from btxml.engine.blackboard import UNSET
from btxml.engine.literals import STATUS_WORDS, LiteralError, converted
from btxml.engine.node import Control, Decorator, TreeNode
from btxml.engine.ports import InputPort, Port, named, ports_of
from btxml.engine.vocabulary import Words
from btxml.files.parse.xml_file import Element, entry_name

RESERVED = ("name", "ID")

BUILT_IN: tuple[type[TreeNode], ...] = (
    controls.Sequence,
    controls.AsyncSequence,
    controls.SequenceWithMemory,
    controls.ReactiveSequence,
    controls.Fallback,
    controls.AsyncFallback,
    controls.ReactiveFallback,
    parallel.Parallel,
    parallel.ParallelAll,
    choices.IfThenElse,
    choices.WhileDoElse,
    choices.TryCatch,
    *choices.SWITCHES,
    decorators.Inverter,
    decorators.ForceSuccess,
    decorators.ForceFailure,
    decorators.KeepRunningUntilFailure,
    loops.Repeat,
    loops.RetryUntilSuccessful,
    decorators.Timeout,
    decorators.Delay,
    decorators.RunOnce,
    decorators.Precondition,
    loops.LoopInt,
    loops.LoopBool,
    loops.LoopDouble,
    loops.LoopString,
    decorators.SkipUnlessUpdated,
    decorators.WaitValueUpdate,
    leaves.AlwaysSuccess,
    leaves.AlwaysFailure,
    leaves.Sleep,
    leaves.Script,
    leaves.ScriptCondition,
    leaves.SetBlackboard,
    leaves.UnsetBlackboard,
    leaves.WasEntryUpdated,
)


class Registry:
    """What tree files may name: node classes, the built-in ones first, enums in scripts, names of the configuration.

    Args:
        classes: node classes of the project; their tags are their class names.
        enums: enums whose members scripts may name; those of ports are known anyway.
        words: the names that ports of each kind take; a kind that is missing takes any.
        remark: what to say where a node is not known, beside what is near.
        described: package whose leaves say by their traits all that they bring about; of other leaves that claim a
            device nothing is known.
        entries: of every main tree, those that the cell itself writes, with their first values; a tree only reads them.

    Attributes:
        substitute: gives what takes a leaf's place in a test, by its element, tag, name and path; None for nothing.
    """

    substitute: Callable[[Element, str, str, str], tuple[str, Element] | None] | None = None

    def __init__(
        self,
        classes: Iterable[type[TreeNode]] = (),
        enums: Iterable[type[Enum]] = (),
        words: Words | None = None,
        remark: str = "",
        entries: Mapping[str, Any] | None = None,
        described: str = "",
    ) -> None:
        self.described = described
        self.remark = remark
        self.entries: Mapping[str, Any] = entries or {}
        self.words: Words = words or {}
        self.classes: dict[str, type[TreeNode]] = {}
        self._ports: dict[str, dict[str, Port]] = {}
        self._free: set[str] = set()
        self.enums: dict[str, Any] = dict(STATUS_WORDS)
        for node in (*BUILT_IN, *classes):
            self._add(node)
        for kind in enums:
            self._add_enum(kind)

    def names_node(self, name: str) -> bool:
        """Whether a node has this name, so that no tree may have it."""
        return name in self.classes and name not in self._free

    def ports(self, tag: str) -> Mapping[str, Port]:
        """Ports of a class by their names in XML."""
        return self._ports[tag]

    def ports_in(self, tag: str, attributes: Iterable[str]) -> Mapping[str, Port]:
        """Declared ports of a class, and those that only a file's attributes name."""
        ports = self._ports[tag]
        further = {
            name: named(port, name)
            for name in attributes
            if name not in ports
            and not is_reserved(name)
            and (port := self.classes[tag].further_port(name)) is not None
        }
        return {**ports, **further} if further else ports

    def extended(self, classes: Iterable[type[TreeNode]], without: Iterable[str] = ()) -> Registry:
        """A registry with more nodes, also in the place of those of the same names.

        Args:
            without: nodes that it does not have; trees may have their names.
        """
        more = Registry(words=self.words, remark=self.remark, entries=self.entries, described=self.described)
        more.classes, more._ports, more.enums = dict(self.classes), dict(self._ports), dict(self.enums)
        more._free = self._free | set(without)
        for tag in without:
            more.classes.pop(tag, None)
        for node in classes:
            more.classes.pop(tag_of(node), None)
            more._add(node)
        return more

    def _add(self, node: type[TreeNode]) -> None:
        tag = tag_of(node)
        if tag in self.classes:
            both = " and ".join(_module(kind) for kind in (self.classes[tag], node))
            raise ValueError(f"two node classes are named {tag}, in {both}; rename one")
        ports = ports_of(node)
        for name, port in ports.items():
            if is_reserved(name):
                raise ValueError(f"{_module(node)}: {tag} has a port {name!r}, which is reserved; give it another name")
            if isinstance(port, InputPort) and port.default is not UNSET and entry_name(port.default, name) is None:
                try:
                    converted(port.default, port.kind)
                except LiteralError as error:
                    what = f"the default of port {name!r} of {tag}: {error}; {error.legal}"
                    raise ValueError(f"{_module(node)}: {what}") from None
        self.classes[tag] = node
        self._ports[tag] = ports
        for port in ports.values():
            for kind in (port.kind, *typing.get_args(port.kind)):
                if isinstance(kind, type) and issubclass(kind, Enum):
                    self._add_enum(kind)

    def _add_enum(self, kind: type[Enum]) -> None:
        for name, member in kind.__members__.items():
            value = member.value if isinstance(member.value, int) else member
            self.enums.setdefault(name, value)


def is_reserved(name: str) -> bool:
    """Whether an attribute of this name is never a port."""
    return name in RESERVED or name.startswith("_")


def _module(node: type[TreeNode]) -> str:
    """The file that a class stands in, or its module."""
    return getattr(sys.modules.get(node.__module__), "__file__", None) or node.__module__


def tag_of(node: type[TreeNode]) -> str:
    """A class's name in XML."""
    return node.tag or node.__name__


def meaning_of(node: type[TreeNode]) -> str:
    """First line of a class's docstring."""
    return (node.__doc__ or "").strip().split("\n")[0]


def is_leaf(node: type[TreeNode]) -> bool:
    """Whether nodes of this class have no children."""
    return not issubclass(node, Control | Decorator)
