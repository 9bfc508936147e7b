"""Whether two branches that run at once would command the same device."""

from __future__ import annotations

from collections.abc import Iterator

from cell.interfaces.errors import Problem
from trees.files.library import Library, bottom_up, called
from trees.files.registry import Registry
from trees.files.xml_file import Element, node_tag


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
            if both is not None and node is not None and node.at_once and not element.broken:
                first = taken[both]
                what = f"{node_tag(below[both])} commands the {both} while {node_tag(first)} may"
                legal = f"{node_tag(first)} at {first.place} runs at the same time; put both into a Sequence"
                yield Problem(child.place, what, legal)
            taken = below | taken
        claimed[id(element)] = taken | dict.fromkeys(node.claims if node is not None else (), element)
