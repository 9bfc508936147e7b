"""What a log shows a person: node runs, beliefs, placements with their guidance, verdicts, waits and calls for help."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, replace
from itertools import pairwise
from pathlib import Path
from statistics import median
from typing import Any

from bracket_cell.log.read.frames import LINE, decoded
from bracket_cell.log.read.mcap_file import Message
from bracket_cell.log.read.reader import Log
from bracket_cell.log.replay.logged_tree import logged_tree
from bracket_ground.errors import InputError, LogError
from btxml.engine.status import SKIPPED, Status

JOIN_S = 0.13  # runs of one node that are closer than three ticks become one bar
SHORTEST_WAIT_S = 0.2
LINES = "/log"
LEVELS = {0: "info", 1: "info", 2: "info", 3: "warning"}  # by the numbers of foxglove.Log
ENDINGS = {Status.SUCCESS: "success", Status.FAILURE: "failure", Status.INVALID: "halted", SKIPPED: "skipped"}


@dataclass(frozen=True)
class NodeRun:
    """A node was RUNNING from one time to another; `ending` is success, failure, halted or running."""

    begin_s: float
    end_s: float
    ending: str
    feedback: str


@dataclass(frozen=True)
class NodeRow:
    """All runs of one node; `decided` where it let the whole tree fail, or not end in time."""

    uid: int
    path: str
    runs: tuple[NodeRun, ...]
    decided: bool = False

    @property
    def name(self) -> str:
        """Short name: the last part of the path without its number."""
        return _short(self.path)

    @property
    def place(self) -> str:
        """The SubTrees that it stands in."""
        parts = [part.partition("::")[0] for part in self.path.split("/")[:-1]]
        return " / ".join(parts)


@dataclass(frozen=True)
class Belief:
    """Probabilities of the goals from a time on."""

    time_s: float
    goals: Mapping[str, float]
    placed: Mapping[str, str]


@dataclass(frozen=True)
class Placed:
    """A part came to a position of the graph, and what the guidance had said of it.

    Attributes:
        advice: positions that the guidance showed before, for this part type or for any.
        goal: most probable goal after it; empty where no belief followed.
        confirms: this part was known to be there already.
    """

    time_s: float
    part: str
    position: str
    source: str
    advice: tuple[str, ...]
    goal: str
    confirms: bool

    @property
    def as_advised(self) -> bool:
        return self.position in self.advice


@dataclass(frozen=True)
class Verdict:
    """What the guard said."""

    time_s: float
    subject: str
    decision: str
    reason: str


@dataclass(frozen=True)
class Wait:
    """The robot waited or asked; `length_s` is None for a request."""

    time_s: float
    length_s: float | None
    what: str


@dataclass(frozen=True)
class Line:
    """What the controller said; `level` is info, warning or error, `count` how often it said so in a row."""

    time_s: float
    level: str
    text: str
    count: int = 1


@dataclass(frozen=True)
class Overrun:
    """A tick that took longer than its period, and the first node whose status changed in it; empty for none."""

    number: int
    time_s: float
    wall_ms: float
    node: str


def tick_period_s(log: Log) -> float:
    """Of most ticks, in [s]."""
    gaps = [b.time_s - a.time_s for a, b in pairwise(log.ticks)]
    return median(gaps) if gaps else 0.04


def node_rows(log: Log) -> list[NodeRow]:
    """Leaves that were RUNNING over a tick or more, in the order of the tree.

    Where this version cannot load the log's tree, controls and decorators are among them.
    """
    raw: dict[int, list[NodeRun]] = {}
    paths: dict[int, str] = {}
    open_runs: dict[int, tuple[float, str]] = {}
    for tick in log.ticks:
        for change in tick.changes:
            paths[change.uid] = change.path
            if change.new is Status.RUNNING:
                begin_s, _ = open_runs.get(change.uid, (tick.time_s, ""))
                open_runs[change.uid] = (begin_s, change.feedback)
            elif change.uid in open_runs:
                begin_s, feedback = open_runs.pop(change.uid)
                run = NodeRun(begin_s, tick.time_s, ENDINGS[change.new], change.feedback or feedback)
                raw.setdefault(change.uid, []).append(run)
    end_s = log.ticks[-1].time_s if log.ticks else 0.0
    for uid, (begin_s, feedback) in open_runs.items():
        raw.setdefault(uid, []).append(NodeRun(begin_s, end_s, "running", feedback))
    leaves = _leaves(log)
    return [
        NodeRow(uid, paths[uid], tuple(_joined(runs)))
        for uid, runs in sorted(raw.items())
        if leaves is None or uid in leaves
    ]


def with_cause(rows: list[NodeRow], log: Log, why: Mapping[str, Any] | None) -> list[NodeRow]:
    """The node that let the tree fail is marked, and has a row, however short it was."""
    if why is None or not log.ticks:
        return rows
    failed = next((tick for tick in reversed(log.ticks) if tick.status == "FAILURE"), log.ticks[-1])
    mark = NodeRun(failed.time_s, failed.time_s, "decided", why["words"])
    known = {row.uid: row for row in rows}
    row = known.get(why["uid"], NodeRow(why["uid"], why["path"], ()))
    known[row.uid] = replace(row, runs=(*row.runs, mark), decided=True)
    return [known[uid] for uid in sorted(known)]


def beliefs(log: Log) -> list[Belief]:
    """The goal's distribution, each time that it was inferred."""
    noted = [(time_s, fields) for time_s, fields in _notes(log, "belief") if "goals" in fields]
    return [Belief(time_s, fields["goals"], fields.get("placed", {})) for time_s, fields in noted]


def placements(log: Log) -> list[Placed]:
    """Edges of the assembly graph as they were set, with what was advised before."""
    found: list[Placed] = []
    advice: Mapping[str, list[str]] = {}
    any_part: list[str] = []
    known: dict[str, str] = {}
    inferred = beliefs(log)
    for tick in log.ticks:
        for topic, fields in tick.notes:
            if topic == "belief" and fields.get("edge"):
                part, position = fields["edge"]
                after = next((belief.goals for belief in inferred if belief.time_s >= tick.time_s), None)
                goal = max(after, key=lambda name: after[name]) if after else ""
                advised = (*(advice.get(part) or ()), *any_part)
                again, known[position] = known.get(position) == part, part
                source = fields.get("source", "")
                found.append(Placed(tick.time_s, part or "nothing", position, source, advised, goal, again))
            elif topic == "plan" and "guidance" in fields:
                advice, any_part = fields["guidance"], fields.get("any_part", [])
    return found


def verdicts(log: Log) -> list[Verdict]:
    """What the guard said, in order."""
    keys = ("subject", "decision", "reason")
    return [Verdict(time_s, *(str(fields.get(key)) for key in keys)) for time_s, fields in _notes(log, "verdict")]


def waits(log: Log, rows: list[NodeRow]) -> list[Wait]:
    """Runs of the nodes whose name begins with Wait, verdicts to wait, and calls for help, in order."""
    found = [
        Wait(run.begin_s, run.end_s - run.begin_s, run.feedback or row.name)
        for row in rows
        if row.name.startswith("Wait")
        for run in row.runs
        if run.end_s - run.begin_s >= SHORTEST_WAIT_S
    ]
    found += [Wait(time_s, None, str(fields.get("text"))) for time_s, fields in _notes(log, "help")]
    return sorted(found, key=lambda wait: wait.time_s)


def lines_from(path: Path, messages: Iterable[Message]) -> list[Line]:
    """What the controller said, in order; what it repeats is one line, from the first time on.

    Args:
        path: of the log, for what is wrong.

    Raises:
        LogError: a line of the log is damaged.
    """
    found: list[Line] = []
    for message in messages:
        if message.topic != LINES:
            continue
        said = decoded(path, message, LINE)
        line = Line(message.time_ns / 1e9, LEVELS.get(said.level, "error"), said.message)
        if found and (found[-1].level, found[-1].text) == (line.level, line.text):
            found[-1] = replace(found[-1], count=found[-1].count + 1)
        else:
            found.append(line)
    return found


def overruns(log: Log) -> list[Overrun]:
    """Ticks that took too long, the worst first."""
    found = [
        Overrun(tick.number, tick.time_s, 1e3 * tick.wall_s, next((_short(c.path) for c in tick.changes), ""))
        for tick in log.ticks
        if tick.overrun
    ]
    return sorted(found, key=lambda overrun: -overrun.wall_ms)


def _notes(log: Log, of: str) -> Iterator[tuple[float, Mapping[str, Any]]]:
    return ((tick.time_s, fields) for tick in log.ticks for topic, fields in tick.notes if topic == of)


def _short(path: str) -> str:
    return path.rpartition("/")[2].partition("::")[0]


def _leaves(log: Log) -> set[int] | None:
    try:
        tree = logged_tree(log)
    except (LogError, InputError):
        return None
    return {node.uid for node in tree.nodes if not node.children}


def _joined(runs: list[NodeRun]) -> Iterator[NodeRun]:
    """Runs with the short pauses between them closed, so that a node that flickers is one bar."""
    current: NodeRun | None = None
    for run in runs:
        if current is not None and run.begin_s - current.end_s <= JOIN_S:
            run = NodeRun(current.begin_s, run.end_s, run.ending, run.feedback)
        elif current is not None:
            yield current
        current = run
    if current is not None:
        yield current
