"""Helpers for tests of the tree engine."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from cell.interfaces.clock import ManualClock
from trees.loader import load_tree
from trees.node import Node
from trees.registry import Registry
from trees.tree import Tree

Load = Callable[..., Tree]


@pytest.fixture
def write(tmp_path: Path) -> Callable[[str], Path]:
    """Writes a tree file: a whole one, or the content of its <root>."""

    def write_file(xml: str, name: str = "tree.xml") -> Path:
        path = tmp_path / name
        whole = xml if xml.lstrip().startswith("<?xml") or "<root" in xml else f'<root BTCPP_format="4">{xml}</root>'
        path.write_text(whole)
        return path

    return write_file


@pytest.fixture
def load(write: Callable[[str], Path]) -> Load:
    """Loads and sets up a tree whose main tree holds the given nodes; further trees may follow in `more`."""

    def load_nodes(nodes: str, *classes: type[Node], more: str = "", clock: Any = None, services: Any = None) -> Tree:
        path = write(
            f'<root BTCPP_format="4" main_tree_to_execute="Main">'
            f'<BehaviorTree ID="Main">{nodes}</BehaviorTree>{more}</root>'
        )
        tree = load_tree(path, Registry(classes))
        tree.setup(services, clock or ManualClock())
        return tree

    return load_nodes
