"""What can be wrong between nodes: entries that nothing writes, and ports of different types on one entry."""

from __future__ import annotations

import difflib
from collections.abc import Iterator
from typing import Any

from cell.errors import Problem
from trees.engine.blackboard import UNSET, Entry, Scope
from trees.engine.literals import LiteralError, converted, has_literals, type_name
from trees.engine.vocabulary import Words, is_word, misnomer
from trees.files.build.builder import Builder, Call, Use


def check_dataflow(builder: Builder, given: set[int], words: Words) -> list[Problem]:
    """Lock the types of all entries; problems where ports disagree or an entry is read that nothing writes.

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
            group[0].entry.kind = typed.kind
            problems += [_disagree(use, typed) for use in group if not _agree(use, typed)]
            problems += _constant_problems(writers, typed)
    return problems


def _constant_problems(writers: list[Use], typed: Use) -> list[Problem]:
    """A constant that a SubTree, or the one who runs the tree, passes to a port of a type that it does not fit."""
    value = typed.entry.value
    if value is UNSET:
        return []
    try:
        converted(value, typed.kind)
    except LiteralError as error:
        if not writers:
            return [Problem(typed.place, f"{typed.user} is given {{{typed.entry.name}}}: {error}", error.legal)]
        return [
            Problem(writers[0].place, f"{writers[0].user}: {error}", f"{typed.user} at {typed.place}: {error.legal}")
        ]
    return []


def _misnomers(group: list[Use], words: Words) -> Iterator[Problem]:
    """Names that are spelt out for an entry, in a script or in what a SubTree is given, and that do not exist."""
    takers = [use for use in group if use.reads and _has_names(use.kind, words)]
    for use in group:
        spelt_out = use.text if use.sign else use.entry.text if use.writes and not use.turn else None
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
        yield from (Problem(use.place, what.format(use.user, entry.name), "connect what writes it") for use in readers)
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
    if typed.writes and typed.kind is str and not use.writes:
        return has_literals(use.kind)
    classes = isinstance(use.kind, type) and isinstance(typed.kind, type)
    return classes and not use.writes and use.kind not in (int, float) and issubclass(typed.kind, use.kind)


def _has_names(kind: Any, words: Words) -> bool:
    return isinstance(kind, type) and kind in words


def _is_text(kind: Any) -> bool:
    return kind is str or is_word(kind)


def _disagree(use: Use, typed: Use) -> Problem:
    what = f"{use.user} takes {{{use.entry.name}}} as {type_name(use.kind)}"
    return Problem(use.place, what, f"{typed.user} at {typed.place} has it as {type_name(typed.kind)}")
