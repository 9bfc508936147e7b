"""Sets objects down on the table and on each other, one after the other; what falls is drawn again."""

from __future__ import annotations

import math
from collections.abc import Sequence

import mujoco
import numpy as np

from bracket_ground.interfaces.pose import Array
from bracket_sim.stacks.pieces import Quaternion, about_z
from bracket_sim.stacks.settings import StackSettings
from bracket_sim.stacks.stage import Stage

STEEP = math.cos(math.radians(60))  # height of a contact's normal from which on one body carries another
TRIES = 7
FREE_SPOTS = 40
HIGHEST_SHARE = 0.7  # of objects put on one other, those put on the highest: so heaps grow deep
REGION_M = 0.13  # half side of the part of the table that is used
DROP_M = 0.002  # an object is let go from so far above what carries it
SETTLE_S, GLANCE_S = 0.9, 0.1
REST_M_S = 0.004
PUSHED_M = 0.02  # how far others may be pushed
FALLEN_M = 0.05


class Stack:
    """A scene in the making.

    Attributes:
        level: how many relations are below each object that is down, in the longest chain.

    Args:
        stances: of each object, ways in which it is set down: world_from_object without place and heading.
        room_m: half sides (x, y) of what nothing that comes to rest may reach beyond; None for no limit.
        tries: spots on others for an object, before it goes onto the table.
        fallen_m: how far an object may be from where it was set down, once it rests.
    """

    def __init__(
        self,
        stage: Stage,
        stances: Sequence[Sequence[Quaternion]],
        settings: StackSettings,
        rng: np.random.Generator,
        room_m: Array | None = None,
        tries: int = TRIES,
        fallen_m: float = FALLEN_M,
    ) -> None:
        self.stage, self._stances, self._settings, self._rng, self._room_m = stage, stances, settings, rng, room_m
        self._tries, self._fallen_m = tries, fallen_m
        self.level: dict[int, int] = {}

    def build(self) -> bool:
        """Set all down; False where one finds no place, or something does not come to rest."""
        limit = int(self._rng.integers(1, self._settings.deepest + 1))
        for number in range(len(self._stances)):
            high = bool(self.level) and self._rng.random() < self._settings.stacked_share
            if not (high and self.set_on_others(number, limit)) and not self.set_on_table(number):
                return False
        return self.at_rest()

    def set_on_others(self, number: int, limit: int) -> bool:
        """Set an object down on one or two of those that are down; False where it stays on none in several tries.

        Args:
            limit: relations in a chain.
        """
        before = self.stage.state()
        for _ in range(self._tries):
            below = self._chosen_below(limit)
            if not below:
                return False
            self._lower(number, *self._spot_over(number, below))
            carriers = self._come_to_rest(number, before[0])
            levels = [self.level[carrier] + 1 for carrier in carriers]
            if carriers and max(levels) <= limit:
                self.level[number] = max(levels)
                return True
            self.stage.restore(before)
        return False

    def _chosen_below(self, limit: int) -> list[int]:
        """What an object is put on: one of those that are there, often the highest, or two on the table."""
        rng, free = self._rng, [thing for thing, level in self.level.items() if level < limit]
        if not free:
            return []
        low = [thing for thing in free if self.level[thing] == 0]
        if len(low) > 1 and rng.random() < self._settings.bridging_share:
            return [int(thing) for thing in rng.choice(low, 2, replace=False)]
        if rng.random() < HIGHEST_SHARE:
            return [max(free, key=lambda thing: self.level[thing])]
        return [int(rng.choice(free))]

    def _spot_over(self, number: int, below: Sequence[int]) -> tuple[Array, Quaternion]:
        """Over the middle of one object, or of the way between two, and how the object is turned."""
        rng = self._rng
        clouds = [self.stage.points(thing) for thing in below]
        middles = [(cloud.min(axis=0) + cloud.max(axis=0)) / 2 for cloud in clouds]
        spot, stance = np.mean(middles, axis=0)[:2], self._stance(number)
        yaw = rng.uniform(-math.pi, math.pi)
        if len(below) == 2:
            way = middles[1] - middles[0]
            yaw = math.atan2(way[1], way[0]) + rng.normal(0, 0.2)
        else:
            spot = spot + rng.normal(0, 0.12, 2) * (clouds[0].max(axis=0) - clouds[0].min(axis=0))[:2]
        return spot, _product(about_z(yaw), stance)

    def _stance(self, number: int) -> Quaternion:
        stances = self._stances[number]
        return stances[int(self._rng.integers(len(stances)))]

    def _lower(self, number: int, spot: Array, turn: Quaternion) -> None:
        """Put an object over a spot just above what is there."""
        stage = self.stage
        tops = [stage.points(thing)[:, 2].max() for thing, down in enumerate(stage.down) if down and thing != number]
        stage.put(number, np.array([*spot, 1.0]), turn)
        bottom = stage.lowest_m(number) - 1.0
        high, low = max(tops, default=0.0) - bottom + DROP_M, -bottom
        for _ in range(9):
            middle = (high + low) / 2
            stage.put(number, np.array([*spot, middle]), turn)
            high, low = (high, middle) if self._touches(number) else (middle, low)
        stage.put(number, np.array([*spot, high + DROP_M]), turn)

    def _touches(self, number: int) -> bool:
        return bool((self.stage.contacts()[0] == self.stage.bodies[number]).any())

    def _come_to_rest(self, number: int, before: Array) -> list[int]:
        """Let an object come to rest; who carries it then: nobody where it fell, moved others or moves still."""
        stage = self.stage
        start = stage.data.qpos[7 * number : 7 * number + 3].copy()
        for _ in range(round(SETTLE_S / GLANCE_S)):
            stage.run(GLANCE_S)
            if np.linalg.norm(stage.data.qpos[7 * number : 7 * number + 3] - start) > self._fallen_m:
                return []
            if stage.speeds().max() < REST_M_S:
                break
        else:
            return []
        there = [thing for thing, down in enumerate(stage.down) if down and thing != number]
        shifts = (stage.data.qpos - before).reshape(-1, 7)[there, :3]
        if np.linalg.norm(shifts, axis=1).max(initial=0.0) > PUSHED_M or not self._in_room(number, *there):
            return []
        return carriers_of(stage)[number]

    def _in_room(self, *numbers: int) -> bool:
        if self._room_m is None:
            return True
        return all(bool((np.abs(self.stage.points(number)[:, :2]) <= self._room_m).all()) for number in numbers)

    def set_on_table(self, number: int) -> bool:
        """Beside all others."""
        stage, rng = self.stage, self._rng
        turn = _product(about_z(rng.uniform(-math.pi, math.pi)), self._stance(number))
        before = stage.state()
        half_m: Array | float = REGION_M if self._room_m is None else self._room_m
        for _ in range(FREE_SPOTS):
            spot = rng.uniform(-half_m, half_m, 2) * (1.0 if self.level else 0.5)
            stage.put(number, np.array([*spot, 1.0]), turn)
            stage.put(number, np.array([*spot, 1.0 - stage.lowest_m(number) + DROP_M]), turn)
            if not self._touches(number) and self.at_rest() and self._in_room(number):
                self.level[number] = 0
                return True
            stage.restore(before)
        return False

    def at_rest(self) -> bool:
        """Let time pass until nothing moves; False where something still does after SETTLE_S."""
        for _ in range(round(SETTLE_S / GLANCE_S)):
            self.stage.run(GLANCE_S)
            if self.stage.speeds().max() < REST_M_S:
                return True
        return False


def carriers_of(stage: Stage) -> list[list[int]]:
    """For each object those that carry it: their contact pushes it upwards."""
    numbers = {body: number for number, body in enumerate(stage.bodies)}
    found: list[set[int]] = [set() for _ in stage.bodies]
    bodies, ups = stage.contacts()
    for (first, second), up in zip(bodies.tolist(), ups.tolist(), strict=True):
        if first in numbers and second in numbers and abs(up) > STEEP:
            above, below = (second, first) if up > 0 else (first, second)
            found[numbers[above]].add(numbers[below])
    return [sorted(group) for group in found]


def _product(first: Quaternion, second: Quaternion) -> Quaternion:
    found = np.zeros(4)
    mujoco.mju_mulQuat(found, np.array(first), np.array(second))
    w, x, y, z = found.tolist()
    return w, x, y, z
