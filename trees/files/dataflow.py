"""What can be wrong between nodes: entries that nothing writes, and ports of different types on one entry."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

from cell.interfaces.errors import Problem
from trees.engine.blackboard import UNSET
from trees.engine.literals import LiteralError, converted, has_literals, type_name
from trees.files.builder import Use


def check_dataflow(uses: Iterable[Use], given: set[int]) -> list[Problem]:
    """Lock the types of all entries; problems where ports disagree or an entry is read that nothing writes.

    Args:
        given: ids of entries that somebody outside of the tree writes.
    """
    by_entry: dict[int, list[Use]] = {}
    for use in uses:
        by_entry.setdefault(id(use.entry), []).append(use)
    problems: list[Problem] = []
    for key, group in by_entry.items():
        writers = [use for use in group if use.writes]
        if not writers and key not in given and group[0].entry.value is UNSET:
            problems += [_unwritten(use) for use in group]
        typed = next((use for use in [*writers, *group] if use.kind is not Any), None)
        if typed is not None:
            group[0].entry.kind = typed.kind
            problems += [_disagree(use, typed) for use in group if not _agree(use, typed)]
            problems += _constant_problems(writers, typed)
    return problems


def _constant_problems(writers: list[Use], typed: Use) -> list[Problem]:
    """A constant that a SubTree passes to a port of a type that it does not fit."""
    value = typed.entry.value
    if value is UNSET or not writers:
        return []
    try:
        converted(value, typed.kind)
    except LiteralError as error:
        return [
            Problem(writers[0].place, f"{writers[0].user}: {error}", f"{typed.user} at {typed.place}: {error.legal}")
        ]
    return []


def _unwritten(use: Use) -> Problem:
    return Problem(use.place, f"{use.user} reads {{{use.entry.name}}}, which nothing writes", "connect what writes it")


def _agree(use: Use, typed: Use) -> bool:
    if use.kind is Any or use.kind == typed.kind:
        return True
    if typed.writes and typed.kind is str and not use.writes:
        return has_literals(use.kind)
    classes = isinstance(use.kind, type) and isinstance(typed.kind, type)
    return classes and not use.writes and use.kind not in (int, float) and issubclass(typed.kind, use.kind)


def _disagree(use: Use, typed: Use) -> Problem:
    what = f"{use.user} takes {{{use.entry.name}}} as {type_name(use.kind)}"
    return Problem(use.place, what, f"{typed.user} at {typed.place} has it as {type_name(typed.kind)}")
