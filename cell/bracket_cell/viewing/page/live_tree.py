"""The tree of a run on its page: while somebody looks, of each tick what changed, and why the robot does what it does.

The loop takes ticks; the server's thread asks for those that a page has not, which holds the loop up by nothing.
"""

from __future__ import annotations

import secrets
import time
from collections import deque
from typing import Any

import orjson

from bracket_cell.running.controller import STOPPED, STOPPING
from bracket_cell.viewing.tree_moments import TreeMoments, part_of
from bracket_cell.watching.observer import TickRecord
from bracket_cell.watching.why_now import WhyNow
from bracket_ground.files.words.message import data_of
from btxml.engine.tree import Tree

KEPT_N = 1500  # ticks: half a minute, in which a page asks again
ASKED_S = 5.0  # of wall time without a question, after which nobody looks
WHY_S = 0.2  # of wall time, for which a reason is told again while no node changes: to find it takes a millisecond


class LiveTree:
    """Follows a run's tree; an edited one may take over."""

    def __init__(self, tree: Tree) -> None:
        self._run = secrets.token_hex(4)
        self._parts: list[bytes] = []
        self._ticks: deque[tuple[int, bool, bytes]] = deque(maxlen=KEPT_N)
        self._number, self._asked_s = 0, float("-inf")
        self._why_now, self._why, self._why_s = WhyNow(lambda: self._tree), ("", "", 0), float("-inf")
        self.watch(tree)

    def watch(self, tree: Tree) -> None:
        """Show this tree from now on."""
        self._tree, self._moments, self._whole = tree, TreeMoments(), True
        self._parts = [*self._parts, orjson.dumps(part_of(tree))]

    def take(self, record: TickRecord) -> None:
        """One more tick; while nobody looks it is only followed."""
        self._why_now.tick(record)
        if time.monotonic() - self._asked_s > ASKED_S:
            self._moments.follow(record.changes)
            self._whole = True
            return
        whole, self._whole = self._whole, False
        nodes, entries = self._moments.moment(record.changes, self._tree, whole)
        statuses = [(uid, code, data_of(words)) for uid, code, words in nodes]
        seen = record.observation
        row = (len(self._parts) - 1, seen.tick, round(seen.time_s, 3), record.status, statuses, entries)
        self._number += 1
        self._ticks.append((self._number, whole, orjson.dumps((*row, *self._reason(record), whole))))

    def _reason(self, record: TickRecord) -> tuple[str, str, int]:
        """Why, what would have changed it, and the leaf that decides."""
        if record.status in (STOPPED, STOPPING):
            return "", "", 0
        if (now_s := time.monotonic()) - self._why_s >= WHY_S or record.changes:
            why = self._why_now()
            leaf = 0 if why.reason is None else why.reason.leaf.uid
            self._why, self._why_s = (str(why), why.otherwise, leaf), now_s
        return self._why

    def since(self, run: str, number: int, parts: int) -> bytes:
        """What a page has not: trees, and ticks after a number; all of the newest where those are gone. Any thread.

        Args:
            run: as it was told with the ticks that the page has.
            parts: how many trees it has.
        """
        self._asked_s = time.monotonic()
        ticks, same = list(self._ticks), run == self._run
        first = next((at for at, tick in enumerate(ticks) if same and tick[0] == number + 1), len(ticks))
        if first == len(ticks) and not (same and ticks and ticks[-1][0] == number):
            first = max((at for at, tick in enumerate(ticks) if tick[1]), default=len(ticks))
            self._whole |= first == len(ticks)
        fields: dict[str, Any] = {
            "run": self._run,
            "number": ticks[-1][0] if ticks[first:] else number if same else 0,
            "parts": [orjson.Fragment(part) for part in self._parts[parts if same else 0 :]],
            "ticks": [orjson.Fragment(tick[2]) for tick in ticks[first:]],
        }
        return orjson.dumps(fields)
