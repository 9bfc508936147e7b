"""The tree of a log as it stood at one time, in the form in which a running one is monitored."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass
from xml.etree import ElementTree

from cell.errors import LogError
from cell.log.read.reader import Log, LoggedTick, LogStream
from cell.log.replay.logged_tree import logged_tree
from trees.node_library import node_registry
from trees.views.groot2 import StatusBoard, tree_xml


@dataclass(frozen=True)
class TreeAt:
    """A tree and what its nodes did.

    Attributes:
        xml: the tree with SubTrees and uids, in Groot2's form.
        statuses: numbers in Groot2's protocol, by uid.
        said: what nodes said last, by uid.
        time_s: of the tick that is shown.
        last: a time was asked for, and this is the last tick of the log.
    """

    xml: ElementTree.Element
    statuses: dict[int, int]
    said: dict[int, str]
    time_s: float
    last: bool = False


def tree_at(log: Log | LogStream, at_s: float = math.inf, more: Iterable[str] = ()) -> TreeAt:
    """After the last tick up to a time [s]; by default the last tick in which the tree still ran.

    Raises:
        LogError: the log holds no tree, or no tick so early.
        InputError: this version cannot load the tree.
    """
    ticks = (tick for piece in log for tick in piece.ticks)
    now = next(ticks, None)
    if now is None or now.time_s > at_s:
        raise LogError(log.path, "holds no tick" + ("" if math.isinf(at_s) and at_s > 0 else f" up to {at_s:g} s"))
    tree = logged_tree(log, more)
    board, said = StatusBoard(len(tree.nodes)), dict[int, str]()
    _take(now, board, said)
    following = next(ticks, None)
    while following is not None and following.time_s <= at_s:
        after = next(ticks, None)
        if math.isinf(at_s) and after is None and following.status != "RUNNING":
            break  # the last one ends the tree, and with it every node
        now, following = following, after
        _take(now, board, said)
    xml = ElementTree.fromstring(tree_xml(tree, node_registry(more=more)))
    over = following is None and not math.isinf(at_s)
    return TreeAt(xml, board.codes(), said, now.time_s, over)


def _take(tick: LoggedTick, board: StatusBoard, said: dict[int, str]) -> None:
    board.update(tick.changes, tick.time_s)
    said |= {change.uid: change.feedback for change in tick.changes}
