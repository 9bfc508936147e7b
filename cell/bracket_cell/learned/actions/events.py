"""From posteriors, frame after frame, to placements that are each told once, and to one steady action.

Two witnesses tell a placement: the hand, whose fingers open over a hole, and the hole, which is newly filled where the
hand placed something. Either tells it when the hand leaves the hole: fingers that search a hole with the part between
them look as if they had let go, and stay. A hole that shows the part after that needs no such proof. Where the two name
different parts, the surer one counts; where that is in doubt, neither tells it. A hole that is seen to be empty, or to
hold a part that leans, or that was full all along, was not filled, whatever the hand did; nor does a hole tell a part
that the hand is still seen to hold.
A part that fell from the hand into a hole that was empty is told by the hole alone.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Collection, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from bracket_cell.learned.actions.hole_events import Filled
from bracket_cell.learned.actions.settings import KINDS, Classes
from bracket_ground.files.model import Model

Floats = NDArray[np.float64]
Bools = NDArray[np.bool_]


class EventSettings(Model):
    """When a placement counts as finished.

    Attributes:
        frames: posteriors that are looked at together.
        threshold: mean probability of "an assembly at this hole whose fingers have opened" over them.
        begins: probability of an assembly at a hole from which on evidence for its part is collected; where it is
            less, the hand has left.
        sure: share of that evidence that one part must have; else the hand alone tells nothing.
        again_s: evidence counts until there was no assembly at the hole for so long, and nothing is reported again.
        report_s: how long a finished assembly is reported.
        keep: probability below which a screw action that goes on is given up.
        shown_reads: this many looks in a row show a part in a hole that was empty, before it counts as newly filled.
        shown_confidence: how sure of the part hole and hand must be together, as if they erred independently.
        shown_evidence: sum over the frames of the probability of an assembly at a hole from which on a newly filled
            hole shows that the assembly is finished.
        stays_s: so long after the fingers opened, or the hole was filled, it is told though the hand is still there.
        leaves_s: fingers that are seen open so soon after the hand left a hole have opened there: fast ones are not
            seen open over it. 0: only those that are seen open over it count.
        leaves_open: mean probability over the frames that they are; networks answer it for assemblies alone, so that .5
            says nothing.
        leaves_evidence: sum over the frames of the probability of an assembly at that hole; less was passing by.
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
    shown_evidence: float = 1.2
    stays_s: float = 2.0
    leaves_s: float = 0.35
    leaves_open: float = 0.65
    leaves_evidence: float = 2.0


@dataclass(frozen=True)
class Placement:
    """A finished assembly.

    Attributes:
        posterior: (parts,) which part it was.
        shown: its hole, newly filled, told that it was finished; by the hand's movement it was not.
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
        self._released: deque[float] = deque(maxlen=settings.frames)
        self._opened_s = np.full(self._shape[1], np.inf)  # since when the fingers seem open there; inf: they do not
        self._evidence = np.zeros(self._shape)
        self._last_s = np.full(self._shape[1], -np.inf)
        self._told = np.zeros(self._shape[1], bool)
        self._filled: dict[int, tuple[Filled, float]] = {}  # by position, and since when
        self._awaited = np.zeros(self._shape[1], bool)  # told, and not yet shown by its hole
        self._stands: dict[int, int] = {}  # parts that were told because their holes show them, by position

    def update(
        self,
        time_s: float,
        posterior: Floats,
        released: float,
        filled: Sequence[Filled] = (),
        unfilled: Collection[int] = (),
        dropped: Sequence[Filled] = (),
        holds: int | None = None,
    ) -> Placement | None:
        """The placement that this frame finishes.

        Args:
            posterior: (classes,).
            released: probability that the fingers have opened, if it is an assembly.
            filled: holes that are newly filled.
            unfilled: positions that are seen to be empty or to hold a part that leans, or that were full all along: the
                hand has placed nothing there.
            dropped: holes in which a part stands that the hand held over them, and that it has left.
            holds: part that the hand is seen to hold: where its fingers were not seen to open, it has not placed that.
        """
        pairs = posterior[: self._classes.assemblies].reshape(self._shape)
        at_hole = pairs.sum(axis=0)
        self._forget(time_s, at_hole)
        here = at_hole > self._settings.begins
        self._evidence[:, here] += pairs[:, here]
        self._open(time_s, here, at_hole * released)
        self._leave(time_s, here, released if holds is None else 0.0)
        for hole in filled:
            self._wait(time_s, hole)
        for position in unfilled:
            self._opened_s[position], self._awaited[position] = np.inf, False
            self._filled.pop(position, None)
            self._stands.pop(position, None)
        fallen = {(hole.part, hole.position) for hole in dropped}
        return self._by_hand(time_s, here, filled) or self._shown(time_s, here, fallen, holds)

    def _open(self, time_s: float, here: Bools, opened: Floats) -> None:
        """Note where the fingers seem open; a hand that leaves takes nothing back."""
        self._recent.append(opened)
        mean = np.mean(self._recent, axis=0) * (len(self._recent) / self._settings.frames)
        seems = mean >= self._settings.threshold
        self._opened_s[here & ~seems] = np.inf
        self._opened_s[here & seems] = np.minimum(self._opened_s, time_s)[here & seems]

    def _leave(self, time_s: float, here: Bools, released: float) -> None:
        """Note the hole that the hand has just left with open fingers: one a visit, that with the most evidence."""
        self._released.append(released)
        seen = self._evidence.sum(axis=0)
        left = ~here & (time_s - self._last_s <= self._settings.leaves_s) & (seen >= self._settings.leaves_evidence)
        if not left.any() or np.mean(self._released) < self._settings.leaves_open:
            return
        most = int(np.where(left | here, seen, 0.0).argmax())
        if left[most]:
            self._opened_s[most] = min(self._opened_s[most], time_s)
            left[most] = False
            self._evidence[:, left] = 0.0

    def _by_hand(self, time_s: float, here: Bools, looks: Sequence[Filled]) -> Placement | None:
        """The placement that a hand tells whose fingers have opened, once it leaves or a new look shows the part."""
        due = ~here | (time_s - self._opened_s >= self._settings.stays_s)
        due[[look.position for look in looks]] = True
        for position in np.flatnonzero(np.isfinite(self._opened_s) & due & ~self._told).tolist():
            if position not in self._stands and self._sure(position):
                self._awaited[position] = True
                return self._placement(time_s, position, shown=False)
        return None

    def _shown(
        self, time_s: float, here: Bools, fallen: Collection[tuple[int, int]], holds: int | None
    ) -> Placement | None:
        """The placement that a newly filled hole tells with which the hand agrees, once that leaves."""
        for position, (filled, since_s) in list(self._filled.items()):
            fell, waited_s = (filled.part, position) in fallen and not here[position], time_s - since_s
            agrees = fell or self._agrees(filled)
            if self._told[position] or position in self._stands or (not agrees and waited_s > self._settings.again_s):
                del self._filled[position]
            elif agrees and filled.part != holds and (not here[position] or waited_s >= self._settings.stays_s):
                self._awaited[position] = filled.confidence < self._settings.shown_confidence
                self._stands[position] = filled.part
                if fell:
                    self._evidence[:, position] = np.eye(self._shape[0])[filled.part]
                return self._placement(time_s, position, shown=True)
        return None

    def _sure(self, position: int) -> bool:
        """Whether the part is told, by the hand's movement and what the hole shows; else the hole is waited for."""
        return float(self._share(position).max()) >= self._settings.sure

    def _share(self, position: int) -> Floats:
        """(parts,) which part was placed there: by the hand, and by the hole where it is newly filled."""
        share: Floats = self._evidence[:, position].copy()
        if position in self._filled:
            hole, _ = self._filled[position]
            likely = np.full(len(share), (1 - hole.confidence) / len(share))
            likely[hole.part] = hole.confidence
            share *= likely
        return share / max(float(share.sum()), 1e-9)

    def _placement(self, time_s: float, position: int, *, shown: bool) -> Placement:
        share = self._share(position)
        self._told[position] = True
        self._filled.pop(position, None)
        return Placement(int(share.argmax()), position, time_s, tuple(float(value) for value in share), shown)

    def _wait(self, time_s: float, hole: Filled) -> None:
        """A hole is newly filled: the hand tells it first, as fingers may still hold what is there."""
        if self._stands.get(hole.position, hole.part) != hole.part:
            del self._stands[hole.position]  # another part is there
        if self._awaited[hole.position]:
            self._awaited[hole.position] = hole.confidence < self._settings.shown_confidence
            return
        before, since_s = self._filled.get(hole.position, (hole, time_s))
        if before.part != hole.part:
            before, since_s = hole, time_s
        self._filled[hole.position] = max(before, hole, key=lambda look: look.confidence), since_s

    def _agrees(self, hole: Filled) -> bool:
        """Whether hand and hole together are sure that this part was placed there; else the hole does not tell it."""
        collected = float(self._evidence[:, hole.position].sum())
        sure = float(self._share(hole.position)[hole.part]) >= self._settings.shown_confidence
        return sure and collected >= self._settings.shown_evidence

    def _forget(self, time_s: float, at_hole: Floats) -> None:
        """What was seen at a hole counts no longer once no assembly was seen there for a while."""
        gone = time_s - self._last_s > self._settings.again_s
        self._evidence[:, gone] = 0.0
        self._told[gone], self._opened_s[gone] = False, np.inf
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
