"""A tree on one HTML page: a file's, or a log's with a time line of statuses, blackboard and reasons."""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from markupsafe import escape

from bracket_cell.log.read.reader import Log, LoggedTick
from bracket_cell.log.replay.loading import Changes
from bracket_cell.log.replay.logged_tree import logged_tree
from bracket_cell.log.replay.replay import Replay, Step
from bracket_cell.log.report.html_page import write_page
from bracket_cell.running.controller import STOPPED, STOPPING
from bracket_cell.viewing import page
from bracket_cell.viewing.tree_moments import TreeMoments, part_of
from bracket_ground.errors import LogError
from btxml.engine.tree import Tree
from btxml.files.compile.registry import Registry
from btxml.files.loader import build
from btxml.views.show import read_checked, reading_order

ICON = "static/icon.svg"
STYLE = '<link rel="stylesheet" href="static/tree.css">'
STATIC = Path(page.__file__).with_name("static")
SCRIPT = '<script src="static/tree.js"></script>'


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
    parts = [part_of(build(library, registry, name, {})[0]) for name in names]
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
        line.parts.append(part_of(logged_tree(log, nodes)))
        for tick in log.ticks:
            line.take(tick, None)
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
    moments: TreeMoments = field(default_factory=TreeMoments)
    why: Mapping[str, Any] = field(default_factory=dict)

    def follow(self, replay: Replay) -> str:
        """Replay a log to its end; says from when on it does not go as it was."""
        trees, differs = list[Tree](), list[str]()

        def watch(step: Step) -> None:
            if not trees or trees[-1] is not replay.tree:
                trees.append(replay.tree)
                self.parts.append(part_of(replay.tree))
                self.moments = TreeMoments()
            if step.differences and not differs:
                since = f"from {step.logged.time_s:.2f} s on the replay differs"
                differs.append(f"{since}: the blackboard is that of the replay")
            self.take(step.logged, replay.tree)

        replay.run(watch=watch)
        return "".join(differs)

    def take(self, tick: LoggedTick, tree: Tree | None) -> None:
        """One more tick: [part, number, time s, root, statuses, entries, reason, what if, leaf]."""
        nodes, entries = self.moments.moment(tick.changes, tree)
        for fields in (fields for topic, fields in tick.notes if topic == "why"):
            self.why = fields
        why = {} if tick.status in (STOPPED, STOPPING) else self.why
        row: list[Any] = [len(self.parts) - 1, tick.number, round(tick.time_s, 3), self._word(tick.status)]
        row += [[(uid, code, self._word(said)) for uid, code, said in nodes]]
        row += [{key: None if text is None else self._word(text) for key, text in entries.items()}]
        row += [self._word(str(why.get(key, ""))) for key in ("text", "otherwise")]
        self.ticks.append([*row, (why.get("tree") or {}).get("uid", 0)])

    def plain(self) -> dict[str, Any]:
        """For the page."""
        return {"ticks": self.ticks, "words": list(self.words)}

    def _word(self, text: str) -> int:
        return self.words.setdefault(text, len(self.words))


def _write(path: Path, title: str, parts: list[dict[str, Any]], line: object, remarks: Iterable[str]) -> int:
    """The page that `cell run --page` serves of its tree, as one file with all that it needs."""
    fields = {"title": title, "remarks": list(remarks), "parts": parts, "line": line}
    data = json.dumps(fields, separators=(",", ":")).replace("<", "\\u003c")  # no text ends the element that holds it
    style, script = ((STATIC / name).read_text() for name in ("tree.css", "tree.js"))
    text = (STATIC / "tree.html").read_text().replace("<title>tree</title>", f"<title>{escape(title)}</title>")
    text = text.replace(ICON, "data:,").replace(STYLE, f"<style>\n{style}</style>")
    held = f'<script type="application/json" id="data">{data}</script>'
    return write_page(text.replace(SCRIPT, f"{held}\n<script>\n{script}</script>"), path)
