"""What can be wrong between nodes: entries that nothing writes or that are read before, ports of different types."""

from __future__ import annotations

import difflib
from bisect import bisect_left
from collections.abc import Iterable, Iterator, Sequence
from typing import Any

from btxml.engine.blackboard import UNSET, Entry, Scope
from btxml.engine.errors import Problem
from btxml.engine.literals import LiteralError, a_type, converted, has_literals, shown, type_name
from btxml.engine.node import TreeNode
from btxml.engine.vocabulary import Words, is_word, misnomer
from btxml.files.compile.builder import Builder, Call, Use
from btxml.files.parse.xml_file import CONDITIONS, SCRIPTS_AFTER

Moment = tuple[int, int, int]


def check_dataflow(builder: Builder, given: set[int], words: Words) -> list[Problem]:
    """Lock the type of every entry that a port writes; problems where ports disagree, or read what nothing writes.

    Args:
        given: ids of entries that somebody outside of the tree writes.
        words: the names that the configuration knows.
    """
    by_entry: dict[int, list[Use]] = {}
    for use in builder.uses:
        by_entry.setdefault(id(use.entry), []).append(use)
    problems: list[Problem] = []
    for key, group in by_entry.items():
        writers = [use for use in group if use.writes]
        if not writers and key not in given and group[0].entry.value is UNSET:
            problems += _unwritten(builder, group)
        problems += _misnomers(group, words)
        typed = next((use for use in [*writers, *group] if use.kind is not Any), None)
        if typed is not None:
            if typed.writes:
                group[0].entry.kind = typed.kind
            else:
                group[0].entry.shown = typed.kind is str
            problems += [_disagree(use, typed) for use in group if not _agree(use, typed)]
            problems += _outside(group)
            problems += _constant_problems(writers, typed)
            problems += _unreadable(group)
    return problems


def _unreadable(group: list[Use]) -> Iterator[Problem]:
    """Values that a script spells out, and that a port which reads the entry cannot take.

    Where a script also calculates with the entry (`+=`), nobody knows what it holds when it is read.
    """
    if any(use.sign not in ("", ":=", "=") for use in group):
        return
    takers = [use for use in group if use.reads and use.kind is not Any and has_literals(use.kind)]
    for use in group:
        for taker in takers if use.constant is not UNSET else ():
            try:
                converted(use.constant, taker.kind)
            except LiteralError as error:
                what = f"{use.user} gives {{{use.name}}} {shown(use.constant)}"
                yield Problem(use.place, what, f"{taker.user} at {taker.place} takes {a_type(taker.kind)}: {error}")
                break


def _constant_problems(writers: list[Use], typed: Use) -> list[Problem]:
    """A constant that a SubTree, or the one who runs the tree, passes to a port of a type that it does not fit."""
    value = typed.entry.value
    if value is UNSET:
        return []
    try:
        converted(value, typed.kind)
    except LiteralError as error:
        if not writers:
            return [Problem(typed.place, f"{typed.user} is given {{{typed.name}}}: {error}", error.legal)]
        legal = f"{typed.user} at {typed.place}: {error.legal}"
        return [Problem(writers[0].place, f"{writers[0].user}: {error}", legal)]
    return []


def _outside(group: list[Use]) -> Iterator[Problem]:
    """A value that a SubTree is given, and that is out of the range of a port that reads it."""
    value = group[0].entry.value
    if group[0].entry.text is None or value is UNSET:
        return
    giver = next((use for use in group if use.passes), None)
    for use in group:
        if giver is not None and use.port is not None and use.reads and (wrong := use.port.outside(value)):
            yield Problem(giver.place, f"{use.user} at {use.place} gets {value!r}", wrong)
            return


def _misnomers(group: list[Use], words: Words) -> Iterator[Problem]:
    """Names that are spelt out for an entry, in a script or in what a SubTree is given, and that do not exist."""
    takers = [use for use in group if use.reads and isinstance(use.kind, type) and use.kind in words]
    for use in group:
        constant = use.constant if isinstance(use.constant, str) else None
        spelt_out = constant if use.sign else use.entry.text if use.writes and not use.turn else None
        for taker in takers if spelt_out is not None else ():
            if wrong := misnomer(spelt_out, taker.kind, words):
                yield Problem(use.place, wrong[0], f"{taker.user} at {taker.place} takes {wrong[1]}")
                break


def _unwritten(builder: Builder, readers: list[Use]) -> Iterator[Problem]:
    """Nothing writes what these read; told where it can be mended: at the outermost SubTree that passes it in."""
    entry, reader = readers[0].entry, readers[0]
    owner = next((call for call in builder.calls if _key(call.inner, entry) and not _key(call.outer, entry)), None)
    if owner is not None and (mistyped := _mistyped(builder, owner, entry)):
        name, called = owner.element.get("ID"), entry.name
        legal = f"did you mean '{called}', which {reader.user} at {reader.place} reads?"
        yield Problem(owner.element.attributes[mistyped].place, f"SubTree '{name}' reads no '{mistyped}'", legal)
        return
    if owner is not None and owner.element.place.file != reader.place.file:
        what = f"SubTree '{owner.element.get('ID')}' needs '{entry.name}', and nothing passes it"
        yield Problem(owner.element.place, what, f"{reader.user} at {reader.place} reads it")
        return
    passing = next((call for call in builder.calls if _passed(call, entry)), None)
    if passing is None:
        what = "{} reads {{{}}}, which nothing writes"
        yield from (Problem(use.place, what.format(use.user, use.name), "connect what writes it") for use in readers)
        return
    key = _passed(passing, entry)
    what = f"'{key}' of SubTree '{passing.element.get('ID')}' reads {{{entry.name}}}, which nothing writes"
    legal = f"connect what writes it; {reader.user} at {reader.place} needs it"
    yield Problem(passing.element.place_of(key), what, legal)


def _key(scope: Scope, entry: Entry) -> str:
    """The name of an entry in a tree, empty where it has none."""
    return next((key for key in scope if scope.entry(key) is entry), "")


def _passed(call: Call, entry: Entry) -> str:
    """The attribute of a SubTree that joins an entry of the tree around it, empty where none does."""
    key = _key(call.inner, entry)
    return key if key in call.element.attributes else ""


def _mistyped(builder: Builder, call: Call, entry: Entry) -> str:
    """An attribute of the SubTree that nothing within reads, and that is written much like the entry."""
    read = {id(use.entry) for use in builder.uses if use.reads}
    passed = [key for key in call.inner if key in call.element.attributes and id(call.inner.entry(key)) not in read]
    return next(iter(difflib.get_close_matches(entry.name, passed, n=1, cutoff=0.6)), "")


def _agree(use: Use, typed: Use) -> bool:
    if use.kind is Any or use.kind == typed.kind:
        return True
    if _is_text(use.kind) and _is_text(typed.kind):
        kin = issubclass(use.kind, typed.kind) or issubclass(typed.kind, use.kind)
        return str in (use.kind, typed.kind) or (kin and not use.writes)
    if not use.writes and not typed.writes and str in (use.kind, typed.kind):
        return has_literals(use.kind) and has_literals(typed.kind)  # each converts what a script writes
    if typed.writes and typed.kind is str and not use.writes:
        return has_literals(use.kind)
    if use.kind is str and not use.writes:
        return typed.kind in (bool, int, float)
    classes = isinstance(use.kind, type) and isinstance(typed.kind, type)
    return classes and not use.writes and use.kind not in (int, float) and issubclass(typed.kind, use.kind)


def _is_text(kind: Any) -> bool:
    return kind is str or is_word(kind)


def _disagree(use: Use, typed: Use) -> Problem:
    what = f"{use.user} takes {{{use.name}}} as {type_name(use.kind)}"
    return Problem(use.place, what, f"{typed.user} at {typed.place} has it as {type_name(typed.kind)}")


def check_order(uses: Iterable[Use], nodes: Sequence[TreeNode], given: set[int]) -> list[Problem]:
    """Readers that nothing can have served, in the order in which a tick visits the nodes.

    Only what is certain is a problem: nothing that writes the entry stands before the reader, and no node around both
    ticks the reader again after the writer. What needs the value itself in order to write (`n += 1`, a port that is
    both read and written) begins nothing. The root is ticked until it ends, once.

    Args:
        nodes: by uid - 1, parents before children.
        given: ids of entries that somebody outside of the tree writes.
    """
    by_entry: dict[int, list[Use]] = {}
    for use in uses:
        by_entry.setdefault(id(use.entry), []).append(use)
    order = Order(nodes)
    problems: list[Problem] = []
    for key, group in by_entry.items():
        written = any(use.writes for use in group)
        if written and key not in given and group[0].entry.value is UNSET:
            problems += order.problems(group)
    return problems


class Order:
    """When nodes are ticked for the first time, and what may tick them again."""

    def __init__(self, nodes: Sequence[TreeNode]) -> None:
        count = len(nodes)
        self._last = list(range(count + 1))  # last uid at or below each node
        self._back = [0] * (count + 1)  # uid of the topmost node above each one that comes back to it, 0 for none
        for node in nodes:
            for child in node.children:
                back = self._back[node.uid] or (node.uid if node.traits.comes_back else 0)
                self._back[child.uid] = back
        for node in reversed(nodes):
            self._last[node.uid] = max([node.uid, *(self._last[child.uid] for child in node.children)])

    def problems(self, group: list[Use]) -> list[Problem]:
        """Of the users of one entry."""
        first = min((use for use in group if use.begins), key=self._moment, default=None)
        readers = [use for use in group if use.needs and use.attribute != "_onHalted"]
        if first is None:
            return [_problem(use, None) for use in readers]
        beginners = sorted({use.uid for use in group if use.begins})
        late = [use for use in readers if self._moment(use) < self._moment(first)]
        return [_problem(use, first) for use in late if not self.comes_back(use.uid, beginners)]

    def _moment(self, use: Use) -> Moment:
        """A node's scripts before, its ports, everything below it, its scripts after.

        Of the ports of one node those that are only written come first: it may read in a later tick of its own.
        """
        if use.attribute == "_onHalted":
            return (0, 0, 0)  # nobody knows when
        if use.attribute in SCRIPTS_AFTER:
            return (self._last[use.uid], 9, 0)
        if use.attribute in CONDITIONS:
            return (use.uid, CONDITIONS.index(use.attribute), use.turn)
        return (use.uid, 7 if use.needs or use.turn else 5, use.turn)

    def within(self, node: TreeNode) -> range:
        """The numbers of a node, and of those below it."""
        return range(node.uid, self._last[node.uid] + 1)

    def comes_back(self, reader: int, writers: list[int]) -> bool:
        """Whether a node around both ticks the reader again after one of the writers."""
        back = self._back[reader]
        if not back:
            return False
        following = bisect_left(writers, back)
        return following < len(writers) and writers[following] <= self._last[back]


def _problem(use: Use, first: Use | None) -> Problem:
    if use.sign == "=":
        what = f"{use.user} assigns {{{use.name}}} before anything has made it"
        return Problem(use.place, what, "write :=, which makes it")
    what = f"{use.user} reads {{{use.name}}} before anything has written it"
    if first is None:
        return Problem(use.place, what, "give it a first value before, by := or by a node that only writes it")
    return Problem(use.place, what, f"{first.user} at {first.place} is the first to write it; put that before")
