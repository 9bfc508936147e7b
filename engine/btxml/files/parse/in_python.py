"""Trees that are written in Python: the same file that an editor would write, with the places of the Python lines."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from xml.etree import ElementTree

from btxml.engine.errors import Place
from btxml.engine.literals import to_text
from btxml.engine.node import TreeNode
from btxml.engine.ports import ports_of
from btxml.files.parse.xml_file import FORMAT, Attribute, Element


@dataclass(frozen=True)
class InPython:
    """A tree file that stands in no file.

    Attributes:
        path: the name under which its text is kept, such as in a log.
        nodes: of all its elements below the root, in order; None for a BehaviorTree.
    """

    path: Path
    text: str
    nodes: tuple[TreeNode | None, ...]

    def placed(self, root: Element) -> None:
        """Let all elements stand where they were made in Python."""
        place = Place(self.path)
        for element, node in zip(_below(root), self.nodes, strict=True):
            if node is not None:
                place = Place(Path(node._made.file), node._made.line)
            element.place = place
            for name, attribute in element.attributes.items():
                element.attributes[name] = Attribute(attribute.value, place, place, attribute.source)


def in_python(root: TreeNode, name: str = "Main", trees: Mapping[str, TreeNode] | None = None) -> InPython:
    """Write a tree, and those that its SubTrees call, as one file; nothing is checked yet."""
    file = ElementTree.Element("root", BTCPP_format=FORMAT, main_tree_to_execute=name)
    nodes: list[TreeNode | None] = []
    for identifier, top in {name: root, **(trees or {})}.items():
        nodes.append(None)
        _write(ElementTree.SubElement(file, "BehaviorTree", ID=identifier), top, nodes)
    ElementTree.indent(file)
    return InPython(Path(f"{name}.xml"), ElementTree.tostring(file, encoding="unicode") + "\n", tuple(nodes))


def classes_of(source: InPython) -> dict[str, type[TreeNode]]:
    """The classes of its nodes, by their names in XML."""
    return {_tag(node): type(node) for node in source.nodes if node is not None}


def _write(parent: ElementTree.Element, node: TreeNode, nodes: list[TreeNode | None]) -> None:
    names = {port.attribute: port.name for port in ports_of(type(node)).values()}
    given = {names.get(key, key): to_text(value) for key, value in node._made.attributes.items()}
    named = {} if node.name == _tag(node) else {"name": node.name}
    element = ElementTree.SubElement(parent, _tag(node), {**named, **given})
    nodes.append(node)
    for child in node.children:
        _write(element, child, nodes)


def _tag(node: TreeNode) -> str:
    return node.tag or type(node).__name__


def _below(element: Element) -> Iterator[Element]:
    for child in element.children:
        yield child
        yield from _below(child)
