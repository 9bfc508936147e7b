"""The nodes that tree files of this cell may name: every leaf class in the modules of `trees.nodes`."""

from __future__ import annotations

import importlib
import pkgutil

import trees.nodes
from trees.engine.node import Node
from trees.files.registry import Registry


def node_registry() -> Registry:
    """All nodes, by module and in the order of their text; a class that others derive from is only their base."""
    classes: list[type[Node]] = []
    for info in pkgutil.iter_modules(trees.nodes.__path__):
        module = importlib.import_module(f"trees.nodes.{info.name}")
        classes += [
            member
            for member in vars(module).values()
            if isinstance(member, type) and issubclass(member, Node) and member.__module__ == module.__name__
        ]
    return Registry(node for node in classes if not node.__subclasses__())
