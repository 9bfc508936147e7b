"""Test kit: run a tree without a cell, with leaves that answer as told and a clock moved by hand.

Example:
    bench = TreeBench(Path("trees/clear_and_grasp.xml"), registry, {"PickPart": "RRS", "CheckGraspability": "FS"})
    assert_ticks(bench, "RRRS")
    assert bench.started("MoveAside") == 1
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from py_trees.common import Status

from cell.interfaces.clock import ManualClock
from trees.engine.blackboard import Entry
from trees.engine.node import FAILURE, RUNNING, SKIPPED, SUCCESS, Node, Runtime, TreeNode
from trees.engine.ports import Port
from trees.engine.tree import Tree
from trees.files.loader import load_tree
from trees.files.registry import BUILT_IN, Registry, is_leaf, tag_of
from trees.files.words import hint

LETTERS = {"S": SUCCESS, "F": FAILURE, "R": RUNNING, "K": SKIPPED}
WORDS = {status: letter for letter, status in LETTERS.items()}


class TreeBench:
    """A loaded tree whose own leaves are replaced by scripted ones; the language's nodes stay as they are.

    Args:
        answers: by node name or tag, one letter a tick: S, F, R(UNNING) or K (skipped); the last one is repeated.
            A leaf that is not named succeeds.
        writes: by node name or tag, values of output ports that the leaf writes when it succeeds.
        provided: entries of the main tree that are set before the first tick.
        services: what own controls and decorators work with; none by default.

    Attributes:
        events: "start NAME", "tick NAME", "end NAME" and "halt NAME" since the beginning.
    """

    def __init__(
        self,
        path: Path,
        registry: Registry,
        answers: Mapping[str, str] | None = None,
        writes: Mapping[str, Mapping[str, Any]] | None = None,
        provided: Mapping[str, Any] | None = None,
        main: str | None = None,
        services: object = None,
    ) -> None:
        self.events: list[str] = []
        self.clock = ManualClock()
        stand_ins = [
            self._stand_in(node, registry.ports(tag), answers or {}, writes or {})
            for tag, node in registry.classes.items()
            if is_leaf(node) and node not in BUILT_IN
        ]
        others = [node for node in registry.classes.values() if not is_leaf(node) and node not in BUILT_IN]
        self.tree: Tree = load_tree(path, Registry([*stand_ins, *others]), main, provided)
        self.tree.setup(services, self.clock)
        self._tags = {node.name: type(node).__name__ for node in self.tree.nodes}
        for name in {**(answers or {}), **(writes or {})}:
            if name not in self._tags and name not in registry.classes:
                raise ValueError(f"nothing is named '{name}'; {hint(name, [*self._tags, *registry.classes])}")

    def tick(self, after_s: float = 0.0) -> str:
        """Move the clock, then tick; the root's status as a letter."""
        self.clock.sleep_until(self.clock.now_s() + after_s)
        return WORDS[self.tree.tick()]

    def started(self, name: str) -> int:
        """How often a leaf was begun, by its name; by a tag, all leaves of that kind.

        Raises:
            ValueError: the tree has no such leaf.
        """
        names = [one for one, tag in self._tags.items() if name in (one, tag)]
        if not names:
            raise ValueError(f"the tree has no '{name}'; {hint(name, [*self._tags, *self._tags.values()])}")
        return sum(self.events.count(f"start {one}") for one in names)

    def _stand_in(
        self,
        original: type[TreeNode],
        ports: Mapping[str, Port],
        answers: Mapping[str, str],
        writes: Mapping[str, Mapping[str, Any]],
    ) -> type[Node]:
        tag = tag_of(original)
        events = self.events

        class StandIn(Node):
            """Answers as told."""

            turn = 0

            def initialise(self) -> None:
                events.append(f"start {self.name}")

            def update(self) -> Status:
                events.append(f"tick {self.name}")
                letters = answers.get(self.name, answers.get(tag, "S"))
                letter = letters[min(self.turn, len(letters) - 1)]
                self.turn += 1
                if letter == "S":
                    for port, value in writes.get(self.name, writes.get(tag, {})).items():
                        vars(self)[ports[port].attribute].set(value)
                return LETTERS[letter]

            def terminate(self, new_status: Status) -> None:
                events.append(f"{'halt' if new_status is Status.INVALID else 'end'} {self.name}")

        properties = {name: getattr(original, name) for name in ("node_type", "instant", "guards", "needs_guard")}
        attributes = {port.attribute: port for port in ports.values()}
        properties["further_port"] = classmethod(lambda _, name: original.further_port(name))
        return type(tag, (StandIn,), {**properties, **attributes})


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
