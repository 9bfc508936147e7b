"""Which part lies over the opening of each hole, seen from straight above."""

from __future__ import annotations

import mujoco
import numpy as np

from cell.interfaces.bench import Bench
from cell.interfaces.pose import Array
from cell.interfaces.product import Product
from sim.world import World, WorldPart

SHOWN_GROUPS = np.array([1, 1, 1, 0, 0, 0], np.uint8)
FROM_M = 0.2  # over the plate's upper side; no part reaches so high
RAYS = 7  # across the opening
LEAST_SHARE = 0.1  # of the opening; a part that covers less lies beside the hole
DOWN = np.array([0.0, 0.0, -1.0])


class Openings:
    """The holes of the bracket, and rays down into each."""

    def __init__(self, world: World, product: Product, bench: Bench) -> None:
        self._world = world
        self._owners = {part.body: part for part in world.bodies}
        steps = np.linspace(-1.0, 1.0, RAYS) * product.hole_radius_m
        grid = np.stack(np.meshgrid(steps, steps), axis=-1).reshape(-1, 2)
        round_m = grid[np.hypot(*grid.T) <= product.hole_radius_m]
        self._from_m: dict[str, Array] = {}
        for position, hole_m in product.bracket.holes_m.items():
            points = np.column_stack([round_m + np.array(hole_m), np.full(len(round_m), FROM_M)])
            self._from_m[position] = bench.bracket.pose.transform(points)

    def covered_by(self, position: str) -> WorldPart | None:
        """The part that covers most of an opening, as things stand; None where none covers enough of it."""
        model, data, hit = self._world.model, self._world.data, np.zeros(1, np.int32)
        seen: list[int] = []
        for point in self._from_m[position]:
            mujoco.mj_ray(model, data, point, DOWN, SHOWN_GROUPS, 1, -1, hit, None)
            seen += [int(model.geom_bodyid[hit[0]])] if hit[0] >= 0 else []
        counts = {body: seen.count(body) for body in set(seen) & set(self._owners)}
        most = max(counts, key=lambda body: counts[body], default=None)
        if most is None or counts[most] < LEAST_SHARE * len(self._from_m[position]):
            return None
        return self._owners[most]
