"""A tree on one HTML page: a file's, or a log's with a time line of statuses, blackboard and reasons."""

from __future__ import annotations

import json
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from markupsafe import Markup

from bracket_cell.log.read.reader import Log, LoggedTick
from bracket_cell.log.replay.loading import Changes
from bracket_cell.log.replay.logged_tree import logged_tree
from bracket_cell.log.replay.replay import Replay, Step
from bracket_cell.log.report.html_page import rendered, write_page
from bracket_cell.recording.schemas import plain_or_text
from bracket_cell.running.controller import STOPPED, STOPPING
from bracket_ground.errors import LogError
from btxml.engine.node import TreeNode
from btxml.engine.tree import Tree
from btxml.files.compile.registry import Registry, meaning_of
from btxml.files.loader import build
from btxml.views.groot2 import StatusBoard, blackboards
from btxml.views.show import read_checked, reading_order

TEMPLATE = Path(__file__).with_name("tree.html.j2")
LETTERS_MAX = 400  # of a value on the blackboard


def write_file_page(file: Path, registry: Registry, beside: Iterable[Path], path: Path) -> int:
    """The main tree with all SubTrees in their places; all trees where a file names no main tree.

    Returns:
        size of the page [bytes].

    Raises:
        TreeFileError: everything that is wrong with the file.
        InputError: the page cannot be written.
    """
    library = read_checked(file, registry, beside)
    names = [library.main] if library.main else reading_order(library)
    parts = [_part(build(library, registry, name, {})[0]) for name in names]
    return _write(path, file.name, parts, None, [])


def write_log_page(log: Log, nodes: Iterable[str], beside: Iterable[Path], path: Path) -> int:
    """The tree of a log at each of its ticks.

    The log is replayed, as it holds no blackboard. What cannot be replayed has statuses and reasons
    alone, and the page says so.

    Returns:
        size of the page [bytes].

    Raises:
        LogError: the log holds no tree, or no tick.
        InputError: this version cannot load the tree, or the page cannot be written.
    """
    line, remarks = _TimeLine(), [log.unfinished] if log.unfinished else []
    try:
        replay = Replay(log, Changes(nodes=tuple(nodes), beside=tuple(beside)))
    except LogError as error:
        remarks.append(f"without blackboard: {error}")
        line.parts.append(_part(logged_tree(log, nodes)))
        for tick in log.ticks:
            line.take(tick, {})
    else:
        differs = line.follow(replay)
        remarks += [*replay.remarks, *([differs] if differs else [])]
    return _write(path, log.path.name, line.parts, line.plain(), remarks)


@dataclass
class _TimeLine:
    """The ticks of a log, each as what changed in it; words stand once and are named by number.

    Attributes:
        parts: trees in the order in which they ran.
    """

    parts: list[dict[str, Any]] = field(default_factory=list)
    ticks: list[list[Any]] = field(default_factory=list)
    words: dict[str, int] = field(default_factory=lambda: {"": 0})
    board: StatusBoard | None = None
    entries: dict[str, str] = field(default_factory=dict)
    why: Mapping[str, Any] = field(default_factory=dict)

    def follow(self, replay: Replay) -> str:
        """Replay a log to its end; says from when on it does not go as it was."""
        trees, differs = list[Tree](), list[str]()

        def watch(step: Step) -> None:
            if not trees or trees[-1] is not replay.tree:
                trees.append(replay.tree)
                self.parts.append(_part(replay.tree))
                self.board = None
            if step.differences and not differs:
                since = f"from {step.logged.time_s:.2f} s on the replay differs"
                differs.append(f"{since}: the blackboard is that of the replay")
            self.take(step.logged, _entries(replay.tree))

        replay.run(watch=watch)
        return "".join(differs)

    def take(self, tick: LoggedTick, entries: Mapping[str, str]) -> None:
        """One more tick: [part, number, time s, root, statuses, entries, reason, what if, leaf]."""
        part = len(self.parts) - 1
        if self.board is None:
            self.board = StatusBoard(len(self.parts[part]["nodes"]))
        before = self.board.codes()
        self.board.update(tick.changes, tick.time_s)
        after, said = self.board.codes(), {change.uid: change.feedback for change in tick.changes}
        changed = [
            [uid, code, self._word(said[uid])] for uid, code in after.items() if uid in said or before[uid] != code
        ]
        gone = {key: None for key in self.entries if key not in entries}
        written = {key: self._word(text) for key, text in entries.items() if self.entries.get(key) != text}
        self.entries = dict(entries)
        for fields in (fields for topic, fields in tick.notes if topic == "why"):
            self.why = fields
        why = {} if tick.status in (STOPPED, STOPPING) else self.why
        reason = [self._word(str(why.get(key, ""))) for key in ("text", "otherwise")]
        leaf = (why.get("tree") or {}).get("uid", 0)
        self.ticks.append(
            [
                part,
                tick.number,
                round(tick.time_s, 3),
                self._word(tick.status),
                changed,
                {**written, **gone},
                *reason,
                leaf,
            ]
        )

    def plain(self) -> dict[str, Any]:
        """For the page."""
        return {"ticks": self.ticks, "words": list(self.words)}

    def _word(self, text: str) -> int:
        return self.words.setdefault(text, len(self.words))


def _entries(tree: Tree) -> dict[str, str]:
    """What the blackboard holds, as text, by tree and name."""
    names = [scope.name or tree.name for scope in tree.scopes]
    found = blackboards(tree, names)
    return {f"{scope}\t{key}": _text(value) for scope, one in found.items() for key, value in one.items()}


def _text(value: object) -> str:
    text = value if isinstance(value, str) else json.dumps(plain_or_text(value), default=str)
    return text if len(text) <= LETTERS_MAX else text[: LETTERS_MAX - 1] + "…"


def _part(tree: Tree) -> dict[str, Any]:
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


def _write(path: Path, title: str, parts: list[dict[str, Any]], line: object, remarks: Iterable[str]) -> int:
    data = json.dumps({"parts": parts, "line": line}, separators=(",", ":"))
    safe = Markup(data.replace("<", "\\u003c"))  # no text of it ends the element that holds it
    return write_page(rendered(TEMPLATE, title=title, data=safe, remarks=list(remarks), timed=line is not None), path)
