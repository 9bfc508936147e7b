"""The behaviour trees of the cell: their nodes, and how tree files that name them are loaded and tested.

The language, its nodes and its engine are `btxml`.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from bracket_cell.trees.bench import TreeBench as Bench
    from bracket_cell.trees.loading import load_tree
    from bracket_cell.trees.node_library import node_registry, tree

__all__ = ["Bench", "load_tree", "node_registry", "tree"]
_HOME = {
    "Bench": ("bench", "TreeBench"),
    "load_tree": ("loading", "load_tree"),
    "node_registry": ("node_library", "node_registry"),
    "tree": ("node_library", "tree"),
}


def __getattr__(name: str) -> object:
    """Load a promised name when it is first asked for."""
    if name not in _HOME:
        raise AttributeError(f"module 'bracket_cell.trees' has no attribute '{name}'; it offers {', '.join(__all__)}")
    module, attribute = _HOME[name]
    return getattr(import_module(f"{__name__}.{module}"), attribute)


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
