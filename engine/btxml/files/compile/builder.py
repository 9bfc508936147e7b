"""Makes nodes of checked elements and connects their ports."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, NamedTuple

from btxml.engine.blackboard import UNSET, Entry, Scope
from btxml.engine.decorators import ScriptConditions, SubTree
from btxml.engine.errors import Place, Problem, TreeFileError
from btxml.engine.literals import constant, from_text
from btxml.engine.node import FAILURE, Control, Decorator, Runtime, TreeNode
from btxml.engine.ports import Port
from btxml.engine.script import Script, parse_script
from btxml.engine.status import Status
from btxml.engine.tree import Origin
from btxml.files.compile.registry import Registry
from btxml.files.parse.library import Library
from btxml.files.parse.xml_file import CONDITIONS, SCRIPTS_AFTER, Attribute, Element, autoremaps, entry_name, node_tag

_WORD = re.compile(r"@?[^\W\d][\w./-]*")


@dataclass(frozen=True)
class Use:
    """A port, script or SubTree that reads or writes an entry.

    Attributes:
        kind: type it reads or writes, Any where it does not care.
        name, user: what its tree calls the entry, and what uses it, for messages.
        uid: of the node.
        attribute: name of the port, condition or script in the file.
        required: it fails where nothing has been written.
        turn: order within a script, from 1; 0 for other ports.
        sign: how a script assigns it; `=` fails where neither a value nor a port has made the entry.
        constant: the value that a script assigns, where it spells it out; else UNSET.
        port: None for a script, or for what a SubTree is given.
    """

    entry: Entry
    name: str
    place: Place
    reads: bool
    writes: bool
    kind: Any
    user: str
    uid: int
    attribute: str
    required: bool = False
    turn: int = 0
    sign: str = ""
    constant: Any = UNSET
    port: Port | None = None

    @property
    def passes(self) -> bool:
        """A SubTree is given the value."""
        return self.port is None and not self.turn

    @property
    def names_entry(self) -> bool:
        """A port that is told which entry is meant, whatever its type."""
        return self.port is not None and self.port.names_entry

    @property
    def needs(self) -> bool:
        """It fails where nothing has been written."""
        return self.required or (self.sign == "=" and not self.entry.declared)

    @property
    def begins(self) -> bool:
        """It writes whether or not there is a value."""
        return self.writes and not self.needs


class Call(NamedTuple):
    """A SubTree, the names around it and those within it."""

    uid: int
    element: Element
    outer: Scope
    inner: Scope


class Stub(Control):
    """Stands in a checked tree where nothing is known of a node; nothing ticks it."""

    def run(self) -> Status:
        return FAILURE


class Builder:
    """Makes nodes in the order of the file.

    Attributes:
        nodes: by uid, the first one has uid 1.
        origins, places: what they were made of, and where that stands.
        scopes: blackboards of the SubTrees, outer ones first.
        uses: who reads and writes which entry.
        calls: what passes values into SubTrees, outer ones first.
        mentioned: entries that something may write which could not be understood.
    """

    def __init__(self, library: Library, registry: Registry, runtime: Runtime) -> None:
        self._library = library
        self.registry = registry
        self._runtime = runtime
        self.nodes: list[TreeNode] = []
        self.origins: list[Origin] = []
        self.places: list[Mapping[str, Place]] = []
        self.scopes: list[Scope] = []
        self.uses: list[Use] = []
        self.calls: list[Call] = []
        self.mentioned: set[int] = set()

    def tree(self, identifier: str, scope: Scope) -> TreeNode:
        """The topmost node of a BehaviorTree whose names mean entries of `scope`."""
        tree = self._library.trees[identifier]
        return self._node(tree.children[0] if len(tree.children) == 1 else tree, scope)

    def _node(self, element: Element, scope: Scope) -> TreeNode:
        uid = len(self.nodes) + 1
        self.nodes.append(None)  # type: ignore[arg-type]  # the uid is taken before those of the children
        tag = node_tag(element)
        values = {key: attribute.value for key, attribute in element.attributes.items()}
        self.origins.append(Origin(tag, values))
        self.places.append({"": element.place, **{key: value.place for key, value in element.attributes.items()}})
        label = tag if tag != "SubTree" else element.get("ID") or ""
        name = element.get("name") or label
        path = f"{scope.name}/{name}" if scope.name else name
        if element.get("name") is None or (tag == "SubTree" and any(path == scope.name for scope in self.scopes)):
            path += f"::{uid}"  # SubTrees of one name beside each other have blackboards of their own
        if element.broken:
            node = self._stub(element, name, scope)
        elif tag == "SubTree":
            node = self._subtree(element, uid, name, scope, path)
        else:
            node = self._plain(element, uid, name, scope, path)
        node.attach(self._runtime, uid, path)
        node.conditions = None if element.broken else self._conditions(element, node, label, scope)
        self.nodes[uid - 1] = node
        return node

    def _plain(self, element: Element, uid: int, name: str, scope: Scope, path: str) -> TreeNode:
        tag, substitute = node_tag(element), self.registry.substitute
        if substitute is not None and not element.children:
            tag, element = substitute(element, tag, name, path) or (tag, element)
        children = [self._node(child, scope) for child in element.children]
        node_class: Any = self.registry.classes[tag]
        try:
            node: TreeNode = node_class(name, *[children][: issubclass(node_class, Control | Decorator)])
        except Exception as error:  # a constructor of the user's own may raise anything
            what = f"{tag} cannot be made: {type(error).__name__}: {error}"
            raise TreeFileError(Problem(element.place, what, "its __init__ takes what TreeNode's does")) from error
        for port in self.registry.ports_in(tag, element.attributes).values():
            self._port(node, uid, port, element, scope)
        return node

    def _stub(self, element: Element, name: str, scope: Scope) -> TreeNode:
        """Stands where something is wrong: it may write whatever it names."""
        for attribute in element.attributes.values():
            self.mentioned |= {id(scope.entry(word)) for word in set(_WORD.findall(attribute.value))}
        return Stub(name, [self._node(child, scope) for child in element.children])

    def _subtree(self, element: Element, uid: int, name: str, scope: Scope, path: str) -> TreeNode:
        identifier = element.get("ID") or ""
        remaps = autoremaps(element)
        inner = Scope(path, scope, autoremap=remaps)
        self.scopes.append(inner)
        self.calls.append(Call(uid, element, scope, inner))
        for key, attribute in element.attributes.items():
            if key not in ("ID", "name") and not key.startswith("_"):
                self._pass(uid, key, attribute.value, attribute.place, scope, inner)
        for key, port in self._library.models.get(identifier, {}).items():
            if key not in element.attributes and port.default is not None and not remaps:
                self._pass(uid, key, port.default, element.place, scope, inner)
        return SubTree(name, [self.tree(identifier, inner)])

    def _pass(self, uid: int, key: str, value: str, place: Place, outer: Scope, inner: Scope) -> None:
        pointer = entry_name(value, key)
        if pointer is not None:
            inner.remap(key, outer.entry(pointer))
            return
        entry = Entry(key)
        entry.value, entry.text = constant(value), value
        inner.remap(key, entry)
        self.uses.append(Use(entry, key, place, False, True, Any, f"'{key}' of the SubTree", uid, key))

    def _port(self, node: TreeNode, uid: int, port: Port, element: Element, scope: Scope) -> None:
        attribute = element.attributes.get(port.name)
        value: Any = attribute.value if attribute else port.default
        if value is UNSET:
            port.connect(node, None)
            return
        pointer = entry_name(value, port.name, port.names_entry)
        if pointer is not None:
            entry = scope.entry(pointer)
            entry.declared = entry.declared or not port.names_entry
            reads, writes = port.direction != "output", port.direction != "input"
            needs = reads and not (port.unset_ok or port.names_entry)
            place, user = element.place_of(port.name), f"port '{port.name}' of {node_tag(element)}"
            self.uses.append(
                Use(entry, pointer, place, reads, writes, port.kind, user, uid, port.name, needs, port=port)
            )
        else:
            entry = Entry(port.name)
            entry.value = self._constant(element, uid, port, attribute, scope)
        port.connect(node, entry, pointer is None, self.registry.words)

    def _constant(self, element: Element, uid: int, port: Port, attribute: Attribute | None, scope: Scope) -> Any:
        if attribute is None:
            return port.default
        if port.kind is Script:
            return self._script(attribute, uid, port.name, node_tag(element), scope)
        return from_text(attribute.value, port.kind)

    def _conditions(self, element: Element, node: TreeNode, label: str, scope: Scope) -> ScriptConditions | None:
        scripts = {
            name: self._script(attribute, node.uid, name, label, scope)
            for name, attribute in element.attributes.items()
            if name in CONDITIONS or name in SCRIPTS_AFTER
        }
        asked = node.traits.guards or node.traits.needs_guard
        return ScriptConditions(scripts, node.traits.needs_guard) if scripts or asked else None

    def _script(self, attribute: Attribute, uid: int, name: str, label: str, scope: Scope) -> Script:
        script = parse_script(attribute.value, scope, self.registry.enums)
        for turn, (entry, its, offset, sign, value) in enumerate(script.uses, start=1):
            place, user, reads = attribute.place_at(offset), f"'{name}' of {label}", sign not in (":=", "=")
            self.uses.append(Use(entry, its, place, reads, bool(sign), Any, user, uid, name, reads, turn, sign, value))
        return script
