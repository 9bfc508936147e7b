"""Which node of a changed tree stands for which node of the tree before: several may have one name."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from difflib import SequenceMatcher
from typing import Any

from btxml.engine.causes import Cause
from btxml.engine.node import StatusChange, TreeNode
from btxml.engine.tree import Origin, Tree

NUMBER = re.compile(r"::\d+")
Placed = tuple[TreeNode, Origin]
Names = Mapping[str, str]


def partners(was: Tree, now: Tree) -> dict[str, str]:
    """Paths of the nodes before, by those of the nodes that stand for them; a node that is new is a "PATH (new)"."""
    found = {node.full_path: f"{node.full_path} (new)" for node in now.nodes}
    return found | {
        b.full_path: a.full_path for (a, _), (b, _) in _matched(_placed(was), _placed(now), (_whole, _kind))
    }


def renamed(changes: Sequence[StatusChange], names: Names) -> tuple[StatusChange, ...]:
    """Changes of a changed tree with the paths of the tree before."""
    return tuple(replace(change, path=names[change.path]) if change.path in names else change for change in changes)


def caused_by(causes: Sequence[Cause], names: Names) -> list[Cause]:
    """Comparisons of a changed tree with the paths of the tree before."""
    return [replace(cause, by=names.get(cause.by, cause.by)) for cause in causes]


def _placed(tree: Tree) -> list[Placed]:
    return list(zip(tree.nodes, tree.origins, strict=True))


def _kind(placed: Placed) -> Any:
    return NUMBER.sub("", placed[0].full_path), placed[1].tag


def _whole(placed: Placed) -> Any:
    return *_kind(placed), tuple(sorted(placed[1].attributes.items()))


def _matched(was: Sequence[Placed], now: Sequence[Placed], keys: Sequence[Any]) -> Iterator[tuple[Placed, Placed]]:
    """Pairs in the order of both files: first those that are alike in everything, between them those of one kind."""
    key, *others = keys
    matcher = SequenceMatcher(None, [key(item) for item in was], [key(item) for item in now], autojunk=False)
    for kind, a, b, c, d in matcher.get_opcodes():
        if kind == "equal":
            yield from zip(was[a:b], now[c:d], strict=True)
        elif kind == "replace" and others:
            yield from _matched(was[a:b], now[c:d], others)
