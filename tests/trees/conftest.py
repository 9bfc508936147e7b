"""Helpers for tests of the tree engine."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from bracket_cell.trees.loading import load_tree
from bracket_ground.interfaces.clock import ManualClock
from btxml.engine.errors import TreeFileError
from btxml.engine.node import Node
from btxml.engine.tree import Tree
from btxml.files.checks.structure import check_structure
from btxml.files.compile.registry import Registry
from btxml.files.loader import build
from btxml.files.parse.library import read_library

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


def load_whatever_is_reached(path: Path, registry: Registry) -> Tree:
    """A random tree, also where one of its children can never be reached, which `load_tree` refuses.

    Raises:
        TreeFileError: something else is wrong with it.
    """
    library = read_library(path)
    problems = library.problems + check_structure(library, registry)
    if not problems:
        tree, problems = build(library, registry, library.main, {})
    if problems:
        raise TreeFileError(*problems)
    return tree
