"""A running tree in the terms of Groot2's live protocol: XML with uids, statuses, blackboard, transitions."""

from __future__ import annotations

import struct
from collections import deque
from collections.abc import Iterable, Iterator, Sequence
from typing import Any
from xml.sax.saxutils import quoteattr

from btxml.engine.blackboard import UNSET, Entry
from btxml.engine.node import SKIPPED, StatusChange, TreeNode
from btxml.engine.status import Status
from btxml.engine.tree import Tree
from btxml.files.compile.registry import Registry
from btxml.views.palette import models

CODES = {Status.INVALID: 0, Status.RUNNING: 1, Status.SUCCESS: 2, Status.FAILURE: 3, SKIPPED: 4}
# A node that went idle is shown as this plus what it was before; in recorded transitions it is idle and no more.
WAS = 10
RECORDED_TRANSITIONS = 1000
_STATUS = struct.Struct("<HB")


def tree_xml(tree: Tree, registry: Registry) -> str:
    """The tree as it runs: one BehaviorTree for every place where a SubTree stands, and a model of every node."""
    lines = [f'<root BTCPP_format="4" main_tree_to_execute={quoteattr(tree.name)}>']
    waiting = [(tree.name, "", tree.root)]
    while waiting:
        identifier, path, root = waiting.pop(0)
        lines.append(f"  <BehaviorTree ID={quoteattr(identifier)} _fullpath={quoteattr(path)}>")
        lines += _node_lines(tree, root, waiting)
        lines.append("  </BehaviorTree>")
    return "\n".join([*lines, *models(registry.classes, registry), "</root>", ""])


def blackboards(tree: Tree, names: Iterable[str]) -> dict[str, dict[str, Any]]:
    """Entries that are set, by (Sub)Tree; one that is remapped stands only in the outermost tree that names it.

    Args:
        names: of trees: the main tree's ID, or a SubTree's path; one that does not exist is left out.
    """
    found: dict[str, dict[str, Any]] = {scope.name or tree.name: {} for scope in tree.scopes}
    for name, key, entry in entries_of(tree):
        if entry.value is not UNSET:
            found[name][key] = entry.value
    return {name: found[name] for name in names if name in found}


def entries_of(tree: Tree) -> Iterator[tuple[str, str, Entry]]:
    """(Sub)Tree, name and entry of each entry; one that is remapped in the outermost tree that names it."""
    known: set[int] = set()
    for scope in tree.scopes:
        own = [(key, scope.entry(key)) for key in scope]
        new = [(key, entry) for key, entry in own if id(entry) not in known]
        known.update(id(entry) for _, entry in new)
        yield from ((scope.name or tree.name, key, entry) for key, entry in new)


def code_of(change: StatusChange) -> int:
    """The status after a change, as a number."""
    idle = change.new is Status.INVALID and change.old is not Status.INVALID
    return WAS + CODES[change.old] if idle else CODES[change.new]


class StatusBoard:
    """Status of every node, kept by what changes, and the newest transitions while they are recorded."""

    def __init__(self, count: int) -> None:
        self._codes = [0] * count
        self._began_s: float | None = None
        self._transitions: deque[bytes] = deque(maxlen=RECORDED_TRANSITIONS)

    def update(self, changes: Sequence[StatusChange], time_s: float) -> None:
        """Note what changed in a tick at `time_s`."""
        for change in changes:
            self._codes[change.uid - 1] = code_of(change)
            if self._began_s is not None and change.old is not change.new:
                microseconds = max(0, round((time_s - self._began_s) * 1e6))
                self._transitions.append(
                    microseconds.to_bytes(6, "little") + _STATUS.pack(change.uid, CODES[change.new])
                )

    def statuses(self) -> bytes:
        """Uid and status of every node."""
        return b"".join(_STATUS.pack(uid, code) for uid, code in enumerate(self._codes, 1))

    def codes(self) -> dict[int, int]:
        """Status of every node by uid."""
        return dict(enumerate(self._codes, 1))

    def record(self, time_s: float) -> None:
        """Begin to keep transitions; their times count from now."""
        self._began_s = time_s
        self._transitions.clear()

    def stop_recording(self) -> None:
        """Keep what there is, add no more."""
        self._began_s = None

    def take_transitions(self) -> bytes:
        """The newest transitions since this was last asked: time in [us], uid, status."""
        taken = b"".join(self._transitions)
        self._transitions.clear()
        return taken


def _node_lines(tree: Tree, root: TreeNode, subtrees: list[tuple[str, str, TreeNode]]) -> Iterator[str]:
    """Lines of one tree down to its SubTrees, which are added to those that wait."""
    waiting: list[tuple[TreeNode | str, int]] = [(root, 2)]
    while waiting:
        node, depth = waiting.pop()
        indent = "  " * depth
        if isinstance(node, str):
            yield f"{indent}</{node}>"
            continue
        tag, written = tree.origins[node.uid - 1]
        values = {key: value for key, value in written.items() if key != "name"}
        values = {"name": node.name, **values, "_uid": str(node.uid)}
        children = node.children
        if tag == "SubTree":
            values["_fullpath"] = node.full_path
            subtrees.append((values["ID"], node.full_path, children[0]))
            children = []
        else:
            values.pop("ID", None)
        attributes = " ".join(f"{name}={quoteattr(value)}" for name, value in values.items())
        yield f"{indent}<{tag} {attributes}{'>' if children else '/>'}"
        if children:
            waiting.append((tag, depth))
        waiting += [(child, depth + 1) for child in reversed(children)]
