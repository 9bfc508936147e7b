"""From posteriors, frame after frame, to placements that are each told once, and to one steady action."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cell.interfaces.model import Model
from learned.actions.classes import KINDS, Classes

Floats = NDArray[np.float64]


class EventSettings(Model):
    """When a placement counts as finished.

    Attributes:
        frames: posteriors that are looked at together.
        threshold: mean probability of "an assembly at this hole whose fingers have opened" over them.
        begins: probability of an assembly at a hole from which on evidence for its part is collected.
        again_s: a hole that was told is told again only after so long without an assembly at it.
        report_s: how long a finished assembly is told.
        keep: probability below which a screw action that goes on is given up.
    """

    frames: int = 3
    threshold: float = 0.5
    begins: float = 0.3
    again_s: float = 1.0
    report_s: float = 0.7
    keep: float = 0.3


@dataclass(frozen=True)
class Placement:
    """A finished assembly.

    Attributes:
        posterior: (parts,) which part it was.
    """

    part: int
    position: int
    time_s: float
    posterior: tuple[float, ...]


class PlacementEvents:
    """Collects evidence for each hole; asked once for every frame."""

    def __init__(self, classes: Classes, settings: EventSettings) -> None:
        self._classes, self._settings = classes, settings
        self._shape = (len(classes.parts), len(classes.positions))
        self._recent: deque[Floats] = deque(maxlen=settings.frames)
        self._evidence = np.zeros(self._shape)
        self._last_s = np.full(self._shape[1], -np.inf)
        self._told = np.zeros(self._shape[1], bool)

    def update(self, time_s: float, posterior: Floats, released: float) -> Placement | None:
        """The placement that this frame finishes.

        Args:
            posterior: (classes,).
            released: probability that the fingers have opened, if it is an assembly.
        """
        pairs = posterior[: self._classes.assemblies].reshape(self._shape)
        at_hole = pairs.sum(axis=0)
        self._forget(time_s, at_hole)
        active = at_hole > self._settings.begins
        self._evidence[:, active] += pairs[:, active]
        self._recent.append(at_hole * released)
        finished = np.mean(self._recent, axis=0) * (len(self._recent) / self._settings.frames)
        position = int(np.argmax(np.where(self._told, 0.0, finished)))
        if self._told[position] or finished[position] < self._settings.threshold:
            return None
        self._told[position] = True
        evidence = self._evidence[:, position]
        share = evidence / max(float(evidence.sum()), 1e-9)
        return Placement(int(share.argmax()), position, time_s, tuple(float(value) for value in share))

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
