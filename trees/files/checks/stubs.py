"""Stand-ins for nodes that are unknown here, to read the tree files of other programs."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from py_trees.common import Status

from trees.engine.node import FAILURE, Control, Node, TreeNode
from trees.engine.ports import Port
from trees.files.build.registry import BUILT_IN, Registry, is_leaf, is_reserved
from trees.files.parse.library import Library
from trees.files.parse.xml_file import Element, node_tag


class _AnyPort(Port):
    """Reads and writes any entry, and takes any text."""

    takes_texts = True

    def __init__(self) -> None:
        super().__init__(Any, "nothing is known of this port", optional=True)
        self.unset_ok = True


class _Leaf(Node):
    """A leaf of which nothing is known."""

    @classmethod
    def further_port(cls, name: str) -> Port | None:  # noqa: ARG003
        return _AnyPort()

    def update(self) -> Status:
        return FAILURE


class _Parent(Control):
    """A node with children of which nothing is known."""

    @classmethod
    def further_port(cls, name: str) -> Port | None:  # noqa: ARG003
        return _AnyPort()

    def run(self) -> Status:
        return FAILURE


def with_stubs(library: Library, registry: Registry) -> Registry:
    """The registry with a stand-in for every node of a library that it does not know.

    A node that only has the name of one that stands here, and other ports, is not known either.
    """
    parents: dict[str, bool] = {}
    for element in _elements(library):
        tag = node_tag(element)
        if tag and tag != "SubTree" and not _is_known(element, tag, registry):
            parents[tag] = parents.get(tag, False) or bool(element.children)
    stubs = [_stub(tag, _Parent if parent else _Leaf) for tag, parent in parents.items()]
    return registry.extended(stubs) if stubs else registry


def _is_known(element: Element, tag: str, registry: Registry) -> bool:
    node = registry.classes.get(tag)
    if node is None or node in BUILT_IN or not is_leaf(node):
        return node is not None
    ports = registry.ports_in(tag, element.attributes)
    return all(name in ports or is_reserved(name) for name in element.attributes)


def _stub(tag: str, base: type[TreeNode]) -> type[TreeNode]:
    return type("Stub", (base,), {"tag": tag, "children_min": 0, "__doc__": "Stands in for a node that is not here."})


def _elements(library: Library) -> Iterator[Element]:
    waiting = [child for tree in library.trees.values() for child in tree.children]
    while waiting:
        element = waiting.pop()
        waiting += element.children
        yield element
