"""A tree file as text (`cell show FILE`)."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from pathlib import Path

from btxml.engine.errors import TreeFileError
from btxml.files.compile.registry import Registry
from btxml.files.loader import find_mistakes, in_order
from btxml.files.parse.library import Library, read_library
from btxml.files.parse.xml_file import Element, node_tag


def show_file(path: Path, registry: Registry, beside: Iterable[Path] = ()) -> str:
    """Every tree of a file, the main one first, with the connections of its ports.

    Args:
        beside: further files, and folders with them, whose trees it may name.

    Raises:
        TreeFileError: everything that is wrong with the file.
    """
    library = read_checked(path, registry, beside)
    return "\n\n".join("\n".join(_tree_lines(library, identifier)) for identifier in reading_order(library)) + "\n"


def read_checked(path: Path, registry: Registry, beside: Iterable[Path] = ()) -> Library:
    """The trees of a file, free of mistakes in their structure.

    Raises:
        TreeFileError: everything that is wrong.
    """
    library = read_library(path, beside)
    if problems := find_mistakes(library, registry):
        raise TreeFileError(*in_order(problems))
    return library


def label(element: Element) -> str:
    """What an element is: its node, the SubTree it stands for, and its name."""
    tag = node_tag(element)
    words = [f"SubTree {element.get('ID')}" if tag == "SubTree" else tag]
    if name := element.get("name"):
        words.append(f'"{name}"')
    return " ".join(words)


def connections(element: Element) -> list[str]:
    """Its ports and conditions as the file writes them."""
    explicit = element.tag != node_tag(element) or element.tag == "SubTree"
    hidden = ("name", "ID") if explicit else ("name",)
    return [f"{name}={attribute.value}" for name, attribute in element.attributes.items() if name not in hidden]


def _tree_lines(library: Library, identifier: str) -> Iterator[str]:
    main = "  (main tree)" if identifier == library.main else ""
    yield f"{identifier}{main}"
    waiting = [(child, *_branch("", True)) for child in library.trees[identifier].children]
    while waiting:
        element, lead, below = waiting.pop()
        yield "  ".join([lead + label(element), *connections(element)])
        children = element.children
        waiting += reversed([(child, *_branch(below, child is children[-1])) for child in children])


def _branch(below: str, last: bool) -> tuple[str, str]:
    """What stands before a node, and before everything below it."""
    return (below + "└─ ", below + "   ") if last else (below + "├─ ", below + "│  ")


def reading_order(library: Library, unused: bool = True) -> list[str]:
    """The main tree, then every tree where it is first used, then those that nothing uses."""
    order: list[str] = []
    waiting = [library.main] if library.main else []
    while waiting:
        identifier = waiting.pop(0)
        if identifier not in order:
            order.append(identifier)
            waiting += _subtree_names(library.trees[identifier])
    return order + [identifier for identifier in library.trees if unused and identifier not in order]


def _subtree_names(tree: Element) -> Iterator[str]:
    waiting = [tree]
    while waiting:
        element = waiting.pop()
        if element.tag == "SubTree":
            yield element.get("ID") or ""
        waiting += reversed(element.children)
