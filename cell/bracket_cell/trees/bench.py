"""The test kit of trees with the nodes of this cell."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

from bracket_cell.trees.loading import input_errors
from bracket_cell.trees.node_library import node_registry
from bracket_cell.trees.rules import Situation, rules_beside, watch_of
from btxml import testing
from btxml.engine.node import TreeNode
from btxml.files.compile.registry import Registry
from btxml.rules import Violation, nodes_of


class TreeBench(testing.TreeBench):
    """A tree whose leaves are scripted, as the engine's, with the nodes of the cell by default.

    Args:
        rules: files of rules; by default the one beside the tree file. What they say of devices is unknown here.

    Attributes:
        violations: of rules so far; a test asserts that there are none.

    Raises:
        InputError: `cell check` refuses the tree.
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
        rules: Iterable[Path | str] | None = None,
        mocks: str | Path | None = None,
    ) -> None:
        known = registry or node_registry()
        with input_errors():
            super().__init__(path, answers, writes, provided, main, services, known, beside, real, mocks)
        found = rules_beside(Path(path)) if rules is None and not isinstance(path, TreeNode) else None
        self._watch = watch_of([found] if found else map(Path, rules or ()))
        self._nodes, self._ticks = nodes_of(self.tree), 0
        self.violations: list[Violation] = []

    def tick(self, after_s: float = 0.0) -> str:
        """Move the clock, then tick; the root's status as a letter. What breaks a rule joins `violations`."""
        letter = super().tick(after_s)
        self._nodes.follow(self.tree.status_changes)
        situation = Situation(self.clock.now_s(), entries=self.tree.blackboard.values(), nodes=self._nodes)
        self.violations += self._watch.step(self._ticks, situation)
        self._ticks += 1
        return letter
