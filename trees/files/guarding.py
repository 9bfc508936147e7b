"""Whether a guard stands above every node that must not run without one, in every tree that can call it.

A guard stands above a node where a ReactiveSequence, or the condition of a WhileDoElse, asks it again in every tick
while the node runs. It counts only where the node cannot be reached past it: a guard under ForceSuccess or Inverter,
in one of several alternatives, or with a `_skipIf`, is none.
"""

from __future__ import annotations

from collections.abc import Iterator

from cell.interfaces.errors import Problem
from trees.engine.node import TreeNode
from trees.files.library import Library, bottom_up, called
from trees.files.registry import Registry
from trees.files.xml_file import Element, node_tag

_ALL_SUCCEED = ("Sequence", "ReactiveSequence")
_ONE_SUCCEEDS = ("Fallback", "ReactiveFallback")
_NEVER_SUCCEED = ("AlwaysFailure", "ForceFailure", "KeepRunningUntilFailure")
_BYPASSES = ("_skipIf", "_successIf", "_while")


def check_guards(library: Library, registry: Registry) -> list[Problem]:
    """Nodes that need a guard and have none on some way from a tree that no other one calls."""
    finder = _Finder(library, registry)
    used = {element.get("ID") for element in bottom_up(library) if element.tag == "SubTree"}
    for identifier, tree in library.trees.items():
        if identifier not in used or identifier == library.main:
            finder.visit(tree)
    return finder.problems


class _Finder:
    """Walks down, and remembers which trees were walked with and without a guard above."""

    def __init__(self, library: Library, registry: Registry) -> None:
        self._library = library
        self._registry = registry
        self._visited: set[tuple[int, bool]] = set()
        self._guarding: set[int] = set()
        for element in bottom_up(library):
            if self._is_guard(element):
                self._guarding.add(id(element))
        self._legal = ", ".join(tag for tag, node in registry.classes.items() if node.guards)
        self.problems: list[Problem] = []

    def visit(self, tree: Element) -> None:
        """Walk a tree that runs without any guard above it."""
        waiting = [(child, False) for child in tree.children]
        while waiting:
            element, guarded = waiting.pop()
            if (id(element), guarded) in self._visited:
                continue
            self._visited.add((id(element), guarded))
            if element.tag != "SubTree" and self._needs_guard(element) and not guarded:
                what = f"{node_tag(element)} runs without a guard that is asked in every tick"
                legal = f"put it into a ReactiveSequence behind one of: {self._legal}"
                self.problems.append(Problem(element.place, what, legal))
            waiting += self._below(element, guarded)

    def _below(self, element: Element, guarded: bool) -> Iterator[tuple[Element, bool]]:
        """The children, and whether a guard stands above or before them."""
        tag, before = node_tag(element), guarded
        for index, child in enumerate(called(self._library, element)):
            yield child, before
            if tag == "ReactiveSequence" or (tag == "WhileDoElse" and index == 0):
                before = before or id(child) in self._guarding
            elif tag == "WhileDoElse":
                before = guarded

    def _is_guard(self, element: Element) -> bool:
        """Whether this node succeeds only after a guard has agreed; what is below it was asked before."""
        tag, children = node_tag(element), called(self._library, element)
        if element.broken:
            return True  # only what is certain is told
        if any(name in element.attributes for name in _BYPASSES):
            return False
        if element.tag == "SubTree" or tag in _ALL_SUCCEED:
            return any(id(child) in self._guarding for child in children)
        if tag in _ONE_SUCCEEDS:
            return all(node_tag(child) in _NEVER_SUCCEED or id(child) in self._guarding for child in children)
        return self._class(element).guards

    def _needs_guard(self, element: Element) -> bool:
        node = self._registry.classes.get(node_tag(element))
        return node is not None and node.needs_guard

    def _class(self, element: Element) -> type[TreeNode]:
        return self._registry.classes[node_tag(element)]
