"""Test kit: run a tree without a cell, with leaves that answer as told and a clock moved by hand.

Example:
    bench = TreeBench("trees/clear_and_grasp.xml", {"PickPart": "RRS", "CheckGraspability": "FS"})
    assert_ticks(bench, "RRRS")
    assert bench.started("MoveAside") == 1
"""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any, TypeVar

from btxml.engine.blackboard import Entry
from btxml.engine.clock import ManualClock
from btxml.engine.errors import TreeFileError
from btxml.engine.node import FAILURE, RUNNING, SKIPPED, SUCCESS, Node, Runtime, TreeNode
from btxml.engine.ports import Port
from btxml.engine.status import Status
from btxml.engine.tree import Tree
from btxml.files.compile.registry import BUILT_IN, Registry, is_leaf, tag_of
from btxml.files.loader import built, knowing, load_tree, unused_entries
from btxml.files.parse.in_python import InPython, in_python
from btxml.files.parse.library import hint, read_library
from btxml.mocks import Mocks, TestNode, read_mocks

LETTERS = {"S": SUCCESS, "F": FAILURE, "R": RUNNING, "K": SKIPPED}
WORDS = {status: letter for letter, status in LETTERS.items()}

T = TypeVar("T")
_UID = re.compile(r"::\d+(?=/|$)")


class TreeBench:
    """A tree, of a file or in Python, whose own leaves are replaced by scripted ones; the language's nodes are real.

    A leaf is meant by its path (`HelpAhead::27/PickPart::50` or, without uids, `HelpAhead/PickPart`), its name or its
    tag; the more exact word counts.

    Args:
        answers: by leaf, one letter a tick: S, F, R(UNNING) or K (skipped); the last one is repeated.
            A leaf that is not named succeeds.
        writes: by leaf, values of output ports that it writes when it succeeds.
        provided: entries of the main tree that are set before the first tick.
        services: what own controls and decorators work with; none by default.
        registry: the nodes that the file may name; those of the language by default.
        beside: further tree files, and folders with them, whose trees the file may name.
        real: leaves that run as they are.
        part: `main` is called elsewhere; what its callers give it has no value here.
        mocks: file with leaves that are replaced, as BehaviorTree.CPP's `loadSubstitutionRuleFromJSON` reads it.

    Attributes:
        events: "start NAME", "tick NAME", "end NAME" and "halt NAME" since the beginning.

    Raises:
        TreeFileError: `cell check` refuses the tree.
        ValueError: an answer, a write or a rule of mocks is for something that is no leaf.
    """

    def __init__(
        self,
        path: str | Path | TreeNode,
        answers: Mapping[str, str] | None = None,
        writes: Mapping[str, Mapping[str, Any]] | None = None,
        provided: Mapping[str, Any] | None = None,
        main: str | None = None,
        services: object = None,
        registry: Registry | None = None,
        beside: Iterable[Path] = (),
        real: Iterable[type[TreeNode]] = (),
        mocks: str | Path | None = None,
        part: bool = False,
    ) -> None:
        source = in_python(path) if isinstance(path, TreeNode) else Path(path)
        registry = (registry or Registry()).extended(real := tuple(real))
        if isinstance(source, InPython):
            registry = knowing(source, registry)
        self.events: list[str] = []
        self._starts: Counter[int] = Counter()
        self.clock = ManualClock()
        stand_ins = [
            self._stand_in(node, registry.ports(tag), answers or {}, writes or {})
            for tag, node in registry.classes.items()
            if is_leaf(node) and node not in BUILT_IN and node not in real
        ]
        registry = registry.extended([*stand_ins, self._counted(TestNode)])
        replaced = Mocks() if mocks is None else read_mocks(Path(mocks), registry)
        registry.substitute = replaced.instead
        if part and main is not None:
            self.tree: Tree = built(read_library(source, beside), registry, main, provided or {}).tree
        else:
            self.tree = load_tree(source, registry, main, provided, beside)
        if problems := unused_entries({next(iter(self.tree.texts)): self.tree}):
            raise TreeFileError(*problems)
        self.tree.setup(services, self.clock)
        self._leaves = {node.uid: names_of(node) for node in self.tree.nodes if isinstance(node, Counted)}
        known = {name for names in self._leaves.values() for name in names} | {tag_of(leaf) for leaf in stand_ins}
        _refuse("", [name for name in {**(answers or {}), **(writes or {})} if name not in known], known)
        _refuse(f"{mocks}: ", sorted(set(replaced.rules) - replaced.used), known)

    def tick(self, after_s: float = 0.0) -> str:
        """Move the clock, then tick; the root's status as a letter."""
        self.clock.sleep_until(self.clock.now_s() + after_s)
        return WORDS[self.tree.tick()]

    def started(self, name: str) -> int:
        """How often a leaf was begun; by a name or tag that several have, all of them together.

        Raises:
            ValueError: the tree has no such leaf.
        """
        meant = [uid for uid, names in self._leaves.items() if name in names]
        if not meant:
            known = {leaf for names in self._leaves.values() for leaf in names}
            raise ValueError(f"the tree has no '{name}'; {hint(name, known)}")
        return sum(self._starts[uid] for uid in meant)

    def _stand_in(
        self,
        original: type[TreeNode],
        ports: Mapping[str, Port],
        answers: Mapping[str, str],
        writes: Mapping[str, Mapping[str, Any]],
    ) -> type[Node]:
        tag = tag_of(original)

        class StandIn(Node):
            """Answers as told."""

            turn = 0

            def update(self) -> Status:
                letters = _said_of(self, answers, "S")
                letter = letters[min(self.turn, len(letters) - 1)]
                self.turn += 1
                if letter == "S":
                    for port, value in _said_of(self, writes, {}).items():
                        vars(self)[ports[port].attribute].set(value)
                return LETTERS[letter]

        properties: dict[str, Any] = {"node_type": original.node_type, "traits": original.traits}
        attributes = {port.attribute: port for port in ports.values()}
        properties["further_port"] = classmethod(lambda _, name: original.further_port(name))
        return self._counted(type(tag, (StandIn,), {**properties, **attributes}))

    def _counted(self, leaf: type[Node]) -> type[Node]:
        """The same leaf, whose starts, ticks and ends are kept in `events`."""
        events, starts = self.events, self._starts

        class Noted(Counted, leaf):  # type: ignore[misc, valid-type]  # a class that is made here
            def initialise(self) -> None:
                events.append(f"start {self.name}")
                starts[self.uid] += 1
                super().initialise()

            def update(self) -> Status:
                events.append(f"tick {self.name}")
                return super().update()  # type: ignore[no-any-return]

            def terminate(self, new_status: Status) -> None:
                events.append(f"{'halt' if new_status is Status.INVALID else 'end'} {self.name}")
                super().terminate(new_status)

        return type(tag_of(leaf), (Noted,), {"__doc__": leaf.__doc__})


class Counted:
    """A leaf of a bench."""


def names_of(node: TreeNode) -> tuple[str, ...]:
    """What a leaf may be called, the most exact first."""
    return node.full_path, _UID.sub("", node.full_path), node.name, type(node).__name__


def _said_of(node: TreeNode, answers: Mapping[str, T], otherwise: T) -> T:
    return next((answers[name] for name in names_of(node) if name in answers), otherwise)


def assert_ticks(bench: TreeBench, statuses: str, period_s: float = 0.04) -> None:
    """Tick once for every letter of `statuses`, which the root must answer."""
    answered = "".join(bench.tick(period_s) for _ in statuses)
    assert answered == statuses, f"the tree answered {answered}, not {statuses}; events: {bench.events}"


def alone(node: Node, services: object = None, **values: Any) -> Node:
    """Set up a node without a tree, with values for its input ports by their attribute names."""
    for attribute, value in values.items():
        entry = Entry(attribute)
        entry.value = value
        getattr(type(node), attribute).connect(node, entry)
    node.attach(Runtime(), 1, node.name)
    node.setup(services=services)
    return node


def _refuse(where: str, strangers: Sequence[str], known: Iterable[str]) -> None:
    """Raises ValueError where there are names of no leaf."""
    if strangers:
        raise ValueError(f"{where}nothing is named '{strangers[0]}'; {hint(strangers[0], known)}")
