"""What every node of a tree did in a run: how often it was ticked, how long it ran, how it ended."""

from __future__ import annotations

from array import array
from collections import Counter
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from statistics import median

from bracket_cell.log.read.reader import Log, LoggedTick, LogStream
from btxml.engine.status import FAILURE, IDLE, RUNNING, SKIPPED, SUCCESS

TICK_S = 0.04  # of a log that holds only one


@dataclass
class NodeStatistics:
    """One node over a whole run.

    Attributes:
        ticks: in which it answered, as far as changes of its status tell.
        running_s: time in which it was RUNNING; a node that ends in the tick that begins it takes none.
        success, failure, skipped, halted: how often it ended so; `halted` counts what was RUNNING.
        reason: what it said at its last failure.
    """

    uid: int
    path: str
    ticks: int = 0
    running_s: float = 0.0
    success: int = 0
    failure: int = 0
    skipped: int = 0
    halted: int = 0
    reason: str = ""


def node_statistics(log: Log | LogStream, from_s: float = 0.0, until_s: float = float("inf")) -> list[NodeStatistics]:
    """Of every node that was ticked in a span of time [s], in the order of the tree."""
    nodes: dict[int, NodeStatistics] = {}
    running: set[int] = set()
    ran: Counter[int] = Counter()
    gaps_s, before_s = array("d"), None
    for tick in (tick for piece in log for tick in piece.ticks):
        if before_s is not None:
            gaps_s.append(tick.time_s - before_s)
        before_s = tick.time_s
        counted = from_s <= tick.time_s <= until_s
        touched = _follow(tick, nodes, running, counted)
        for uid in touched | running if counted else ():
            nodes[uid].ticks += 1
        ran.update(running if counted else ())
    for uid, ticks in ran.items():
        nodes[uid].running_s = ticks * (median(gaps_s) if gaps_s else TICK_S)
    return [nodes[uid] for uid in sorted(nodes) if nodes[uid].ticks]


def _follow(tick: LoggedTick, nodes: dict[int, NodeStatistics], running: set[int], counted: bool) -> set[int]:
    """Take a tick's changes; the nodes that it ticked, as far as changes tell."""
    touched: set[int] = set()
    for change in tick.changes:
        node = nodes.setdefault(change.uid, NodeStatistics(change.uid, change.path))
        (running.add if change.new is RUNNING else running.discard)(change.uid)
        if change.new is not IDLE:
            touched.add(change.uid)
        if counted:
            node.success += change.new is SUCCESS
            node.failure += change.new is FAILURE
            node.skipped += change.new is SKIPPED
            node.halted += change.new is IDLE and change.old is RUNNING
            if change.new is FAILURE:
                node.reason = change.feedback
    return touched


def statistics_lines(nodes: Iterable[NodeStatistics]) -> Iterator[str]:
    """As a table for people."""
    yield f"{'ticks':>7} {'runs [s]':>9} {'success':>8} {'failure':>8} {'skipped':>8} {'halted':>7}  node"
    for node in nodes:
        results = f"{node.success:>8} {node.failure:>8} {node.skipped:>8} {node.halted:>7}"
        reason = f"  -- {node.reason}" if node.reason else ""
        yield f"{node.ticks:>7} {node.running_s:>9.2f} {results}  {node.path}{reason}"
