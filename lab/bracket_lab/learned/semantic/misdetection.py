"""What an imperfect action detector makes of states of an assembly."""

from __future__ import annotations

import hashlib
from dataclasses import dataclass

import numpy as np

from bracket_cell.learned.semantic.graph import EMPTY, Floats, Ints, Layout, action_pairs
from bracket_cell.learned.semantic.settings import DETECTION_ERROR


@dataclass(frozen=True)
class Scenarios:
    """Partial states with their labels, B rows.

    Attributes:
        goals: (B,) which goal is being assembled; the number of goals stands for one that is none of them.
        seen: (B, m) part type seen at each position, EMPTY where nothing is.
        following: (B,) the position that the demonstrator fills next.
    """

    goals: Ints
    seen: Ints
    following: Ints

    def __len__(self) -> int:
        return len(self.goals)

    def take(self, rows: Ints) -> Scenarios:
        """Some of the rows."""
        return Scenarios(self.goals[rows], self.seen[rows], self.following[rows])

    @property
    def sha256(self) -> str:
        """Hash of states and labels, in their order."""
        digest = hashlib.sha256()
        for array in (self.goals, self.seen, self.following):
            digest.update(np.ascontiguousarray(array, "<i8").tobytes())
        return digest.hexdigest()


def misdetect(
    layout: Layout,
    whole: Scenarios,
    rng: np.random.Generator,
    rate: float = DETECTION_ERROR,
    *,
    contradicting: bool = False,
    confusions: Floats | None = None,
) -> Scenarios:
    """What an imperfect action detector makes of the states.

    Each placement is taken, with probability `rate`, for another action of the demonstrated goals at a position
    that is seen as open.

    Args:
        contradicting: only for actions that the scenario's own goal does not hold. Training uses this: else noise
            would regenerate held-out scenarios from training ones, as sub-demonstrations do.
        confusions: (actions, actions) what is taken for what (`semantic.confusions`), instead of `rate` and any
            action alike.
    """
    seen = whole.seen.copy()
    pairs, m = action_pairs(layout), len(layout.positions)
    rates = rate if confusions is None else 1.0 - np.diag(confusions)[np.maximum(seen, 0) * m + np.arange(m)]
    for row, position in np.argwhere((seen != EMPTY) & (rng.random(seen.shape) < rates)):
        true = (int(seen[row, position]), int(position))
        seen[row, position] = EMPTY
        types = layout.types[whole.goals[row]] if contradicting else np.full_like(seen[row], EMPTY)
        others = [
            (part, place)
            for part, place in pairs
            if (part, place) != true and seen[row, place] == EMPTY and types[place] != part
        ]
        if confusions is not None and others:
            weights = np.array([confusions[true[0] * m + true[1], part * m + place] for part, place in others])
            others = [others[rng.choice(len(others), p=weights / weights.sum())]] if weights.any() else []
        if others:
            part, place = others[rng.integers(len(others))]
            seen[row, place] = part
        else:
            seen[row, position] = true[0]
    return Scenarios(whole.goals, seen, whole.following)
