"""From posteriors, frame after frame, to placements that are each told once, and to one steady action.

Two witnesses tell a placement: the hand, whose fingers open over a hole, and the hole, which is newly filled where the
hand placed something. Whichever is the first tells it.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cell.interfaces.model import Model
from learned.actions.classes import KINDS, Classes
from learned.actions.filled import Filled

Floats = NDArray[np.float64]


class EventSettings(Model):
    """When a placement counts as finished.

    Attributes:
        frames: posteriors that are looked at together.
        threshold: mean probability of "an assembly at this hole whose fingers have opened" over them.
        begins: probability of an assembly at a hole from which on evidence for its part is collected.
        sure: share of that evidence that one part must have; else the hand alone tells nothing.
        again_s: a hole that was told is told again only after so long without an assembly at it.
        report_s: how long a finished assembly is told.
        keep: probability below which a screw action that goes on is given up.
        shown_reads, shown_confidence: when a hole that was empty counts as newly filled, see `FilledHoles`.
        shown_evidence: sum over the frames of the probability of an assembly at a hole from which on a newly filled
            hole shows that the assembly is finished.
        shown_s: for so long a newly filled hole waits for the hand to let go, unless the hand turns to other things.
    """

    frames: int = 3
    threshold: float = 0.5
    begins: float = 0.3
    sure: float = 0.6
    again_s: float = 1.0
    report_s: float = 0.7
    keep: float = 0.3
    shown_reads: int = 2
    shown_confidence: float = 0.9
    shown_evidence: float = 0.5
    shown_s: float = 0.6


@dataclass(frozen=True)
class Placement:
    """A finished assembly.

    Attributes:
        posterior: (parts,) which part it was.
        shown: its hole, newly filled, told that it was finished before the hand's movement did.
    """

    part: int
    position: int
    time_s: float
    posterior: tuple[float, ...]
    shown: bool = False


class PlacementEvents:
    """Collects evidence for each hole; asked once for every frame."""

    def __init__(self, classes: Classes, settings: EventSettings) -> None:
        self._classes, self._settings = classes, settings
        self._shape = (len(classes.parts), len(classes.positions))
        self._recent: deque[Floats] = deque(maxlen=settings.frames)
        self._evidence = np.zeros(self._shape)
        self._last_s = np.full(self._shape[1], -np.inf)
        self._told = np.zeros(self._shape[1], bool)
        self._filled: dict[int, tuple[Filled, float]] = {}  # by position, and since when
        self._awaited = np.zeros(self._shape[1], bool)  # told, and not yet shown by its hole

    def update(
        self, time_s: float, posterior: Floats, released: float, filled: Iterable[Filled] = ()
    ) -> Placement | None:
        """The placement that this frame finishes.

        Args:
            posterior: (classes,).
            released: probability that the fingers have opened, if it is an assembly.
            filled: holes that are newly filled.
        """
        pairs = posterior[: self._classes.assemblies].reshape(self._shape)
        at_hole = pairs.sum(axis=0)
        self._forget(time_s, at_hole)
        active = at_hole > self._settings.begins
        self._evidence[:, active] += pairs[:, active]
        self._recent.append(at_hole * released)
        finished = np.mean(self._recent, axis=0) * (len(self._recent) / self._settings.frames)
        position = int(np.argmax(np.where(self._told, 0.0, finished)))
        for one in filled:
            self._wait(time_s, one)
        if not self._told[position] and finished[position] >= self._settings.threshold and self._sure(position):
            self._awaited[position] = True
            return self._placement(time_s, position, self._evidence[:, position], shown=False)
        for position, (one, since_s) in list(self._filled.items()):
            if self._told[position] or not self._agrees(one):
                del self._filled[position]
            elif at_hole[position] <= self._settings.begins or time_s - since_s >= self._settings.shown_s:
                del self._filled[position]
                likely = np.full(self._shape[0], (1 - one.confidence) / self._shape[0])
                likely[one.part] = one.confidence
                return self._placement(time_s, position, self._evidence[:, position] * likely, shown=True)
        return None

    def _sure(self, position: int) -> bool:
        """Whether the hand's movement tells the part; else the hole is waited for."""
        evidence = self._evidence[:, position]
        return float(evidence.max()) >= self._settings.sure * float(evidence.sum())

    def _placement(self, time_s: float, position: int, evidence: Floats, *, shown: bool) -> Placement:
        self._told[position] = True
        share = evidence / max(float(evidence.sum()), 1e-9)
        return Placement(int(share.argmax()), position, time_s, tuple(float(value) for value in share), shown)

    def _wait(self, time_s: float, one: Filled) -> None:
        """A hole is newly filled: the hand has a while to tell it first, as fingers may still hold what is there."""
        if self._awaited[one.position]:
            self._awaited[one.position] = False
        elif not self._told[one.position] and self._agrees(one):
            self._filled[one.position] = one, time_s

    def _agrees(self, one: Filled) -> bool:
        """Whether the hand, too, seems to have placed this part there; where it does not, neither tells."""
        evidence = self._evidence[:, one.position]
        return float(evidence.sum()) >= self._settings.shown_evidence and int(evidence.argmax()) == one.part

    def _forget(self, time_s: float, at_hole: Floats) -> None:
        """What was seen at a hole counts no longer once no assembly was seen there for a while."""
        gone = time_s - self._last_s > self._settings.again_s
        self._evidence[:, gone] = 0.0
        self._told[gone] = False
        self._last_s[at_hole > self._settings.begins] = time_s


class SteadyKind:
    """Which class goes on: the most probable on average, and a screw until it is quite improbable."""

    def __init__(self, classes: Classes, settings: EventSettings) -> None:
        self._screw = classes.assemblies + KINDS.index("screw")
        self._keep = settings.keep
        self._recent: deque[Floats] = deque(maxlen=settings.frames)
        self._screws = False

    def update(self, posterior: Floats) -> tuple[int, Floats]:
        """Number of the class, and the mean posterior (classes,) that it is taken from."""
        self._recent.append(posterior)
        mean = np.mean(self._recent, axis=0)
        number = int(mean.argmax())
        if self._screws and mean[self._screw] > self._keep:
            number = self._screw
        self._screws = number == self._screw
        return number, mean
