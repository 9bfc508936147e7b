"""Trees that take the place of others: `<BehaviorTree ID="PickPart" _replaces="true">`.

Wherever the name is called, the replacing tree runs: for a tree of an included file, and for a node of Python. In the
replacing tree itself the name means what it replaces, so that "retry around PickPart" is five lines.
"""

from __future__ import annotations

from collections.abc import Iterator

from btxml.files.parse.xml_file import Attribute, Element, node_tag

REPLACES = "_replaces"


def original_of(identifier: str) -> str:
    """The name under which a replaced tree is kept."""
    return f"{identifier} (replaced)"


def replace_nodes(trees: dict[str, Element], replacing: dict[str, Element]) -> None:
    """Let what calls a replaced name call the tree that replaces it.

    Args:
        trees: all trees by ID; a tree that is replaced is there under `original_of`.
        replacing: by ID, the trees that replace one or a node.
    """
    for identifier, tree in replacing.items():
        if original_of(identifier) in trees:
            for element in _below(tree):
                if element.tag == "SubTree" and element.get("ID") == identifier:
                    _call(element, original_of(identifier))
            continue
        for other in trees.values():
            for element in _below(other) if other is not tree else ():
                if element.tag != "SubTree" and node_tag(element) == identifier and not element.children:
                    element.tag = "SubTree"
                    _call(element, identifier)


def _call(element: Element, identifier: str) -> None:
    place = element.place_of("ID")
    element.attributes["ID"] = Attribute(identifier, place, place, identifier)


def _below(tree: Element) -> Iterator[Element]:
    waiting = list(tree.children)
    while waiting:
        element = waiting.pop()
        waiting += element.children
        yield element
