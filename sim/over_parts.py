"""How high a hand goes over the parts in the bracket on its way to something else."""

from __future__ import annotations

import numpy as np

from cell.interfaces.pose import Array

ABOVE_M = 0.02  # of the fingertips over a part
BEHIND_M = np.array([[0.0, 0.0], [0.10, 0.0], [0.17, 0.0]])  # fingertips, palm and wrist, with the fingers along -x
HANGS_M = np.array([0.0, 0.03, 0.025])  # how much higher than the fingertips their undersides are
WIDE_M = 0.06  # half of a hand and half of a part
RISES_M_S = 1.0


class OverParts:
    """Lifts the places of one way; near its end the hand comes down as steeply as 45 degrees.

    Args:
        tops_m: (n, 3) of the parts that stand there.
        dt_s: from one place to the next.
    """

    def __init__(self, tops_m: Array, dt_s: float) -> None:
        self._tops_m, self._step_m = tops_m, RISES_M_S * dt_s
        self._lift_m = 0.0

    def lifted(self, place_m: Array, target_m: Array) -> Array:
        """The next place (3,) on the way to a target, as high as it must be, or as high as the hand can be by now."""
        wanted_m = max(0.0, self._least_m(place_m, target_m) - float(place_m[2]))
        self._lift_m += float(np.clip(wanted_m - self._lift_m, -self._step_m, self._step_m))
        lifted: Array = place_m + np.array([0.0, 0.0, self._lift_m])
        return lifted

    def _least_m(self, place_m: Array, target_m: Array) -> float:
        if not len(self._tops_m):
            return 0.0
        away_m = np.linalg.norm(place_m[:2] + BEHIND_M[:, None] - self._tops_m[:, :2], axis=2)
        beside_m = np.maximum(away_m - WIDE_M, 0.0)
        needed_m = self._tops_m[:, 2] + ABOVE_M - HANGS_M[:, None] - beside_m
        return min(float(needed_m.max()), float(target_m[2] + np.linalg.norm(target_m[:2] - place_m[:2])))
