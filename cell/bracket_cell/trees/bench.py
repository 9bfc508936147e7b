"""The test kit of trees with the nodes of this cell."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

from bracket_cell.trees.loading import input_errors
from bracket_cell.trees.node_library import node_registry
from btxml import testing
from btxml.engine.node import TreeNode
from btxml.files.compile.registry import Registry


class TreeBench(testing.TreeBench):
    """A tree whose leaves are scripted, as the engine's, with the nodes of the cell by default.

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
    ) -> None:
        with input_errors():
            super().__init__(path, answers, writes, provided, main, services, registry or node_registry(), beside, real)
