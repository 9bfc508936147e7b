"""An XML schema (XSD 1.0) of tree files, from which editors complete nodes and ports and mark mistakes.

The rules are in: https://www.w3.org/TR/xmlschema-1/. It is as strict as one file alone allows: types of entries, and
what a whole tree does, are for `cell check`. Names of the configuration are offered, and any other passes: a schema may
be older than the configuration.
"""

from __future__ import annotations

from collections.abc import Iterable
from enum import Enum
from typing import Any
from xml.etree import ElementTree
from xml.etree.ElementTree import Element, SubElement

from btxml.engine.literals import FALSE_WORDS, STATUS_WORDS, TRUE_WORDS, has_literals, type_name
from btxml.engine.node import TreeNode
from btxml.engine.ports import Port
from btxml.engine.script import Script
from btxml.engine.status import Status
from btxml.engine.vocabulary import Words, is_word
from btxml.files.compile.registry import Registry, is_leaf, meaning_of
from btxml.files.parse.replacing import REPLACES
from btxml.files.parse.xml_file import CONDITIONS, EXPLICIT, FORMAT, NOTES, SCRIPTS_AFTER
from btxml.views.palette import default_text

XS = "{http://www.w3.org/2001/XMLSchema}"
ENTRY = r"\s*\{[^{}]*\}\s*"
NUMBERS = {int: "-?[0-9]+", float: r"-?([0-9]+\.?[0-9]*|\.[0-9]+)([eE][\-+]?[0-9]+)?"}


def tree_schema(registry: Registry, remark: str = "") -> str:
    """The schema for the nodes of a registry.

    Args:
        remark: who made it, for its first lines.
    """
    ElementTree.register_namespace("xs", XS[1:-1])
    schema = Element(f"{XS}schema", elementFormDefault="qualified")
    _document(schema, remark)
    _restricted(SubElement(schema, f"{XS}simpleType", name="entry"), pattern=ENTRY)
    _frame(schema)
    choice = SubElement(SubElement(schema, f"{XS}group", name="node"), f"{XS}choice")
    for tag in (*registry.classes, "SubTree", *EXPLICIT):
        SubElement(choice, f"{XS}element", ref=tag)
    for tag, node in registry.classes.items():
        _node(schema, tag, node, registry)
    ElementTree.indent(schema)
    return ElementTree.tostring(schema, encoding="unicode", xml_declaration=True) + "\n"


def _frame(schema: Element) -> None:
    """What stands around nodes, and SubTrees and nodes in the explicit form, of which the file alone says no ports."""
    root = _element(schema, "root", "A file of behaviour trees.")
    among = SubElement(root, f"{XS}choice", minOccurs="0", maxOccurs="unbounded")
    for tag in ("include", "BehaviorTree", "TreeNodesModel"):
        SubElement(among, f"{XS}element", ref=tag)
    _choice(_attribute(root, "BTCPP_format"), (FORMAT,))
    for name in ("main_tree_to_execute", "project_name"):
        _attribute(root, name, kind="xs:string")
    include = _element(schema, "include", "Read another file, too.")
    _attribute(include, "path", "its path from this file", kind="xs:string", use="required")
    tree = _element(schema, "BehaviorTree", "A tree, which a SubTree of its name runs.")
    SubElement(tree, f"{XS}group", ref="node")
    for name in ("ID", "_description", "_fullpath"):
        _attribute(tree, name, kind="xs:string")
    _choice(_attribute(tree, REPLACES, "it takes the place of what has its name"), TRUE_WORDS + FALSE_WORDS)
    models = _element(schema, "TreeNodesModel", "Ports of SubTrees, and what Groot2 shows of nodes.", mixed="true")
    within = SubElement(models, f"{XS}sequence")
    SubElement(within, f"{XS}any", processContents="skip", minOccurs="0", maxOccurs="unbounded")
    common = SubElement(schema, f"{XS}attributeGroup", name="common")
    for name in ("name", *CONDITIONS, *SCRIPTS_AFTER, *NOTES):
        _attribute(common, name, kind="xs:string")
    for tag in ("SubTree", *EXPLICIT):
        called = _element(schema, tag, "Run another tree." if tag == "SubTree" else f"A node: {tag} ID=...")
        if tag != "SubTree":
            SubElement(called, f"{XS}group", ref="node", minOccurs="0", maxOccurs="unbounded")
        _attribute(called, "ID", kind="xs:string", use="required")
        if tag == "SubTree":
            meaning = "all names mean those of the tree around it"
            _choice(_attribute(called, "_autoremap", meaning), TRUE_WORDS + FALSE_WORDS)
        _common(called, more=True)


def _node(schema: Element, tag: str, node: type[TreeNode], registry: Registry) -> None:
    element = _element(schema, tag, meaning_of(node))
    if not is_leaf(node):
        most = "unbounded" if node.children_max is None else str(node.children_max)
        SubElement(element, f"{XS}group", ref="node", minOccurs=str(node.children_min), maxOccurs=most)
    for port in registry.ports(tag).values():
        default = default_text(port)
        text = f"{port.direction}, {type_name(port.kind)}" + ("" if default is None else f" = {default}")
        attribute = _attribute(element, port.name, f"{text}: {port.meaning}" if port.meaning else text)
        attribute.set("use", "optional" if port.optional else "required")
        _value(attribute, port, registry.words)
    _common(element, more=node.further_port("NAME") is not None)


def _value(attribute: Element, port: Port, words: Words) -> None:
    """What may stand in an attribute: an entry, or a literal of the port's type."""
    kind: Any = port.kind
    if port.names_entry or port.takes_texts or kind is Script:
        attribute.set("type", "xs:string")
    elif port.direction != "input" or not has_literals(kind):
        attribute.set("type", "entry")
    elif kind is bool:
        _choice(attribute, TRUE_WORDS + FALSE_WORDS)
    elif kind is Status:
        _choice(attribute, STATUS_WORDS)
    elif kind in NUMBERS:
        _restricted(_beside_entry(attribute), pattern=NUMBERS[kind])
    elif isinstance(kind, type) and issubclass(kind, Enum):
        numbers = [str(member.value) for member in kind if isinstance(member.value, int)]
        _choice(attribute, dict.fromkeys([*kind.__members__, *numbers]))
    elif is_word(kind) and words.get(kind):
        _choice(attribute, words[kind], others="xs:string")
    else:
        attribute.set("type", "xs:string")


def _choice(attribute: Element, legal: Iterable[str], others: str = "entry") -> None:
    within = SubElement(_beside_entry(attribute, others), f"{XS}restriction", base="xs:string")
    for word in legal:
        SubElement(within, f"{XS}enumeration", value=word)


def _beside_entry(attribute: Element, others: str = "entry") -> Element:
    """The type of an attribute that takes an entry, too."""
    union = SubElement(SubElement(attribute, f"{XS}simpleType"), f"{XS}union", memberTypes=others)
    return SubElement(union, f"{XS}simpleType")


def _restricted(kind: Element, pattern: str) -> None:
    SubElement(SubElement(kind, f"{XS}restriction", base="xs:string"), f"{XS}pattern", value=pattern)


def _element(schema: Element, tag: str, meaning: str, **settings: str) -> Element:
    element = SubElement(schema, f"{XS}element", name=tag)
    _document(element, meaning)
    return SubElement(element, f"{XS}complexType", settings)


def _attribute(element: Element, name: str, meaning: str = "", kind: str = "", use: str = "optional") -> Element:
    settings = {"name": name, "use": use, **({"type": kind} if kind else {})}
    attribute = SubElement(element, f"{XS}attribute", settings)
    _document(attribute, meaning)
    return attribute


def _common(element: Element, more: bool) -> None:
    """What every node may say, and with `more` any attribute."""
    SubElement(element, f"{XS}attributeGroup", ref="common")
    if more:
        SubElement(element, f"{XS}anyAttribute", processContents="skip")


def _document(element: Element, text: str) -> None:
    if text:
        SubElement(SubElement(element, f"{XS}annotation"), f"{XS}documentation").text = text
