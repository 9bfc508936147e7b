"""What goes wrong with the parts on a bench: one falls, sticks, jams, is pushed, covered, missing, broken or another.

Each mishap befalls what it is about at the moment it begins: the part between the fingers, or the one nearest to them
in the tray. What lasts goes on from one control period to the next, until somebody has taken the part.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping

import numpy as np

from bracket_ground.errors import InputError
from bracket_ground.interfaces.pose import Array, Pose
from bracket_sim.scene.palette import ROBOT_TOUCH
from bracket_sim.scene.world import World, WorldPart
from bracket_sim.worker.stock import Stock
from bracket_sim.worker.worker_sight import NEAR_HOLE_M

Script = Iterator[None]
OVER = object()

HELD_M = 0.06  # from the tool to a part that is between the fingers
STANDS_M = 0.03  # the origin of a part in the tray is no higher above its floor
OPENED_M = 0.002  # by so much fingers have opened that let go
FALLS_S, GONE_M = 0.5, 0.10
THICKER_M = 0.006  # of the radius of a peg that goes into no hole
LIFTED_M = 0.03  # a peg is out of its hole
PUSHED_M, PUSHES_M_S = 0.03, 0.10
COMES_M, BELOW_M = 0.03, 0.15  # from the tool to a part in the tray that it comes to, beside it; and how high it is
COVERS_M = 0.15  # from the tool to the hole that is covered as a part comes
LIES = (math.sqrt(0.5), math.sqrt(0.5), 0.0, 0.0)  # on its side, with its peg along y


class Mishaps:
    """Lets one thing after the other go wrong; acts once in every control period."""

    def __init__(self, world: World, stock: Stock) -> None:
        self._world, self._stock = world, stock
        self._scripts: list[Script] = []
        self._dt_s = 0.0
        self._kinds: Mapping[str, Callable[[], Script]] = {
            "part_falls": self._falls,
            "part_sticks": self._sticks,
            "part_jams": self._jams,
            "tray_pushed": self._pushed,
            "hole_covered": self._covered,
            "part_missing": self._missing,
            "part_broken": self._broken,
            "part_wrong": self._wrong,
        }
        bracket = world.bench.bracket.pose
        self._holes_m = [bracket.transform(np.array([*xy, 0.0])) for xy in world.product.bracket.holes_m.values()]

    def begin(self, name: str) -> None:
        """One goes wrong from now on; raises InputError for one that there is not."""
        if name not in self._kinds:
            raise InputError(f"nothing is known that goes wrong as {name!r}; legal: {', '.join(self._kinds)}")
        self._scripts.append(self._kinds[name]())

    def update(self, _time_s: float, dt_s: float, /) -> None:
        """Let one control period pass."""
        self._dt_s = dt_s
        self._scripts = [script for script in self._scripts if next(script, OVER) is not OVER]

    def _falls(self) -> Script:
        """It slips out of the fingers, as if they did not touch it."""
        part, model = self._nearest(), self._world.model
        geoms = model.geom_bodyid == part.body
        touches = model.geom_conaffinity[geoms].copy()
        model.geom_conaffinity[geoms] &= ~ROBOT_TOUCH[0]
        fallen_s = 0.0
        while fallen_s < FALLS_S or self._away_m(part) < GONE_M:
            fallen_s += self._dt_s
            yield
        model.geom_conaffinity[geoms] = touches

    def _sticks(self) -> Script:
        """It stays at a finger that opens, until somebody takes it."""
        part, finger = self._nearest(), self._world.holding[0]
        held_m, stuck = self._world.opening_m, Pose((0.0, 0.0, 0.0))
        while part.name not in self._stock.kept:
            if self._world.opening_m < held_m + OPENED_M:
                stuck = self._world.body_pose(finger).inverse() @ self._world.part_pose(part)
            else:
                self._world.put(part, self._world.body_pose(finger) @ stuck)
            yield

    def _jams(self) -> Script:
        """Its peg does not go in, until it was pulled out again."""
        part = self._nearest()
        self._thicken(part, THICKER_M)
        top_m = float(self._holes_m[0][2]) + self._world.product.parts[part.part].peg_length_m
        while self._height_m(part) > top_m:
            yield
        while self._height_m(part) < top_m + LIFTED_M and part.name not in self._stock.kept:
            yield
        self._thicken(part, -THICKER_M)

    def _pushed(self) -> Script:
        """Everything in the tray slides to where most room is."""
        parts, way, gone_m = self._in_tray(), self._free_way(), 0.0
        while gone_m < PUSHED_M:
            step_m = PUSHES_M_S * self._dt_s
            gone_m += step_m
            for part in parts:
                if self._away_m(part) > HELD_M:
                    pose = self._world.part_pose(part)
                    x, y, z = (float(value) for value in np.array(pose.position_m) + way * step_m)
                    self._world.put(part, Pose((x, y, z), pose.quaternion_wxyz))
            yield

    def _covered(self) -> Script:
        """Another part comes to lie across the empty hole that the held one comes to."""
        held, kinds = self._nearest(), self._world.product.parts
        hole = min(self._holes_m, key=self._beside_m)
        while self._beside_m(hole) > COVERS_M or self._filled(hole):
            yield
            hole = min(self._holes_m, key=self._beside_m)
        others = [part for part in self._in_tray() if part.part != held.part]
        part = min(others, key=lambda other: kinds[other.part].size_m[0])
        _, width_m, height_m = kinds[part.part].size_m
        x, y, z = (float(value) for value in hole)
        self._world.put(part, Pose((x, y + height_m / 2, z + width_m / 2), LIES))

    def _missing(self) -> Script:
        """All of its type are gone from the tray."""
        while (part := self._below()) is None:
            yield
        self._stock.take([world_part for world_part in self._in_tray() if world_part.part == part.part])

    def _broken(self) -> Script:
        """Its peg is bent, and goes into no hole."""
        while (part := self._below()) is None:
            yield
        self._thicken(part, THICKER_M)

    def _wrong(self) -> Script:
        """Where it stood, another type stands."""
        while (part := self._below()) is None:
            yield
        other = max((world_part for world_part in self._in_tray() if world_part.part != part.part), key=self._away_m)
        pose = self._world.part_pose(part)
        self._world.put(part, self._world.part_pose(other))
        self._world.put(other, pose)

    def _nearest(self) -> WorldPart:
        """The robot's part that is nearest to the tool: it is held, or about to be taken."""
        return min((body for body in self._world.bodies if body.owner == "robot"), key=self._away_m)

    def _below(self) -> WorldPart | None:
        """The part in the tray that the tool comes to, once it is nearly over it."""
        tool_m = np.array(self._world.tool_pose().position_m)
        if tool_m[2] > BELOW_M:
            return None
        places = {part.name: self._world.data.xpos[part.body] for part in self._in_tray()}
        return next((part for part in self._in_tray() if math.dist(places[part.name][:2], tool_m[:2]) < COMES_M), None)

    def _in_tray(self) -> list[WorldPart]:
        tray = self._world.bench.tray
        middle, half = np.array(tray.centre_m)[:2], np.array(tray.size_m) / 2
        return [
            body
            for body in self._world.bodies
            if body.part in self._world.product.parts
            and bool((np.abs(self._world.data.xpos[body.body][:2] - middle) < half).all())
            and self._height_m(body) < tray.centre_m[2] + STANDS_M
        ]

    def _free_way(self) -> Array:
        """Along which axis of the tray, and in which direction, there is most room beside its parts; (3,)."""
        tray, places = self._world.bench.tray, np.array([self._world.data.xpos[part.body] for part in self._in_tray()])
        middle, half = np.array(tray.centre_m)[:2], np.array(tray.size_m) / 2
        rooms = [
            (half[axis] - float((side * (places[:, axis] - middle[axis])).max()), axis, side)
            for axis in (0, 1)
            for side in (-1.0, 1.0)
        ]
        _, axis, side = max(rooms)
        way: Array = np.zeros(3)
        way[axis] = side
        return way

    def _filled(self, hole: Array) -> bool:
        return any(math.dist(self._world.data.xpos[body.body], hole) < NEAR_HOLE_M for body in self._world.bodies)

    def _beside_m(self, hole: Array) -> float:
        """How far beside a hole's axis the tool is."""
        x, y, _ = np.array(self._world.tool_pose().position_m) - hole
        return math.hypot(x, y)

    def _height_m(self, part: WorldPart) -> float:
        return float(self._world.data.xpos[part.body][2])

    def _away_m(self, part: WorldPart) -> float:
        return math.dist(self._world.data.xpos[part.body], self._world.tool_pose().position_m)

    def _thicken(self, part: WorldPart, by_m: float) -> None:
        """Change the radius of a part's peg where it touches, and all bounds that MuJoCo keeps of it."""
        model = self._world.model
        for geom in np.flatnonzero(model.geom_bodyid == part.body):
            if model.geom_pos[geom][2] < 0 and model.geom_conaffinity[geom]:
                model.geom_size[geom][:2] += by_m
                model.geom_rbound[geom] += 2 * by_m
                model.geom_aabb[geom][3:5] += by_m
        first, number = model.body_bvhadr[part.body], model.body_bvhnum[part.body]
        model.bvh_aabb[first : first + number, 3:] += 2 * by_m
