"""A running tree as an editor's debugger shows it: breakpoints by line, what waits, its path, and the blackboard.

The words are those of the Debug Adapter Protocol: https://microsoft.github.io/debug-adapter-protocol/specification.
"""

from __future__ import annotations

import json
from collections import defaultdict
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

from bracket_cell.viewing.live_view import MonitorClient
from bracket_cell.viewing.stepping import RUNNING, WAITS, Stepper
from bracket_ground.errors import InputError

Body = dict[str, Any]
TREE = 1  # the thread of the whole tree, which can be paused; a node that waits is one of its own, uid + 1
STATUSES = "cell.statuses"  # an event of our own: by file and line what its node does, as a number of Groot2's
LIVELIEST = (RUNNING, 3, 2, 4, 13, 12, 14, 11, 0)  # first of nodes in one line, as in a SubTree that is used twice


class Debugged:
    """The tree that runs now, by uid.

    Attributes:
        places: file and line.
        above: the node above, through SubTrees.
        labels: what a person calls a node.
        scopes: the tree whose blackboard a node sees, as the monitor names it.
    """

    def __init__(self, xml: ElementTree.Element, places: Sequence[tuple[str, int]]) -> None:
        self.places = {uid: (Path(file), line) for uid, (file, line) in enumerate(places, 1) if file}
        self.above: dict[int, int] = {}
        self.labels: dict[int, str] = {}
        self.scopes: dict[int, str] = {}
        inner = {subtree.get("_fullpath", ""): int(subtree.get("_uid", "0")) for subtree in xml.iter("SubTree")}
        for tree in xml.iter("BehaviorTree"):
            path = tree.get("_fullpath", "")
            self._note(tree, inner.get(path, 0), path or tree.get("ID", ""))

    def _note(self, element: ElementTree.Element, above: int, scope: str) -> None:
        waiting = [(child, above) for child in element]
        while waiting:
            node, over = waiting.pop()
            uid, tag, name = int(node.get("_uid", "0")), node.tag, node.get("name", "")
            title = node.get("ID", tag) if tag == "SubTree" else tag
            self.above[uid], self.scopes[uid] = over, scope
            self.labels[uid] = title if name in ("", title) else f"{title} {name}"
            waiting += [(child, uid) for child in node]

    def at(self, file: Path, line: int) -> tuple[int, set[int]]:
        """The first line from here on in which nodes stand, and these; 0 where there is none."""
        lines = [at for place, at in self.places.values() if place == file and at >= line]
        found = min(lines, default=0)
        return found, {uid for uid, place in self.places.items() if place == (file, found)}

    def path(self, uid: int) -> Iterator[int]:
        """A node and all above it, up to the root."""
        while uid:
            yield uid
            uid = self.above.get(uid, 0)

    def by_line(self, statuses: Mapping[int, int]) -> dict[str, dict[int, int]]:
        """What the nodes of each line do, by file."""
        found: dict[str, dict[int, int]] = defaultdict(dict)
        for uid, (file, line) in self.places.items():
            code = statuses.get(uid, 0)
            lines = found[str(file)]
            lines[line] = min(code, lines.get(line, 0), key=LIVELIEST.index)
        return dict(found)


class Debugger:
    """One editor's session with one running tree.

    Args:
        port: of the monitor.
        send: takes an event, by its name, for the editor.

    Attributes:
        running: the run is there; it was, where `over`.
    """

    def __init__(self, port: int, send: Callable[[str, Body], object]) -> None:
        self._client, self._send = MonitorClient(port), send
        self._tree: Debugged | None = None
        self._stepper = Stepper(ElementTree.Element("root"), self._client.order)
        self._shown = b""
        self._wanted: dict[Path, dict[int, int]] = {}  # numbers of breakpoints by line
        self._set: set[int] = set()
        self._number = 0
        self._said: Mapping[int, str] = {}
        self._statuses: Mapping[int, int] = {}
        self._lines: dict[str, dict[int, int]] = {}
        self._waiting: set[int] = set()
        self._entries: dict[str, Any] = {}
        self._steps = False
        self.over = False

    def poll(self) -> None:
        """Ask what became of the run since the last time, and tell the editor."""
        try:
            if self._tree is None:
                self._meet()
            said, statuses = self._client.said(), self._client.statuses()
            if self._client.identity != self._shown:
                self._meet()
                return
        except InputError:
            self.over = self._tree is not None
            return
        self._said, self._statuses = said, statuses
        self._stepper.keep(statuses, said)
        self._tell_lines()
        self._tell_stops({uid for uid, text in said.items() if text == WAITS})

    def leave(self) -> None:
        """Take the breakpoints away and hang up."""
        if self._tree is not None and not self.over:
            self._stepper.leave()
        self._client.close()

    def _meet(self) -> None:
        """Look at a tree that is new here, and set the breakpoints in it."""
        xml = self._client.tree()
        self._tree, self._shown = Debugged(xml, self._client.places()), self._client.identity
        self._stepper, self._waiting = Stepper(xml, self._client.order), set()
        for file in self._wanted:
            for line, number in self._wanted[file].items():
                self._send("breakpoint", {"reason": "changed", "breakpoint": self._told(file, line, number)})
        self._break()

    def _break(self) -> None:
        if self._tree is None:
            return
        wanted = {uid for file, lines in self._wanted.items() for line in lines for uid in self._tree.at(file, line)[1]}
        self._stepper.stop_before(wanted)
        self._set = wanted

    def _told(self, file: Path, line: int, number: int) -> Body:
        """A breakpoint as the editor is told of it."""
        answer: Body = {"id": number, "verified": False, "line": line}
        if self._tree is None:
            return {**answer, "message": "waits for the run"}
        found, _ = self._tree.at(file, line)
        missing = "no node of the running tree stands here or below"
        return {**answer, "verified": True, "line": found} if found else {**answer, "message": missing}

    def _tell_lines(self) -> None:
        lines = {} if self._tree is None else self._tree.by_line(self._statuses)
        if lines != self._lines:
            self._lines = lines
            self._send(STATUSES, lines)

    def _tell_stops(self, waiting: set[int]) -> None:
        for uid in sorted(self._waiting - waiting):
            self._send("thread", {"reason": "exited", "threadId": uid + 1})
        for uid in sorted(waiting - self._waiting):
            reason = "breakpoint" if uid in self._set else "step" if self._steps else "pause"
            self._send("stopped", {"reason": reason, "threadId": uid + 1, "allThreadsStopped": False})
        self._waiting = waiting

    # what an editor asks; InputError is told to the person

    def set_breakpoints(self, asked: Body) -> Body:
        """The breakpoints of one file, in place of those of before."""
        file = Path(asked["source"]["path"]).resolve()
        lines = [point["line"] for point in asked.get("breakpoints", ())]
        self._wanted[file] = {line: self._number + place for place, line in enumerate(lines, 1)}
        self._number += len(lines)
        self._break()
        return {"breakpoints": [self._told(file, line, self._wanted[file][line]) for line in lines]}

    def threads(self, _: Body) -> Body:
        """The tree, and each node that waits."""
        labels = {} if self._tree is None else self._tree.labels
        nodes = [{"id": uid + 1, "name": f"waits: {labels.get(uid, '')}"} for uid in sorted(self._waiting)]
        return {"threads": [*nodes, {"id": TREE, "name": "tree"}]}

    def stack_trace(self, asked: Body) -> Body:
        """The node that waits, and the nodes above it."""
        tree, frames = self._tree, list[Body]()
        for uid in [] if tree is None else tree.path(asked["threadId"] - 1):
            assert tree is not None
            file, line = tree.places.get(uid, (None, 0))
            source = {} if file is None else {"source": {"name": file.name, "path": str(file)}}
            frames.append({"id": uid, "name": tree.labels[uid], "line": line, "column": 1, **source})
        return {"stackFrames": frames, "totalFrames": len(frames)}

    def scopes(self, asked: Body) -> Body:
        """All blackboards, that of the node first."""
        self._entries = self._client.blackboards()
        own = "" if self._tree is None else self._tree.scopes.get(asked["frameId"], "")
        names = sorted(self._entries, key=lambda name: name != own)
        order = list(self._entries)
        scopes = [{"name": name, "variablesReference": order.index(name) + 1, "expensive": False} for name in names]
        return {"scopes": scopes}

    def variables(self, asked: Body) -> Body:
        """The entries of one blackboard."""
        entries = list(self._entries.values())[asked["variablesReference"] - 1] or {}
        variables = [{"name": key, "value": _text(value), "variablesReference": 0} for key, value in entries.items()]
        return {"variables": variables}

    def evaluate(self, asked: Body) -> Body:
        """An entry by its name, with or without braces, as the node sees it, else of any tree."""
        name, frame = asked["expression"].strip(" {}"), asked.get("frameId", 0)
        own = "" if self._tree is None else self._tree.scopes.get(frame, "")
        boards = self._client.blackboards()
        for board in (boards.get(own), *boards.values()):
            if name in (board or {}):
                return {"result": _text(board[name]), "variablesReference": 0}
        raise InputError(f"no blackboard has an entry {name!r}")

    def pause(self, _: Body) -> Body:
        """Let no action begin any more."""
        self._steps = False
        if not self._stepper.paused:
            self._stepper.press("p", self._said)
        return {}

    def step(self, asked: Body) -> Body:
        """Let one node begin; the next action waits again."""
        self.pause(asked)
        self._steps = True
        self._stepper.keep(self._statuses, self._said)
        return self._begin(asked)

    def go_on(self, asked: Body) -> Body:
        """Let a node begin, and all others up to the next breakpoint."""
        if self._stepper.paused:
            self._stepper.press("p", self._said)
        self._begin(asked)
        return {"allThreadsContinued": False}

    def _begin(self, asked: Body) -> Body:
        uid = asked["threadId"] - 1
        if uid in self._waiting:
            if uid in self._set or self._stepper.paused:
                self._stepper.let(uid)
            self._waiting.discard(uid)
        return {}


def _text(value: object) -> str:
    return value if isinstance(value, str) else json.dumps(value, default=str)
