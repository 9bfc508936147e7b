"""What can be wrong with a tree before any node is made: names, attributes, literals, children, recursion."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from btxml.engine.blackboard import Scope
from btxml.engine.errors import Place, Problem
from btxml.engine.literals import LiteralError, from_text, has_literals, type_name
from btxml.engine.node import TreeNode
from btxml.engine.ports import Port
from btxml.engine.script import Script, ScriptError, parse_script
from btxml.engine.vocabulary import misnomer
from btxml.files.checks.guarding import check_guards
from btxml.files.compile.registry import BUILT_IN, Registry
from btxml.files.parse.library import PROBLEM_LIMIT, Library, hint, is_near
from btxml.files.parse.replacing import REPLACES
from btxml.files.parse.version3 import INSTEAD
from btxml.files.parse.xml_file import (
    CONDITIONS,
    EXPLICIT,
    KEY,
    NOTES,
    SCRIPTS_AFTER,
    Attribute,
    Element,
    autoremaps,
    entry_name,
    node_tag,
)

NODE_LIMIT = 5_000
LEVEL_LIMIT = 1_000
SCRIPTS_LIMIT = 200_000


def check_structure(library: Library, registry: Registry) -> list[Problem]:
    """All problems of all trees, those that nothing runs included; marks the elements that have any as broken."""
    problems: list[Problem] = []
    checker = _Checker(library, registry, problems)
    for identifier, tree in library.trees.items():
        if registry.names_node(identifier) and identifier not in library.replacing:
            what = f"a node is named '{identifier}', too"
            problems.append(
                Problem(tree.place_of("ID"), what, f'rename the tree, or let it take its place: {REPLACES}="true"')
            )
        for child in tree.children:
            checker.check(child)
    return problems + list(_check_expansion(library)) + check_guards(library, registry)


def fits(element: Element, library: Library, registry: Registry) -> bool:
    """Whether a node is of the language, or one of this cell written as that takes it."""
    tag, problems = node_tag(element), list[Problem]()
    if registry.classes.get(tag) not in BUILT_IN:
        _Checker(library, registry, problems).node(element)
    return not problems


class _Checker:
    """Checks one element after the other."""

    def __init__(self, library: Library, registry: Registry, problems: list[Problem]) -> None:
        self._library = library
        self._registry = registry
        self._problems = problems
        self._script_length = 0

    def check(self, element: Element) -> None:
        waiting = [element]
        while waiting:
            current = waiting.pop()
            waiting += reversed(current.children)
            before = len(self._problems)
            if before >= PROBLEM_LIMIT:
                current.broken = self._library.incomplete = True  # nobody reads more; what follows is not known
            elif current.tag == "SubTree":
                self._subtree(current)
            else:
                self.node(current)
            current.broken = current.broken or len(self._problems) > before

    def _report(self, place: Place, what: str, legal: str = "") -> None:
        self._problems.append(Problem(place, what, legal))

    def _subtree(self, element: Element) -> None:
        identifier = element.get("ID")
        if identifier is None:
            self._report(element.place, "this SubTree has no ID", hint("", self._library.trees))
        elif identifier not in self._library.trees and self._library.incomplete:
            element.broken = True
        elif identifier not in self._library.trees:
            what = f"there is no BehaviorTree '{identifier}'"
            self._report(element.place_of("ID"), what, hint(identifier, self._library.trees))
        if element.children:
            self._report(element.children[0].place, "a SubTree has no children here", "they stand in its BehaviorTree")
        for name, attribute in element.attributes.items():
            if name == "_autoremap":
                self._literal(attribute, bool)
            elif name.startswith("_"):
                self._underscore(name, attribute)
            elif name not in ("ID", "name") and (key := entry_name(attribute.value, name)) is not None:
                self._key(attribute, key)
        for name, port in self._library.models.get(identifier or "", {}).items():
            if (
                name not in element.attributes
                and port.default is None
                and port.direction != "output"
                and not autoremaps(element)
            ):
                self._report(element.place, f"SubTree '{identifier}' needs port '{name}'", f'{name}="..."')

    def node(self, element: Element) -> None:
        """What is wrong with a node, apart from those below it."""
        tag = node_tag(element)
        if not tag:
            self._report(element.place, f"this <{element.tag}> has no ID", f'like <{element.tag} ID="Name"/>')
            return
        node = self._registry.classes.get(tag)
        if node is None:
            place = element.place_of("ID") if element.tag in EXPLICIT else element.place
            legal = INSTEAD.get(tag) or hint(tag, [*self._registry.classes, "SubTree"], "`cell nodes` lists all nodes")
            self._report(place, f"there is no node '{tag}'", "; ".join(filter(None, (legal, self._registry.remark))))
            return
        self._children(element, node)
        if tag == "ReactiveSequence":
            self._reactive(element)
        ports = self._registry.ports_in(tag, element.attributes)
        values = {name: attribute.value for name, attribute in element.attributes.items()}
        if (wrong := node.traits.impossible(len(element.children), values)) is not None:
            where, legal = element.place_of(wrong[0]), f"at most {len(element.children)}"
            self._library.warnings.append(Problem(where, wrong[1], legal))  # the language runs it, and it fails
        for name, attribute in element.attributes.items():
            if name in ports:
                self._port(attribute, ports[name])
                self._range(attribute, ports[name], node)
            elif name.startswith("_"):
                self._underscore(name, attribute)
            elif name != "name" and not (name == "ID" and element.tag in EXPLICIT):
                left = [port for port in ports if port not in element.attributes]
                self._report(attribute.place, f"{tag} has no port '{name}'", hint(name, left or ports))
        for name, port in ports.items():
            if name not in element.attributes and not port.optional:
                self._report(element.place, f"{tag} needs port '{name}'", f"{name}: {_wanted(port)}")

    def _children(self, element: Element, node: type[TreeNode]) -> None:
        count = len(element.children)
        low, high = node.children_min, node.children_max
        if low <= count and (high is None or count <= high):
            return
        wanted = f"at least {low}" if high is None else str(low) if low == high else f"{low} to {high}"
        what = f"{node_tag(element)} has {count} {'child' if count == 1 else 'children'}"
        self._report(element.place, what, f"it takes {wanted}")

    def _reactive(self, element: Element) -> None:
        """Only one child may go on over several ticks: the others would be halted and begun anew for ever."""
        several = [child for child in element.children if node_tag(child) == "AsyncSequence"]
        for child in several[1:]:
            what = f"{element.tag} has a second asynchronous child"
            self._report(child.place, what, "at most one; put them into one Sequence")

    def _port(self, attribute: Attribute, port: Port) -> None:
        if port.kind is Script:
            self._script(attribute)
            return
        key = entry_name(attribute.value, port.name, port.names_entry)
        if key is not None:
            self._key(attribute, key)
        elif port.takes_texts:
            return
        elif port.direction != "input":
            what = f"port '{port.name}' is an {port.direction} and '{attribute.value}' is not an entry"
            self._report(attribute.place, what, f'like {port.name}="{{entry}}"')
        elif not has_literals(port.kind):
            what = f"port '{port.name}' takes a {type_name(port.kind)}, which cannot be written here"
            self._report(attribute.place, what, f'connect it: {port.name}="{{entry}}"')
        else:
            self._literal(attribute, port.kind)

    def _range(self, attribute: Attribute, port: Port, node: type[TreeNode]) -> None:
        """Whether a value that is spelt out is in its port's range; what the language takes anyway is a warning."""
        if not port.range or entry_name(attribute.value, port.name, port.names_entry) is not None:
            return
        try:
            value = from_text(attribute.value, port.kind)
        except LiteralError:
            return
        if legal := port.outside(value):
            shown = f"'{attribute.value}'" if attribute.value.strip() else "empty"
            problems = self._library.warnings if node in BUILT_IN else self._problems
            problems.append(Problem(attribute.value_place, f"port '{port.name}' is {shown}", legal))

    def _script(self, attribute: Attribute) -> None:
        before, self._script_length = self._script_length, self._script_length + len(attribute.value)
        if self._script_length > SCRIPTS_LIMIT:
            if before <= SCRIPTS_LIMIT:
                what = f"all scripts together have more than {SCRIPTS_LIMIT} characters"
                self._report(attribute.place, what, "leave such work to a node in Python")
                self._library.incomplete = True
            return
        try:
            parse_script(attribute.value, Scope(), self._registry.enums)
        except ScriptError as error:
            self._report(attribute.place_at(error.offset), f"bad script: {error}", error.legal)

    def _literal(self, attribute: Attribute, kind: Any) -> None:
        try:
            from_text(attribute.value, kind)
        except LiteralError as error:
            self._report(attribute.value_place, str(error), error.legal)
            return
        if wrong := misnomer(attribute.value, kind, self._registry.words):
            self._report(attribute.value_place, *wrong)

    def _key(self, attribute: Attribute, key: str) -> None:
        if not KEY.match(key):
            legal = "like {part}, {@part} or {=}" + ("; JSON is written json:{...}" if '"' in key or "'" in key else "")
            self._report(attribute.value_place, f"'{key}' is not the name of an entry", legal)

    def _underscore(self, name: str, attribute: Attribute) -> None:
        if name in CONDITIONS or name in SCRIPTS_AFTER:
            self._script(attribute)
        elif name == "_autoremap" or is_near(name, (*CONDITIONS, *SCRIPTS_AFTER)):
            legal = (*CONDITIONS, *SCRIPTS_AFTER)
            self._report(attribute.place, f"there is no attribute '{name}' here", hint(name, legal))
        elif name not in NOTES:
            what = f"'{name}' means nothing here; it is ignored"
            self._library.notes.append(Problem(attribute.place, what, "editors write such notes for themselves"))


def count_levels(library: Library, identifier: str) -> int:
    """Levels of a checked tree with every SubTree in its place."""
    sizes: dict[str, tuple[int, int]] = {}
    _measure(library, identifier, sizes)
    return sizes[identifier][1]


def _check_expansion(library: Library) -> Iterator[Problem]:
    """Recursive SubTrees, and trees that grow too large when every SubTree is put in its place."""
    sizes: dict[str, tuple[int, int]] = {}
    for identifier in library.trees:
        yield from _measure(library, identifier, sizes)


def _measure(library: Library, identifier: str, sizes: dict[str, tuple[int, int]]) -> list[Problem]:
    """Nodes and levels of a tree and of all below it; an explicit stack, as files may nest deeply.

    What is wrong is marked as broken, and counts as one node from there on.
    """
    problems: list[Problem] = []
    if identifier in sizes:
        return problems
    stack = [(identifier, _subtrees(library.trees[identifier]))]
    while stack:
        current, uses = stack[-1]
        use = next((use for use in uses if use.get("ID") not in sizes and not use.broken), None)
        if use is None:
            stack.pop()
            nodes, levels = sizes[current] = _size(library.trees[current], sizes)
            if nodes > NODE_LIMIT or levels > LEVEL_LIMIT:
                what = f"BehaviorTree '{current}' grows to {nodes} nodes on {levels} levels"
                legal = f"at most {NODE_LIMIT} nodes on {LEVEL_LIMIT} levels"
                problems.append(Problem(library.trees[current].place, what, legal))
                for child in library.trees[current].children:
                    child.broken, child.children = True, []
                sizes[current] = 1, 1
            continue
        names, name = [opened for opened, _ in stack], use.get("ID") or ""
        if name in names:
            circle = [*names[names.index(name) :], name]
            round_trip = " > ".join(circle if len(circle) < 10 else [*circle[:5], "...", *circle[-3:]])
            what = f"this SubTree contains itself: {round_trip}"
            problems.append(Problem(use.place, what, "break the circle"))
            use.broken = True
            continue
        stack.append((name, _subtrees(library.trees[name])))
    return problems


def _subtrees(tree: Element) -> Iterator[Element]:
    waiting = [tree]
    while waiting:
        element = waiting.pop()
        if element.tag == "SubTree" and not element.broken:
            yield element
        waiting += element.children


def _size(tree: Element, sizes: dict[str, tuple[int, int]]) -> tuple[int, int]:
    nodes = levels = 0
    waiting = [(child, 1) for child in tree.children]
    while waiting:
        element, level = waiting.pop()
        inner_nodes, inner_levels = _inside(element, sizes)
        nodes += 1 + inner_nodes
        levels = max(levels, level + inner_levels)
        waiting += [(child, level + 1) for child in element.children]
    return nodes, levels


def _inside(element: Element, sizes: dict[str, tuple[int, int]]) -> tuple[int, int]:
    return sizes[element.get("ID") or ""] if element.tag == "SubTree" and not element.broken else (0, 0)


def _wanted(port: Port) -> str:
    literal = f"{type_name(port.kind)} or {{entry}}" if has_literals(port.kind) else f'an entry: {port.name}="{{=}}"'
    return literal + (f" ({port.meaning})" if port.meaning else "")
