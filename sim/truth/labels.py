"""What the hand did in a moment, as action detectors learn it.

The class of a segment is that of its last frame. An assembly of part o at position p lasts from 0.5 s before the
fingers open over the hole to 0.4 s after; carrying before that, putting back and hesitating are transit, and so is a
hand that reaches into the arm's way, until it is back. Segments whose last frame lies within 0.2 s of a change of class
are told apart: nobody could name them.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from cell.interfaces.devices import TruthEvent
from cell.interfaces.perception import ActionKind
from cell.interfaces.pose import Array
from sim.worker.event_log import ActionEvent

BEFORE_RELEASE_S, AFTER_RELEASE_S = 0.5, 0.4
GUARD_S = 0.2


@dataclass(frozen=True)
class Label:
    """A class of actions.

    Attributes:
        part, position: of an assembly only.
        released: the fingers of this assembly have opened; no part of the class.
    """

    kind: ActionKind
    part: str | None = None
    position: str | None = None
    released: bool = field(default=False, compare=False)


def labels(actions: Sequence[ActionEvent], acts: Sequence[TruthEvent], times_s: Array) -> list[Label]:
    """The class at each of n times (n,), in order."""
    starts = [event for event in actions if event.edge == "start"]
    began_s = np.array([event.time_s for event in starts])
    found = []
    for index in np.searchsorted(began_s, times_s, side="right") - 1:
        kind: ActionKind = starts[index].kind if index >= 0 else "idle"
        found.append(Label("transit" if kind == "assembly" else kind))
    for begin_s, end_s in _intrusions(acts):
        for index in np.flatnonzero((times_s >= begin_s) & (times_s <= end_s)):
            found[index] = Label("transit")
    for release in acts:
        position = release.fields.get("position")
        if release.fields.get("act") != "release" or position is None:
            continue
        inside = (times_s >= release.time_s - BEFORE_RELEASE_S) & (times_s <= release.time_s + AFTER_RELEASE_S)
        for index in np.flatnonzero(inside):
            part, released = str(release.fields["part"]), bool(times_s[index] >= release.time_s)
            found[index] = Label("assembly", part, str(position), released)
    return found


def _intrusions(acts: Sequence[TruthEvent]) -> Iterator[tuple[float, float]]:
    """When the hand reached into the arm's way, and when it was back; the last one may never be."""
    began_s: float | None = None
    for act in acts:
        if act.fields.get("act") == "intrude":
            began_s = act.time_s
        elif act.fields.get("act") == "back" and began_s is not None:
            yield began_s, act.time_s
            began_s = None
    if began_s is not None:
        yield began_s, math.inf


def guarded(found: Sequence[Label], times_s: Array) -> NDArray[np.bool_]:
    """(n,) Whether a change of class is within GUARD_S of each time, as far as the samples show."""
    changes_s = np.array([(times_s[i] + times_s[i + 1]) / 2 for i in range(len(found) - 1) if found[i] != found[i + 1]])
    if not len(changes_s):
        return np.zeros(len(found), dtype=bool)
    near: NDArray[np.bool_] = np.abs(times_s[:, None] - changes_s[None, :]).min(axis=1) <= GUARD_S
    return near
