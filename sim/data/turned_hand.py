"""The hand that works, turned about its fingertips: as of one who stands elsewhere, or whom the arm pushes aside."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from cell.interfaces.pose import Array
from sim.data.sight import GEOM_POSITIONS, GEOM_TURNS
from sim.rendering.studio import ScenePoses
from sim.scene.world import World

TURNED_SHARE = 0.25  # of frames
LARGEST_TURN_RAD = 2.0  # from where people's hands point by themselves


class TurnedHand:
    """Turns of hand, sleeve and what is held, written over the poses of a moment."""

    def __init__(self, world: World, rng: np.random.Generator) -> None:
        model = world.model
        self._rng = rng
        self._geoms = np.flatnonzero(model.body_rootid[model.geom_bodyid] == model.body("hand").id)

    def draw(self) -> float:
        """An angle [rad] from x to y; mostly 0."""
        turn_rad = self._rng.uniform(-LARGEST_TURN_RAD, LARGEST_TURN_RAD)
        return float(turn_rad) if self._rng.random() < TURNED_SHARE else 0.0

    def put(self, poses: ScenePoses, fingertips_m: Array, held: NDArray[np.int64], turn_rad: float) -> ScenePoses:
        """The poses with the hand turned about the vertical through its fingertips, which stay where they are.

        Args:
            held: (n,) shapes of what is in the hand.
        """
        if turn_rad == 0.0:
            return poses
        geoms = np.concatenate([self._geoms, held])
        cos, sin = math.cos(turn_rad), math.sin(turn_rad)
        turn = np.array([[cos, -sin, 0.0], [sin, cos, 0.0], [0.0, 0.0, 1.0]])
        changed = list(poses)
        for field in (GEOM_POSITIONS, GEOM_TURNS):
            changed[field] = poses[field].copy()
        changed[GEOM_POSITIONS][geoms] = fingertips_m + (poses[GEOM_POSITIONS][geoms] - fingertips_m) @ turn.T
        changed[GEOM_TURNS][geoms] = (turn @ poses[GEOM_TURNS][geoms].reshape(-1, 3, 3)).reshape(-1, 9)
        return tuple(changed)
