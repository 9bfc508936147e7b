"""Trees and entries by name across files: where each is mentioned, what a rename changes, and a file's outline."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Literal, NamedTuple

from btxml.engine.blackboard import Scope
from btxml.engine.errors import Place, TreeFileError
from btxml.engine.ports import Port
from btxml.engine.script import Script, ScriptError, parse_script
from btxml.files.compile.registry import Registry, is_reserved
from btxml.files.parse.replacing import REPLACES
from btxml.files.parse.xml_file import (
    CONDITIONS,
    KEY,
    SCRIPTS_AFTER,
    Attribute,
    Element,
    autoremaps,
    entry_name,
    node_tag,
    plain_files,
    read_xml,
)
from btxml.views.show import label

FILES_MOST = 500  # of a folder that are searched for mentions

Role = Literal["made", "written", "read", "passed"]
ROLES: tuple[Role, ...] = ("made", "written", "read", "passed")


class Symbol(NamedTuple):
    """A tree, or an entry of its blackboard; an entry named with @ belongs to the main tree."""

    tree: str
    entry: str = ""


@dataclass(frozen=True)
class Mention:
    """A place that names a symbol.

    Attributes:
        length: of the name in characters.
        role: what happens there; a SubTree's attribute passes an entry.
        by: the element, for people.
        port: that reads or writes the entry; None for scripts and SubTrees.
        passes: entry of the called tree that a SubTree joins to this one.
        new: the text that takes the name's place when it is renamed; {} stands for the new name.
    """

    symbol: Symbol
    place: Place
    length: int
    role: Role
    by: str
    port: Port | None = None
    passes: Symbol | None = None
    new: str = "{}"


class Symbols:
    """All mentions in some files.

    Args:
        roots: elements of files, by path.
        main: tree whose entries are named with @.
    """

    def __init__(self, roots: Mapping[Path, Element], registry: Registry, main: str = "") -> None:
        self._registry = registry
        self.main = main or next((name for root in roots.values() if (name := root.get("main_tree_to_execute"))), "")
        self._joined: list[tuple[str, str, frozenset[str] | str]] = []
        self.replaced: set[str] = set()
        self.mentions = [mention for root in roots.values() for mention in self._of_file(root)]

    def at(self, file: Path, line: int, column: int) -> Symbol | None:
        """What is named at a place; lines and columns count from 1."""
        for mention in self.mentions:
            place, begins = mention.place, mention.place.column or 1
            if place.line == line and begins <= column <= begins + mention.length and place.file.resolve() == file:
                return mention.symbol
        return None

    def of(self, symbol: Symbol) -> list[Mention]:
        """All mentions of a symbol, and of the entries of other trees that are joined to it under the same name."""
        same = self._same(symbol)
        return [mention for mention in self.mentions if mention.symbol in same]

    def made(self, symbol: Symbol) -> Mention | None:
        """Where a tree stands, or an entry is first written, read where nothing writes it, or passed."""
        return min(self.of(symbol), key=lambda mention: ROLES.index(mention.role), default=None)

    def ports(self, symbol: Symbol) -> Iterator[Port]:
        """Ports that an entry reaches, also in the trees that it is passed to."""
        known, waiting = set[Symbol](), [symbol]
        while waiting:
            if (current := waiting.pop()) in known:
                continue
            known.add(current)
            for mention in (mention for mention in self.mentions if mention.symbol in self._same(current)):
                yield from [mention.port] if mention.port is not None else []
                waiting += [mention.passes] if mention.passes is not None else []

    def renamed(self, symbol: Symbol, name: str) -> list[tuple[Mention, str]]:
        """Mentions, and the text that takes the place of each.

        Raises:
            TreeFileError: the name cannot be given, or is another's.
        """
        same = self._same(symbol)
        taken = [
            mention.symbol for mention in self.mentions if mention.symbol in {replace_name(old, name) for old in same}
        ]
        if not (KEY.match(name) if symbol.entry else name.strip()) or name.startswith("@") or set('"<>&') & set(name):
            raise TreeFileError(f"{name!r} is not a name; letters, digits, _ and - are legal")
        if symbol.tree in self.replaced and not symbol.entry:
            raise TreeFileError(f"'{symbol.tree}' replaces what has its name, and so keeps it")
        if taken and name not in symbol:
            where = f" in {taken[0].tree}" if symbol.entry else ""
            raise TreeFileError(f"there is a '{name}' already{where}")
        return [(mention, mention.new.format(name)) for mention in self.of(symbol)]

    def _same(self, symbol: Symbol) -> set[Symbol]:
        same, waiting = {symbol}, [symbol]
        while waiting:
            tree, entry = waiting.pop()
            for outer, inner, names in self._joined if entry else ():
                joined = entry == names if isinstance(names, str) else not entry.startswith("_") and entry not in names
                for one, other in ((outer, inner), (inner, outer)):
                    if joined and tree == one and (new := Symbol(other, entry)) not in same:
                        same.add(new)
                        waiting.append(new)
        return same

    def _of_file(self, root: Element) -> Iterator[Mention]:
        yield from self._whole(root, "main_tree_to_execute", "read")
        for top in root.children:
            if top.tag == "BehaviorTree":
                tree = top.get("ID") or ""
                self.replaced |= {tree} if REPLACES in top.attributes else set()
                yield from self._whole(top, "ID", "made")
                for element in _below(top):
                    yield from self._of_node(element, tree)
            elif top.tag == "TreeNodesModel":
                for model in (child for child in top.children if child.tag == "SubTree"):
                    yield from self._whole(model, "ID", "read")
                    for port in model.children:
                        yield from self._whole(port, "name", "passed", model.get("ID") or "")

    def _whole(self, element: Element, name: str, role: Role, tree: str | None = None) -> Iterator[Mention]:
        """An attribute whose value is a name as a whole."""
        if (found := element.attributes.get(name)) is not None and found.value:
            symbol = Symbol(found.value) if tree is None else Symbol(tree, found.value)
            yield Mention(symbol, found.value_place, len(found.source), role, label(element))

    def _of_node(self, element: Element, tree: str) -> Iterator[Mention]:
        tag, called = node_tag(element), element.get("ID") or ""
        ports: Mapping[str, Port] = {}
        if tag == "SubTree":
            yield from self._whole(element, "ID", "read")
            if autoremaps(element):
                self._joined.append((tree, called, frozenset(element.attributes)))
        elif tag in self._registry.classes:
            ports = self._registry.ports_in(tag, element.attributes)
        for name, attribute in element.attributes.items():
            port = ports.get(name)
            if name in (*CONDITIONS, *SCRIPTS_AFTER) or (port is not None and port.kind is Script):
                yield from self._of_script(attribute, element, tree)
            elif tag == "SubTree" and not is_reserved(name):
                yield Mention(Symbol(called, name), attribute.place, len(name), "passed", label(element))
                if entry_name(attribute.value, "=") == "=":
                    self._joined.append((tree, called, name))
                else:
                    for mention in self._pointer(attribute, name, element, tree, "read"):
                        yield replace(mention, passes=Symbol(called, name))
            elif not is_reserved(name):
                role: Role = "read" if port is None or port.direction == "input" else "written"
                for mention in self._pointer(
                    attribute, name, element, tree, role, port is not None and port.names_entry
                ):
                    yield replace(mention, port=port)

    def _pointer(
        self, attribute: Attribute, name: str, element: Element, tree: str, role: Role, bare: bool = False
    ) -> Iterator[Mention]:
        entry = entry_name(attribute.value, name, bare)
        if entry is None:
            return
        shown = "=" if attribute.value.strip() == "{=}" else entry  # renamed, it is spelt out: the port keeps its name
        place = attribute.place_at(attribute.value.index(shown))
        yield self._mention(tree, entry, place, len(shown), role, element)

    def _mention(self, tree: str, entry: str, place: Place, length: int, role: Role, element: Element) -> Mention:
        if not entry.startswith("@"):
            return Mention(Symbol(tree, entry), place, length, role, label(element))
        return Mention(Symbol(self.main or "@", entry[1:]), place, length, role, label(element), new="@{}")

    def _of_script(self, attribute: Attribute, element: Element, tree: str) -> Iterator[Mention]:
        try:
            uses = parse_script(attribute.value, Scope(), self._registry.enums).uses
        except ScriptError:
            return
        for use in uses:
            role: Role = "written" if use.sign else "read"
            yield self._mention(tree, use.name, attribute.place_at(use.offset), len(use.name), role, element)


def replace_name(symbol: Symbol, name: str) -> Symbol:
    """The symbol under another name."""
    return symbol._replace(entry=name) if symbol.entry else symbol._replace(tree=name)


def related(path: Path, folder: Path | None, texts: Mapping[Path, str]) -> dict[Path, Element]:
    """A file, and all of a folder that include it or are included by it, over however many files; what can be read.

    Args:
        texts: those that are known, which count instead of files, by absolute path.
    """
    files = {path, *texts, *([] if folder is None else plain_files(folder, "**/*.xml")[:FILES_MOST])}
    roots: dict[Path, Element] = {}
    for file in {path.resolve() for path in files}:
        try:
            roots[file] = read_xml(file, texts.get(file))[1]
        except TreeFileError:
            continue  # `cell check` says what is wrong with it
    beside = {file: {*_included(file, root)} for file, root in roots.items()}
    found, waiting = {path: roots[path]} if path in roots else {}, [path]
    while waiting:
        file = waiting.pop()
        near = beside.get(file, set()) | {other for other, names in beside.items() if file in names}
        for other in sorted((near | set(texts)) & set(roots) - set(found)):
            found[other] = roots[other]
            waiting.append(other)
    return found


def _included(file: Path, root: Element) -> Iterator[Path]:
    for element in root.children:
        if element.tag == "include" and (name := element.get("path")):
            yield (file.parent / name).resolve()


def links(root: Element, file: Path) -> Iterator[tuple[Attribute, Path]]:
    """What a file includes: the attribute that names a file, and that file."""
    for element in root.children:
        if element.tag == "include" and (found := element.attributes.get("path")) is not None and found.value:
            yield found, (file.parent / found.value).resolve()


@dataclass(frozen=True)
class Heading:
    """A tree or node of an outline.

    Attributes:
        end: where what follows it begins; None for the end of the file.
    """

    element: Element
    title: str
    end: Place | None
    below: Sequence[Heading]


def outline(root: Element) -> list[Heading]:
    """The trees of a file with their nodes."""
    trees = [top for top in root.children if top.tag == "BehaviorTree"]
    following = [*(child.place for child in root.children), None]
    return [_heading(tree, following[root.children.index(tree) + 1]) for tree in trees]


def _heading(element: Element, end: Place | None) -> Heading:
    """From the bottom up, as files may nest deeply."""
    made: dict[int, Heading] = {}
    waiting = [(element, end, False)]
    while waiting:
        node, after, below_done = waiting.pop()
        if below_done:
            title = node.get("ID") or "" if node.tag == "BehaviorTree" else label(node)
            made[id(node)] = Heading(node, title, after, [made[id(child)] for child in node.children])
            continue
        ends = [*(child.place for child in node.children[1:]), after]
        waiting.append((node, after, True))
        waiting += [(child, then, False) for child, then in zip(node.children, ends, strict=False)]
    return made[id(element)]


def _below(tree: Element) -> Iterator[Element]:
    waiting: list[Element] = [*reversed(tree.children)]
    while waiting:
        element = waiting.pop()
        yield element
        waiting += reversed(element.children)
