"""The tree of a log as it stood at one time, in the form in which a running one is monitored."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass
from xml.etree import ElementTree

from cell.interfaces.errors import LogError
from cell.log.reading.reader import Log
from cell.log.replaying.logged_tree import logged_tree
from cell.running.node_library import node_registry
from trees.views.groot2 import StatusBoard, tree_xml


@dataclass(frozen=True)
class TreeAt:
    """A tree and what its nodes did.

    Attributes:
        xml: the tree with SubTrees and uids, in Groot2's form.
        statuses: numbers in Groot2's protocol, by uid.
        said: what nodes said last, by uid.
        time_s: of the tick that is shown.
    """

    xml: ElementTree.Element
    statuses: dict[int, int]
    said: dict[int, str]
    time_s: float


def tree_at(log: Log, at_s: float = math.inf, more: Iterable[str] = ()) -> TreeAt:
    """After the last tick up to a time [s]; by default the last tick in which the tree still ran.

    Raises:
        LogError: the log holds no tree, or no tick so early.
        InputError: this version cannot load the tree.
    """
    wanted = [tick for tick in log.ticks if tick.time_s <= at_s]
    if not wanted:
        raise LogError(log.path, f"holds no tick up to {at_s:g} s")
    if math.isinf(at_s) and len(wanted) > 1 and wanted[-1].status != "RUNNING":
        wanted.pop()  # the last one ends the tree, and with it every node
    tree = logged_tree(log, more)
    board = StatusBoard(len(tree.nodes))
    said: dict[int, str] = {}
    for tick in wanted:
        board.update(tick.changes, tick.time_s)
        said |= {change.uid: change.feedback for change in tick.changes}
    xml = ElementTree.fromstring(tree_xml(tree, node_registry(more=more)))
    return TreeAt(xml, board.codes(), said, wanted[-1].time_s)
