"""Entries that are read before anything can have written them, in the order in which a tick visits the nodes.

Only what is certain is a problem: nothing that writes the entry stands before the reader, and no node around both
ticks the reader again after the writer. What needs the value itself in order to write (`n += 1`, a port that is both
read and written) begins nothing. The root is ticked until it ends, once.
"""

from __future__ import annotations

from bisect import bisect_left
from collections.abc import Iterable, Sequence
from typing import cast

from cell.errors import Problem
from trees.engine.blackboard import UNSET
from trees.engine.node import TreeNode
from trees.files.build.builder import Use
from trees.files.parse.attributes import CONDITIONS, SCRIPTS_AFTER

Moment = tuple[int, int, int]


def check_order(uses: Iterable[Use], nodes: Sequence[TreeNode], given: set[int]) -> list[Problem]:
    """Readers that nothing can have served.

    Args:
        nodes: by uid - 1, parents before children.
        given: ids of entries that somebody outside of the tree writes.
    """
    by_entry: dict[int, list[Use]] = {}
    for use in uses:
        by_entry.setdefault(id(use.entry), []).append(use)
    order = _Order(nodes)
    problems: list[Problem] = []
    for key, group in by_entry.items():
        written = any(use.writes for use in group)
        if written and key not in given and group[0].entry.value is UNSET:
            problems += order.problems(group)
    return problems


class _Order:
    """When nodes are ticked for the first time, and what may tick them again."""

    def __init__(self, nodes: Sequence[TreeNode]) -> None:
        count = len(nodes)
        self._last = list(range(count + 1))  # last uid at or below each node
        self._back = [0] * (count + 1)  # uid of the topmost node above each one that comes back to it, 0 for none
        for node in nodes:
            for child in _children(node):
                back = self._back[node.uid] or (node.uid if node.traits.comes_back else 0)
                self._back[child.uid] = back
        for node in reversed(nodes):
            self._last[node.uid] = max([node.uid, *(self._last[child.uid] for child in _children(node))])

    def problems(self, group: list[Use]) -> list[Problem]:
        """Of the users of one entry."""
        first = min((use for use in group if use.begins), key=self._moment, default=None)
        readers = [use for use in group if use.needs and use.attribute != "_onHalted"]
        if first is None:
            return [_problem(use, None) for use in readers]
        beginners = sorted({use.uid for use in group if use.begins})
        late = [use for use in readers if self._moment(use) < self._moment(first)]
        return [_problem(use, first) for use in late if not self._comes_back(use.uid, beginners)]

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

    def _comes_back(self, reader: int, writers: list[int]) -> bool:
        back = self._back[reader]
        if not back:
            return False
        following = bisect_left(writers, back)
        return following < len(writers) and writers[following] <= self._last[back]


def _problem(use: Use, first: Use | None) -> Problem:
    if use.sign == "=":
        what = f"{use.user} assigns {{{use.entry.name}}} before anything has made it"
        return Problem(use.place, what, "write :=, which makes it")
    what = f"{use.user} reads {{{use.entry.name}}} before anything has written it"
    if first is None:
        return Problem(use.place, what, "give it a first value before, by := or by a node that only writes it")
    return Problem(use.place, what, f"{first.user} at {first.place} is the first to write it; put that before")


def _children(node: TreeNode) -> list[TreeNode]:
    return cast(list[TreeNode], node.children)
