"""What an editor asks about a tree file that is being written: what may stand here, what this is, where it is made.

The text may be unfinished anywhere, so that only what stands before the cursor, and around it, is read.
"""

from __future__ import annotations

import inspect
import re
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, replace
from enum import Enum
from pathlib import Path
from typing import Any, Literal

from btxml.engine.errors import Place
from btxml.engine.literals import STATUS_WORDS
from btxml.engine.node import TreeNode
from btxml.engine.ports import Port
from btxml.engine.script import Script
from btxml.engine.status import Status
from btxml.files.compile.registry import Registry, is_leaf, is_reserved, meaning_of
from btxml.files.parse.library import Library
from btxml.files.parse.replacing import REPLACES
from btxml.files.parse.xml_file import CONDITIONS, EXPLICIT, SCRIPTS_AFTER, Element, plain_files
from btxml.views.palette import node_text, port_line
from btxml.views.symbols import FILES_MOST, Symbol, Symbols

Kind = Literal["node", "port", "condition", "entry", "value", "tree"]
SCRIPTS = (*CONDITIONS, *SCRIPTS_AFTER)
LANGUAGE: Mapping[str, tuple[str, ...]] = {
    "root": ("BTCPP_format", "main_tree_to_execute", "project_name"),
    "include": ("path",),
    "BehaviorTree": ("ID", "_description", REPLACES),
}
_ATTRIBUTE = re.compile(r"""([^\s=<>"']+)\s*=\s*(?:"([^"]*)("?)|'([^']*)('?))""")
_ENTRY = re.compile(r"\{([^{}=]+)\}")
_ASSIGNED = re.compile(r"([^\W\d][\w./-]*)\s*:?=(?!=)")
_WORD = re.compile(r"(?:[\w@.:-]|/(?=[\w@.:-]))*")  # a slash that ends a tag is no part of its name
_GOES_ON, _EQUALS = re.compile(r"\w*\s*[^<\s]"), re.compile(r"\w*\s*=")  # of what is written there already


@dataclass(frozen=True)
class Offer:
    """Something that may stand where the cursor is.

    Attributes:
        label: the whole word.
        about: what it is, in a line.
        snippet: what is inserted, where that is more; $1, $2, ... are the places to fill in.
    """

    label: str
    kind: Kind
    about: str = ""
    snippet: str = ""


@dataclass(frozen=True)
class Spot:
    """Where a cursor stands.

    Attributes:
        tag: the element; empty between elements.
        attributes: its attributes, those behind the cursor, too.
        attribute: the one whose value the cursor is in; empty elsewhere.
        value: what stands before the cursor in that value, or in the name that is being written.
        in_tag: the element's own name is being written.
    """

    tag: str = ""
    attributes: Mapping[str, str] | None = None
    attribute: str = ""
    value: str = ""
    in_tag: bool = False

    @property
    def node(self) -> str:
        """The node that the element stands for."""
        return (self.attributes or {}).get("ID", "") if self.tag in EXPLICIT else self.tag


def spot_at(text: str, offset: int) -> Spot:
    """Where a cursor behind `offset` characters stands."""
    start = text.rfind("<", 0, offset)
    head = text[start + 1 : offset] if start >= 0 else ""
    if start < 0 or head.startswith(("!", "?", "/")) or text.rfind("<!--", 0, offset) > text.rfind("-->", 0, offset):
        return Spot()
    tag = re.match(r"[^\s/>]*", text[start + 1 :])
    assert tag
    if offset <= start + 1 + tag.end():
        return Spot(tag[0], {}, value=head, in_tag=True)
    body, cursor = text[start + 1 + tag.end() :], offset - start - 1 - tag.end()
    attributes: dict[str, str] = {}
    within: Spot | None = None
    position = 0
    for found in _ATTRIBUTE.finditer(body):
        if re.search(r"[<>]", body[position : found.start()]):
            break
        value_start, position = found.start(2 if found[2] is not None else 4), found.end()
        attributes[found[1]] = (found[2] or found[4] or "").partition("<")[0]
        if value_start <= cursor < found.end() or (value_start <= cursor == found.end() and not (found[3] or found[5])):
            within = Spot(tag[0], attributes, found[1], body[value_start:cursor])
    if within is not None:
        return within
    if ">" in _ATTRIBUTE.sub("", body[:cursor]):
        return Spot()
    return Spot(tag[0], attributes, value=re.split(r"\s", body[:cursor])[-1])


def offers(text: str, offset: int, path: Path, registry: Registry, library: Library) -> list[Offer]:
    """What may stand at the cursor in the text of a file."""
    spot = spot_at(text, offset)
    if spot.tag == "include" and spot.attribute == "path":
        return list(_files(spot.value, path))
    if spot.attribute:
        return list(_values(spot, text, offset, registry, library))
    if spot.in_tag or not spot.tag:
        found = list(_nodes(registry, "" if spot.in_tag else "<"))
        goes_on = _GOES_ON
    else:
        found = [port for port in _ports(spot, registry, library) if port.label not in (spot.attributes or {})]
        goes_on = _EQUALS
    return [replace(offer, snippet="") for offer in found] if goes_on.match(text, offset) else found


def hover(text: str, offset: int, registry: Registry, library: Library) -> str:
    """What stands at the cursor, in words; empty where there is nothing to say."""
    spot = _whole(text, offset)
    if spot.tag == "SubTree" and (spot.in_tag or spot.attribute == "ID"):
        identifier = _tag_attributes(text, offset).get("ID", "")
        tree = library.trees.get(identifier)
        if tree is None:
            return ""
        ports = [f"    {port.direction} {name}" for name, port in library.models.get(identifier, {}).items()]
        return "\n".join([f"{identifier}  [SubTree]", *filter(None, [tree.get("_description")]), *ports])
    if spot.in_tag or (spot.tag in EXPLICIT and spot.attribute == "ID"):
        return node_text(spot.node, registry) if spot.node in registry.classes else ""
    port = _port(spot, registry)
    return port_line(port).strip() if port is not None else ""


def definition(text: str, offset: int, path: Path, registry: Registry, library: Library) -> Place | None:
    """Where what stands at the cursor is made: a tree, an included file, or a node's Python."""
    spot, attributes = _whole(text, offset), _tag_attributes(text, offset)
    if spot.tag == "include":
        return Place((path.parent / attributes.get("path", "")).resolve(), 1, 1)
    identifier = attributes.get("ID", "")
    if spot.tag == "SubTree":
        tree = library.trees.get(identifier)
        return None if tree is None else tree.place
    node = registry.classes.get(identifier if spot.tag in EXPLICIT else spot.tag)
    return None if node is None else made_at(node)


def prefix_start(text: str, offset: int) -> int:
    """Where what an offer takes the place of begins: the part of a word that stands before the cursor."""
    return offset - len(re.search(r"[\w@./-]*\Z", text[max(0, offset - 200) : offset])[0])  # type: ignore[index]


def word_end(text: str, offset: int) -> int:
    """The end of the word, or of the element's name, that begins at an offset; never before the next character."""
    found = _WORD.match(text, offset + text.startswith("<", offset))
    return max(offset + 1, found.end() if found else 0)


def _whole(text: str, offset: int) -> Spot:
    """The spot at the end of the word that the cursor is in; a name stands for its attribute."""
    found = _WORD.match(text, offset)
    spot = spot_at(text, found.end() if found else offset)
    return spot if spot.attribute or spot.in_tag else replace(spot, attribute=spot.value)


def _tag_attributes(text: str, offset: int) -> Mapping[str, str]:
    """All attributes of the element around the cursor."""
    start = text.rfind("<", 0, offset)
    body = text[start : min(filter(lambda end: end > 0, (text.find("<", offset), len(text))))]
    return {found[1]: found[2] or found[4] or "" for found in _ATTRIBUTE.finditer(body)}


def _nodes(registry: Registry, lead: str) -> Iterator[Offer]:
    for tag, node in registry.classes.items():
        needed = [port.name for port in registry.ports(tag).values() if not port.optional]
        ports = "".join(f' {name}="${number}"' for number, name in enumerate(needed, 1))
        rest = "/>" if is_leaf(node) else f">$0</{tag}>"
        yield Offer(tag, "node", f"{node.node_type}: {meaning_of(node)}", f"{lead}{tag}{ports}{rest}")
    yield Offer("SubTree", "node", "Run another tree", f'{lead}SubTree ID="$1"/>')


def _ports(spot: Spot, registry: Registry, library: Library) -> Iterator[Offer]:
    if spot.tag in LANGUAGE:
        yield from (Offer(name, "port", snippet=f'{name}="$1"') for name in LANGUAGE[spot.tag])
        return
    if spot.tag in registry.classes or spot.node in registry.classes:
        for port in registry.ports(spot.node).values():
            yield Offer(port.name, "port", port_line(port).strip(), f'{port.name}="$1"')
    identifier = (spot.attributes or {}).get("ID", "")
    if spot.tag == "SubTree":
        named = {
            mention.symbol.entry
            for mention in _symbols(registry, library).mentions
            if mention.symbol.tree == identifier
        }
        names = {*library.models.get(identifier, {}), *named} - {""}
        yield from (Offer(name, "entry", f"an entry of {identifier}", f'{name}="{{$1}}"') for name in sorted(names))
        yield from (Offer(name, "port", snippet=f'{name}="$1"') for name in ("ID", "_autoremap"))
    yield from (Offer(name, "condition", snippet=f'{name}="$1"') for name in ("name", *SCRIPTS))


def _values(spot: Spot, text: str, offset: int, registry: Registry, library: Library) -> Iterator[Offer]:
    if spot.attribute == "main_tree_to_execute" or (spot.attribute, spot.tag) == ("ID", "SubTree"):
        yield from (Offer(name, "tree") for name in library.trees)
    elif spot.attribute == "ID" and spot.tag in EXPLICIT:
        yield from (Offer(tag, "node", meaning_of(node)) for tag, node in registry.classes.items())
    else:
        yield from _values_of_port(spot, text, offset, registry, library)


def _values_of_port(spot: Spot, text: str, offset: int, registry: Registry, library: Library) -> Iterator[Offer]:
    port = _port(spot, registry)
    entries = [*sorted(_entries_around(text, offset)), *(f"@{name}" for name in registry.entries)]
    if spot.attribute in SCRIPTS or (port is not None and port.kind is Script):
        yield from (Offer(name, "entry") for name in entries)
        yield from (Offer(name, "value", "an enum's name") for name in registry.enums)
    elif port is not None and port.names_entry:
        yield from (Offer(name, "entry") for name in entries)
    elif "{" in spot.value:
        closing = "" if text.startswith("}", offset) else "}"
        yield from (Offer(name, "entry", snippet=name + closing) for name in entries)
    elif spot.tag == "SubTree" and not is_reserved(spot.attribute):
        yield from (Offer(word, "value") for word in _words_inside(spot, registry, library))
        yield from (Offer(f"{{{name}}}", "entry") for name in entries)
    elif port is not None:
        if port.direction == "input":
            yield from (Offer(word, "value") for word in _literals(port.kind, registry))
        yield from (Offer(f"{{{name}}}", "entry") for name in entries)


def _words_inside(spot: Spot, registry: Registry, library: Library) -> Iterable[str]:
    """Words that ports inside a SubTree take, which read what this attribute hands in."""
    inner = _symbols(registry, library).ports(Symbol((spot.attributes or {}).get("ID", ""), spot.attribute))
    return dict.fromkeys(word for port in inner if port.direction == "input" for word in _literals(port.kind, registry))


def _files(before: str, path: Path) -> Iterator[Offer]:
    """Tree files beside a file and below, or in the folder that is written so far."""
    lead = before.rpartition("/")[0]
    folder = path.parent / lead
    for file in plain_files(folder, "**/*.xml")[:FILES_MOST] if folder.is_dir() else ():
        if file.resolve() != path.resolve():
            name = f"{lead}/{file.relative_to(folder).as_posix()}" if lead else file.relative_to(folder).as_posix()
            yield Offer(name, "tree")


def _symbols(registry: Registry, library: Library) -> Symbols:
    """What the trees of a library mention, as far as they can be read."""
    trees = [*library.trees.values()]
    return Symbols({tree.place.file: Element("root", tree.place, {}, trees) for tree in trees[:1]}, registry)


def _literals(kind: Any, registry: Registry) -> Iterable[str]:
    """The words that a port takes, where there are only a few."""
    if kind is bool:
        return ("true", "false")
    if kind is Status:
        return STATUS_WORDS
    if isinstance(kind, type) and issubclass(kind, Enum):
        return kind.__members__
    item = getattr(kind, "__args__", (kind,))[0]  # of a list
    words = registry.words.get(item, ()) if isinstance(item, type) else ()
    return words if not hasattr(item, "from_text") else [f"{word}: " for word in words]


def _port(spot: Spot, registry: Registry) -> Port | None:
    if spot.node not in registry.classes or not spot.attribute or is_reserved(spot.attribute):
        return None
    return registry.ports_in(spot.node, [spot.attribute]).get(spot.attribute)


def _entries_around(text: str, offset: int) -> set[str]:
    """Entries that the BehaviorTree around the cursor names, as far as it is written."""
    start, end = text.rfind("<BehaviorTree", 0, offset), text.find("</BehaviorTree>", offset)
    around = text[max(0, start) : end if end >= 0 else len(text)]
    found = set(_ENTRY.findall(around))
    for attribute in _ATTRIBUTE.finditer(around):
        if attribute[1] in (*SCRIPTS, "code", "if"):
            found.update(_ASSIGNED.findall(attribute[2] or attribute[4] or ""))
    return found


def made_at(node: type[TreeNode]) -> Place | None:
    """Where the class of a node stands; None where it has no source."""
    try:
        file, (_, line) = inspect.getsourcefile(node), inspect.getsourcelines(node)
    except (OSError, TypeError):  # made by another class, or its file has gone
        return None
    return None if file is None else Place(Path(file), line, 1)
