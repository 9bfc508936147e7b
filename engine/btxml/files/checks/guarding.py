"""Whether a guard stands above every node that must not run without one, in every tree that can call it.

A guard stands above a node where a node such as ReactiveSequence asks it again in every tick while the other runs: what
it is and does its class says (`traits`). It counts only where the
node cannot be reached past it: a guard under ForceSuccess or Inverter, in one of several alternatives, or with a
`_skipIf`, is none. Nor is one whose verdict may be old: followed in a Sequence by what runs on over several ticks, or,
for what a TryCatch does on a halt, any: a guard that no longer agrees is what halts it.
"""

from __future__ import annotations

from collections.abc import Iterator
from itertools import accumulate

from btxml.engine.choices import TryCatch
from btxml.engine.controls import ReactiveSequence
from btxml.engine.decorators import SubTree
from btxml.engine.errors import Problem
from btxml.engine.literals import FALSE_WORDS
from btxml.engine.node import SUCCESS, TreeNode
from btxml.engine.status import ANY
from btxml.files.compile.registry import Registry
from btxml.files.parse.library import Library, bottom_up, called
from btxml.files.parse.xml_file import Element, node_tag

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
        self._instant: set[int] = set()
        for element in bottom_up(library):
            if self._is_instant(element):
                self._instant.add(id(element))
            if self._is_guard(element):
                self._guarding.add(id(element))
        self._legal = ", ".join(tag for tag, node in registry.classes.items() if node.traits.guards)
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
        children = called(self._library, element)
        if guarded or element.broken:
            yield from ((child, guarded and not self._cleans_up(element, child)) for child in children)
            return
        stopping = [0, *accumulate(self._stops(element, child) for child in children)]  # of the first n children
        asked = self._class(element).traits.asked_before
        for index, child in enumerate(children):
            before = asked(index)
            yield child, stopping[before.stop] > stopping[before.start]

    def _cleans_up(self, element: Element, child: Element) -> bool:
        """Whether a child is begun because its parent is halted."""
        halts = element.get("catch_on_halt") not in (None, *FALSE_WORDS)
        return halts and not element.broken and self._class(element) is TryCatch and child is element.children[-1]

    def _stops(self, element: Element, child: Element) -> bool:
        """Whether a child that does not agree stops the others at once; a WhileDoElse lets them be while it runs."""
        reactive = issubclass(self._class(element), ReactiveSequence)
        return id(child) in self._guarding and (reactive or id(child) in self._instant)

    def _is_guard(self, element: Element) -> bool:
        """Whether this node succeeds only after a guard has agreed; what is below it was asked before."""
        children = called(self._library, element)
        if element.broken:
            return True  # only what is certain is reported
        if any(name in element.attributes for name in _BYPASSES):
            return False
        traits = self._class(element).traits
        if traits.succeeds_after == "all":
            return self._last_asked(element, children)
        if traits.succeeds_after == "one":
            return all(id(child) in self._guarding or self._fails(child) for child in children)
        return traits.guards

    def _last_asked(self, element: Element, children: list[Element]) -> bool:
        """A guard among children that must all succeed, whose verdict is of the same tick as the last one's."""
        traits = self._class(element).traits
        again = traits.asked_before(len(children) - 1)
        for index in reversed(range(len(children))):
            if id(children[index]) in self._guarding:
                return True
            at_once = traits.instant and id(children[index]) in self._instant  # an AsyncSequence pauses between two
            if not at_once and index - 1 not in again:
                return False
        return False

    def _fails(self, element: Element) -> bool:
        """Whether no SUCCESS comes from it, whatever is below."""
        if element.broken or "_successIf" in element.attributes:
            return False
        below = [ANY] * len(called(self._library, element))
        return SUCCESS not in self._class(element).traits.results(below, {})

    def _is_instant(self, element: Element) -> bool:
        if element.broken:
            return True
        below = all(id(child) in self._instant for child in called(self._library, element))
        return below and self._class(element).traits.instant

    def _needs_guard(self, element: Element) -> bool:
        node = self._registry.classes.get(node_tag(element))
        return node is not None and node.traits.needs_guard

    def _class(self, element: Element) -> type[TreeNode]:
        return SubTree if element.tag == "SubTree" else self._registry.classes[node_tag(element)]
