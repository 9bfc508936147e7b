"""Children that are never ticked, because what stands before them never lets the parent go on.

For every node the set of results that it can end with is worked out from the bottom up. What each node makes of its
children's results, and which of them bars which, its class says (`results`, `barrier`).
"""

from __future__ import annotations

from cell.interfaces.errors import Problem
from trees.engine.decorators import SubTree
from trees.engine.node import FAILURE, SKIPPED, SUCCESS
from trees.engine.status import ANY, EITHER, Results
from trees.files.library import Library, bottom_up, called
from trees.files.registry import Registry
from trees.files.xml_file import Element, node_tag

_ADDED = {"_failureIf": FAILURE, "_successIf": SUCCESS, "_skipIf": SKIPPED, "_while": SKIPPED}
_WORDS = {SUCCESS: "succeeds", FAILURE: "fails", SKIPPED: "is skipped"}


def check_reach(library: Library, registry: Registry) -> list[Problem]:
    """The first child that is never ticked, of every node; for a library without other problems."""
    reach = _Reach(registry)
    for element in bottom_up(library):
        reach.take(element, called(library, element))
    return reach.problems


class _Reach:
    """The results of all nodes taken so far."""

    def __init__(self, registry: Registry) -> None:
        self._registry = registry
        self._ends: dict[int, Results] = {}
        self.problems: list[Problem] = []

    def take(self, element: Element, children: list[Element]) -> None:
        """Work out a node's results from those of its children."""
        added = {status for name, status in _ADDED.items() if name in element.attributes}
        self._ends[id(element)] = self._results(element, [self._ends[id(child)] for child in children]) | added

    def _results(self, element: Element, below: list[Results]) -> Results:
        tag = node_tag(element)
        node = SubTree if element.tag == "SubTree" else self._registry.classes.get(tag)
        if element.broken or node is None:
            return ANY
        barriers = ((index, node.barrier(index, below)) for index in range(1, len(element.children)))
        for index, barrier in barriers:
            if barrier is not None:
                self._unreachable(element.children[index], element.children[barrier], below[barrier])
                break
        values = {name: attribute.value for name, attribute in element.attributes.items()}
        ports = {} if node is SubTree else self._registry.ports(tag)
        unset = {FAILURE} if any("{" in values.get(name, "") for name in ports) else set()
        return node.results(below, values) | unset

    def _unreachable(self, child: Element, before: Element, ends: Results) -> None:
        does = "always " + " or ".join(_WORDS[status] for status in EITHER if status in ends) if ends else "never ends"
        what = f"{node_tag(child)} is never ticked: {node_tag(before)} at line {before.place.line} before it {does}"
        self.problems.append(Problem(child.place, what, "remove it, or let the node before it end otherwise"))
