"""A running tree for its page: its nodes once, and then of each tick what changed in statuses and blackboard."""

from __future__ import annotations

import json
from collections.abc import Iterable, Iterator
from typing import Any

from bracket_cell.recording.schemas import plain_or_text
from btxml.engine.blackboard import UNSET
from btxml.engine.node import StatusChange, TreeNode
from btxml.engine.tree import Tree
from btxml.files.compile.registry import meaning_of
from btxml.views.groot2 import code_of, entries_of

LETTERS_MAX = 400  # of a value on the blackboard


class TreeMoments:
    """Follows one tree; a moment is what changed since the one before, or all of it."""

    def __init__(self) -> None:
        self._statuses: dict[int, tuple[int, str]] = {}
        self._entries: dict[str, str] = {}
        self._texts: dict[int, tuple[int, str]] = {}  # by entry: its revision, and the text of that

    def follow(self, changes: Iterable[StatusChange]) -> list[int]:
        """Keep statuses; returns the uids of the nodes whose statuses or words are new."""
        new = {change.uid: (code_of(change), change.feedback) for change in changes}
        self._statuses |= new
        return list(new)

    def moment(
        self, changes: Iterable[StatusChange], tree: Tree | None, whole: bool = False
    ) -> tuple[list[tuple[int, int, str]], dict[str, str | None]]:
        """After a tick: (uid, status, words) of nodes, and entries by tree and name, None where one was unset.

        Args:
            tree: None where nothing is known of its blackboard.
            whole: all of it.
        """
        uids: Iterable[int] = self.follow(changes)
        before, after = {} if whole else self._entries, {} if tree is None else dict(self._shown(tree))
        gone = dict.fromkeys(key for key in before if key not in after)
        self._entries = after
        nodes = [(uid, *self._statuses[uid]) for uid in (self._statuses if whole else uids)]
        return nodes, {**{key: text for key, text in after.items() if before.get(key) != text}, **gone}

    def _shown(self, tree: Tree) -> Iterator[tuple[str, str]]:
        for scope, key, entry in entries_of(tree):
            if entry.value is UNSET:
                continue
            known = self._texts.get(id(entry))
            if known is None or known[0] != entry.revision:
                known = self._texts[id(entry)] = (entry.revision, _text(entry.value))
            yield f"{scope}\t{key}", known[1]


def _text(value: object) -> str:
    text = value if isinstance(value, str) else json.dumps(plain_or_text(value), default=str)
    return text if len(text) <= LETTERS_MAX else text[: LETTERS_MAX - 1] + "…"


def part_of(tree: Tree) -> dict[str, Any]:
    """A tree as the page has it: its nodes from the top, [depth, tag, name, kind, attributes, file, line, path]."""
    nodes = [_node(tree, node, depth) for node, depth in _deep(tree.root)]
    meanings = {node.tag or type(node).__name__: meaning_of(type(node)) for node in tree.nodes}
    return {"title": tree.name, "nodes": nodes, "meanings": meanings}


def _deep(root: TreeNode) -> Iterator[tuple[TreeNode, int]]:
    """All nodes in the order of the file, which is the order of their uids, each with its depth."""
    waiting = [(root, 0)]
    while waiting:
        node, depth = waiting.pop()
        yield node, depth
        waiting += [(child, depth + 1) for child in reversed(node.children)]


def _node(tree: Tree, node: TreeNode, depth: int) -> list[Any]:
    tag, written = tree.origins[node.uid - 1]
    title = written.get("ID", tag) if tag == "SubTree" else tag
    hidden = ("name", "ID") if tag == "SubTree" or written.get("ID") == tag else ("name",)
    ports = {key: value for key, value in written.items() if key not in hidden}
    name = "" if node.name == title else node.name
    return [depth, title, name, node.node_type, ports, *tree.place_of(node), node.full_path]
