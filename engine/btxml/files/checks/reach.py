"""Children that are never ticked, because what stands before them never lets the parent go on.

For every node the set of results that it can end with is worked out from the bottom up. What each node makes of its
children's results, and which of them bars which, the `traits` of its class say.
"""

from __future__ import annotations

from collections.abc import Iterator

from btxml.engine.decorators import SubTree
from btxml.engine.errors import Problem
from btxml.engine.node import FAILURE, SKIPPED, SUCCESS
from btxml.engine.status import ANY, EITHER, Results
from btxml.files.compile.registry import Registry
from btxml.files.parse.library import Library, bottom_up, called
from btxml.files.parse.xml_file import Element, node_tag

_ADDED = {"_failureIf": FAILURE, "_successIf": SUCCESS, "_skipIf": SKIPPED, "_while": SKIPPED}
_WORDS = {SUCCESS: "succeeds", FAILURE: "fails", SKIPPED: "is skipped"}


def check_claims(library: Library, registry: Registry) -> Iterator[Problem]:
    """Children of a Parallel that claim what an elder one claims, themselves or by what is below them."""
    claimed: dict[int, dict[str, Element]] = {}  # by element, what is claimed at or below it, and by which node
    for element in bottom_up(library):
        children = called(library, element)
        node = registry.classes.get(node_tag(element))
        taken: dict[str, Element] = {}
        for child in children:
            below = claimed[id(child)]
            both = next((name for name in below if name in taken), None)
            if both is not None and node is not None and node.traits.at_once and not element.broken:
                first = taken[both]
                what = f"{node_tag(below[both])} commands the {both} while {node_tag(first)} may"
                legal = f"{node_tag(first)} at {first.place} runs at the same time; put both into a Sequence"
                yield Problem(child.place, what, legal)
            taken = below | taken
        claimed[id(element)] = taken | dict.fromkeys(node.traits.claims if node is not None else (), element)


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
        barriers = ((index, node.traits.barrier(index, below)) for index in range(1, len(element.children)))
        for index, barrier in barriers:
            if barrier is not None:
                self._unreachable(element.children[index], element.children[barrier], below[barrier])
                break
        values = {name: attribute.value for name, attribute in element.attributes.items()}
        ports = {} if node is SubTree else self._registry.ports(tag)
        unset = {FAILURE} if any("{" in values.get(name, "") for name in ports) else set()
        return node.traits.results(below, values) | unset

    def _unreachable(self, child: Element, before: Element, ends: Results) -> None:
        does = "always " + " or ".join(_WORDS[status] for status in EITHER if status in ends) if ends else "never ends"
        what = f"{node_tag(child)} is never ticked: {node_tag(before)} at line {before.place.line} before it {does}"
        self.problems.append(Problem(child.place, what, "remove it, or let the node before it end otherwise"))
