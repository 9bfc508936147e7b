"""The nodes that tree files may name, for people (`cell nodes`), for editors (JSON) and for Groot2 (XML)."""

from __future__ import annotations

import textwrap
from collections.abc import Collection, Iterable, Iterator
from difflib import get_close_matches
from xml.sax.saxutils import quoteattr

from btxml.engine.blackboard import UNSET
from btxml.engine.errors import TreeFileError
from btxml.engine.literals import type_name
from btxml.engine.node import TreeNode
from btxml.engine.ports import Port
from btxml.engine.status import Status
from btxml.files.compile.registry import BUILT_IN, Registry, meaning_of

ORDER = ("Action", "Condition", "Control", "Decorator", "SubTree")
WIDTH = 110


def named(registry: Registry, text: str) -> tuple[str, ...]:
    """The node of this name, or all whose name or meaning has this text.

    Raises:
        TreeFileError: there is none; the message says which names are like it.
    """
    if text in registry.classes:
        return (text,)
    word = text.lower()
    found = tuple(tag for tag, node in registry.classes.items() if word in f"{tag} {meaning_of(node)}".lower())
    if not found:
        near = get_close_matches(text, registry.classes, 5, 0.5)
        legal = f"near to it: {', '.join(near)}" if near else ""
        raise TreeFileError("; ".join(filter(None, (f"there is no node {text!r}", legal, registry.remark))))
    return found


def palette_text(registry: Registry, chosen: Collection[str] | None = None) -> str:
    """Nodes by kind, the cell's own first: name, meaning, and a line for each port."""
    lines: list[str] = []
    for title, own in (("Nodes of this cell", True), ("Nodes of the language", False)):
        tags = [tag for tag in chosen or registry.classes if (registry.classes[tag] not in BUILT_IN) is own]
        if not tags:
            continue
        lines += [title, "=" * len(title)]
        for node_type in ORDER:
            for tag in sorted(tag for tag in tags if registry.classes[tag].node_type == node_type):
                lines += _node_lines(tag, registry)
        lines.append("")
    return "\n".join(lines)


def palette_list(registry: Registry, chosen: Collection[str] | None = None) -> list[dict[str, object]]:
    """Nodes as plain data."""
    return [
        {
            "name": tag,
            "type": node.node_type,
            "meaning": meaning_of(node),
            "built_in": node in BUILT_IN,
            "ports": [_port_data(port) for port in registry.ports(tag).values()],
        }
        for tag, node in registry.classes.items()
        if tag in (chosen or registry.classes)
    ]


def groot_model(registry: Registry) -> str:
    """A file whose TreeNodesModel Groot2 loads as its palette; built-in nodes it knows by itself."""
    head = ['<?xml version="1.0" encoding="UTF-8"?>', '<root BTCPP_format="4">']
    own = [tag for tag, node in registry.classes.items() if node not in BUILT_IN]
    return "\n".join([*head, *models(own, registry), "</root>", ""])


def models(tags: Iterable[str], registry: Registry) -> Iterator[str]:
    """Lines of a TreeNodesModel with these nodes."""
    yield "  <TreeNodesModel>"
    for tag in tags:
        yield from _model(tag, registry)
    yield "  </TreeNodesModel>"


def node_text(tag: str, registry: Registry) -> str:
    """A node for people: name, meaning, and a line for each port."""
    return "\n".join(_node_lines(tag, registry))


def port_line(port: Port) -> str:
    """A port for people."""
    arrow = {"input": "<-", "output": "->", "inout": "<>"}[port.direction]
    default = "" if port.default is UNSET else f" = {default_text(port)}"
    needed = "" if port.optional else ", mandatory"
    legal = f", {port.range}" if port.range else ""
    line = f"    {arrow} {port.name}: {type_name(port.kind)}{default}{needed}{legal}"
    return f"{line}  ({port.meaning})" if port.meaning else line


def _node_lines(tag: str, registry: Registry) -> Iterator[str]:
    node = registry.classes[tag]
    yield f"{tag}  [{node.node_type}]"
    yield from textwrap.wrap(meaning_of(node), WIDTH, initial_indent="    ", subsequent_indent="    ")
    yield from map(port_line, registry.ports(tag).values())
    yield from _further_line(node)


def _further_line(node: type[TreeNode]) -> Iterator[str]:
    """Ports that only the file names."""
    port = node.further_port("NAME")
    if port is not None:
        arrow = {"input": "<-", "output": "->", "inout": "<>"}[port.direction]
        yield f"    {arrow} any further name: {type_name(port.kind)}  ({port.meaning})"


def _port_data(port: Port) -> dict[str, object]:
    return {
        "name": port.name,
        "direction": port.direction,
        "type": type_name(port.kind),
        "default": default_text(port),
        "mandatory": not port.optional,
        **({"range": port.range} if port.range else {}),
        "meaning": port.meaning,
    }


def _model(tag: str, registry: Registry) -> Iterator[str]:
    """A node of a TreeNodesModel."""
    node = registry.classes[tag]
    yield f"    <{node.node_type} ID={quoteattr(tag)}>"
    yield f"      <MetadataFields><Metadata description={quoteattr(meaning_of(node))}/></MetadataFields>"
    for port in registry.ports(tag).values():
        written = default_text(port)
        default = "" if written is None else f" default={quoteattr(written)}"
        kind = quoteattr(type_name(port.kind))
        meaning = _escaped(port.meaning)
        name = f"{port.direction}_port"
        yield f"      <{name} name={quoteattr(port.name)} type={kind}{default}>{meaning}</{name}>"
    yield f"    </{node.node_type}>"


def default_text(port: Port) -> str | None:
    """A default as a tree file would write it; None where a port has none."""
    value = port.default
    if value is UNSET:
        return None
    if isinstance(value, Status):
        return value.name
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, list | tuple):
        return ";".join(str(item) for item in value)
    return str(getattr(value, "name", value))


def _escaped(text: str) -> str:
    return text.replace("&", "&amp;").replace("<", "&lt;").replace(">", "&gt;")
