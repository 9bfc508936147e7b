"""What a tree file may mean and mostly does not: warnings, which keep nothing from running."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterable, Iterator, Mapping
from difflib import get_close_matches
from pathlib import Path

from btxml.engine.errors import Place, Problem
from btxml.engine.node import TreeNode
from btxml.files.checks.dataflow import Order
from btxml.files.compile.builder import Builder, Use
from btxml.files.compile.registry import Registry
from btxml.files.parse.library import Library, called
from btxml.files.parse.xml_file import Element, plain_files

NAMES_N = 200  # entries among which a name that is alike is looked for


def check_main(library: Library, path: Path, others: Iterable[Library]) -> Iterator[Problem]:
    """Trees of a file that nothing calls, and a file with several that does not say which to run.

    Args:
        others: libraries of files that are checked beside it; what these call is called.
    """
    own = {name: tree for name, tree in library.trees.items() if tree.place.file == path}
    wanted = [other for other in others if path in other.texts and other is not library]
    if not library.main:
        if len(own) > 1 and not wanted:
            what = f"the file does not say which of its trees to run: {', '.join(own)}"
            yield Problem(Place(path, 1, 1), what, "set main_tree_to_execute")
        return
    reached = {library.main} | {name for other in (library, *wanted) for name in _reached(other)}
    beside = [file.read_text("utf-8", "replace") for file in plain_files(path.parent, "*.xml") if file != path]
    for name, tree in own.items():
        if name not in reached and not any(f'<SubTree ID="{name}"' in text for text in beside):
            yield Problem(
                tree.place, f"nothing calls BehaviorTree '{name}'", f'<SubTree ID="{name}"/> does, or remove it'
            )


def check_meant(builder: Builder, library: Library, main: str) -> Iterator[Problem]:
    """Entries that nothing reads, two that write one at once, attributes that nothing reads, actions begun again."""
    by_entry: dict[int, list[Use]] = defaultdict(list)
    for use in builder.uses:
        by_entry[id(use.entry)].append(use)
    order = Order(builder.nodes)
    if main not in library.models:  # else whoever calls it may read what it writes
        yield from _unread(builder, by_entry)
    yield from _at_once(builder, by_entry)
    yield from _unread_attributes(builder, library, order)
    yield from _needed(builder, order)
    yield from _begun_again(builder, order)


def _reached(library: Library) -> set[str]:
    """Trees that a library's main tree calls, itself or by what it calls."""
    if library.main not in library.trees:
        return set(library.trees)
    reached, waiting = {library.main}, list(library.trees[library.main].children)
    while waiting:
        element = waiting.pop()
        name = element.get("ID") or ""
        if element.tag == "SubTree" and name in reached:
            continue
        if element.tag == "SubTree" and name in library.trees:
            reached.add(name)
        waiting += _below(library, element)
    return reached


def _below(library: Library, element: Element) -> list[Element]:
    known = element.tag != "SubTree" or element.get("ID") in library.trees
    return called(library, element) if known else element.children


def _unread(builder: Builder, by_entry: Mapping[int, list[Use]]) -> Iterator[Problem]:
    """What scripts and ports write, and nothing reads; a port that must be connected has to write somewhere."""
    useful = [group for group in by_entry.values() if any(use.reads for use in group)]
    read, elsewhere = {use.name for group in useful for use in group}, {use.place for group in useful for use in group}
    for key, group in by_entry.items():
        first = group[0]
        if key in builder.mentioned or any(use.reads or use.place in elsewhere for use in group):
            continue  # a tree that is called twice has its entries twice
        if all(use.sign or (use.port is not None and (use.names_entry or use.port.optional)) for use in group):
            near = get_close_matches(first.name, read, 1, 0.7) if len(read) <= NAMES_N else []
            legal = f"did you mean {{{near[0]}}}?" if near else "remove it"
            yield Problem(first.place, f"{first.user} writes {{{first.name}}}, and nothing reads it", legal)


def _at_once(builder: Builder, by_entry: Mapping[int, list[Use]]) -> Iterator[Problem]:
    """Children that run at the same time, and write one entry without looking at it."""
    parents = {child.uid: node for node in builder.nodes for child in node.children}
    for group in by_entry.values():
        both = _both_at_once([use for use in group if use.begins and not use.passes], parents)
        if both is not None:
            first, second = both
            what = f"{second.user} writes {{{second.name}}} while {first.user} at {first.place} may"
            yield Problem(second.place, what, "whoever is ticked last wins; give each an entry of its own")


def _both_at_once(writers: list[Use], parents: Mapping[int, TreeNode]) -> tuple[Use, Use] | None:
    """The first two that stand below different children of one node."""
    first: dict[int, tuple[int, Use]] = {}  # by that node: its first child that writes, and by what
    for use in writers if len(writers) > 1 else ():
        for uid, child in _around(use.uid, parents):
            known, other = first.setdefault(uid, (child, use))
            if known != child:
                return other, use
    return None


def _around(uid: int, parents: Mapping[int, TreeNode]) -> Iterator[tuple[int, int]]:
    """The nodes above one whose children run at the same time, and the child of each that it is, or is below."""
    while (parent := parents.get(uid)) is not None:
        if parent.traits.at_once:
            yield parent.uid, uid
        uid = parent.uid


def _unread_attributes(builder: Builder, library: Library, order: Order) -> Iterator[Problem]:
    """Attributes of SubTrees that nothing below them reads or writes."""
    users: dict[int, list[int]] = defaultdict(list)
    for use in builder.uses:
        if not use.passes:
            users[id(use.entry)].append(use.uid)
    reported: set[Place] = set()
    for call in builder.calls:
        node, name = builder.nodes[call.uid - 1], call.element.get("ID") or ""
        for key, attribute in call.element.attributes.items():
            if key in ("ID", "name") or key.startswith("_") or key in library.models.get(name, {}):
                continue
            entry = call.inner.entry(key)
            used = any(uid != call.uid and uid in order.within(node) for uid in users[id(entry)])
            if not used and id(entry) not in builder.mentioned and attribute.place not in reported:
                reported.add(attribute.place)
                yield Problem(attribute.place, f"nothing in SubTree '{name}' reads '{key}'", "remove it")


def _needed(builder: Builder, order: Order) -> Iterator[Problem]:
    """Nodes that need what no node before them brings about."""
    givers: dict[str, list[int]] = defaultdict(list)
    registry = builder.registry
    foreign = next((node.uid for node in builder.nodes if _is_foreign(node, registry)), len(builder.nodes) + 1)
    for node in builder.nodes:
        for what in node.traits.gives:
            givers[what].append(node.uid)
    for node in builder.nodes:
        for what in node.traits.needs:
            first = min([foreign, *givers[what][:1]])
            if first > node.uid and not order.comes_back(node.uid, givers[what]):
                place = builder.places[node.uid - 1][""]
                legal = f"{' or '.join(_givers(what, registry))} does"
                yield Problem(place, f"{node.name} needs {what}, and nothing before it sees to that", legal)


def _begun_again(builder: Builder, order: Order) -> Iterator[Problem]:
    """Actions that a reactive node asks again in every tick, while a younger one commands the same device."""
    for node in (node for node in builder.nodes if node.traits.asked_before(1)):
        waiting: list[tuple[int, TreeNode]] = []  # actions of elder children, of which nothing is told yet
        for index, child in enumerate(node.children):
            below = (builder.nodes[uid - 1] for uid in order.within(child)) if waiting else ()
            claimed = {name: other for other in below for name in other.traits.claims}
            for elder, leaf in tuple(waiting) if claimed else ():
                both = next((name for name in leaf.traits.claims if name in claimed), None)
                if both is not None and elder in node.traits.asked_before(index):
                    waiting.remove((elder, leaf))
                    where, at = (builder.places[each.uid - 1][""] for each in (leaf, claimed[both]))
                    what = f"{leaf.name} is asked again in every tick while {claimed[both].name} at {at}"
                    legal = "put both into a Sequence, where each is asked until it is done"
                    yield Problem(where, f"{what} commands the {both}", legal)
            waiting += [(index, leaf) for leaf in _done(child)]


def _done(node: TreeNode) -> Iterator[TreeNode]:
    """The actions that have succeeded where a node has, of those that are not to be asked again."""
    if node.traits.claims and not node.traits.asked_again:
        yield node
    for child in node.children if node.traits.succeeds_after == "all" else ():
        yield from _done(child)


def _givers(what: str, registry: Registry) -> list[str]:
    """Tags of the nodes that bring something about, of those that claim most devices: whole skills."""
    able = {name: some.traits.claims for name, some in registry.classes.items() if what in some.traits.gives}
    most = max(map(len, able.values()), default=0)
    return [name for name, claims in able.items() if len(claims) == most]


def _is_foreign(node: TreeNode, registry: Registry) -> bool:
    """Whether nothing is known of what a leaf does: one of the user's own that commands a device."""
    return bool(node.traits.claims) and not type(node).__module__.startswith(f"{registry.described}.")
