"""Parts that fell onto a hole and do not stand in it: by physics they lean in it, lie over it or rest on its edge."""

from __future__ import annotations

import math

import mujoco
import numpy as np

from bracket_ground.interfaces.bench import Bench
from bracket_ground.interfaces.pose import Array, Pose
from bracket_ground.interfaces.product import PartType, Product
from bracket_sim.scene.parts import ScenePart
from bracket_sim.scene.settings import PhysicsSettings
from bracket_sim.scene.world import WorldPart, build_world
from bracket_sim.worker.worker_sight import NEAR_HOLE_M, SEATED_TILT_RAD

FAR_AWAY_M, APART_M = (3.0, 3.0, 0.1), 0.3
FALLS = 3  # of each type
TRIES = 10  # for each of them: most parts that fall nearly upright slip into the hole
ABOVE_M = (0.002, 0.03)  # from the plate to the part's lowest point, when it is let go
BESIDE_M = 0.012  # from the hole to its origin, standard deviation
NEARLY_UPRIGHT, NEARLY_RAD, ANY_RAD = 0.6, 0.6, math.pi / 2  # share of parts, and their largest tilt; that of others
LONGEST_S, LOOK_S = 1.0, 0.04  # of a fall, and how often one looks whether the part rests
REST_M_S = 0.005


class FallenParts:
    """Where parts rest that fell onto a hole of the empty bracket; each type falls when it is first asked for."""

    def __init__(self, product: Product, bench: Bench, physics: PhysicsSettings, seed: int) -> None:
        self._product, self._bench, self._seed = product, bench, seed
        self._rests: dict[str, list[Pose]] = {}
        scene = [ScenePart(part, _far_away(number), "person") for number, part in enumerate(product.parts)]
        self._world = build_world(product, bench, scene, physics)
        self._world.set_arm(bench.arm_park_rad)

    def draw(self, part: str, rng: np.random.Generator) -> Pose | None:
        """hole_from_part of one that rests near the hole, not upright; None for a type that never does.

        Which way it fell is drawn anew: a hole is round.
        """
        if part not in self._rests:
            self._rests[part] = self._fall(part)
        rests = self._rests[part]
        if not rests:
            return None
        return Pose.from_yaw((0, 0, 0), float(rng.uniform(-math.pi, math.pi))) @ rests[int(rng.integers(len(rests)))]

    def _fall(self, part: str) -> list[Pose]:
        number = list(self._product.parts).index(part)
        rng, body = np.random.default_rng([self._seed, 9, number]), self._world.bodies[number]
        found: list[Pose] = []
        for attempt in range(FALLS * TRIES):
            hole = self._hole(attempt)
            self._world.place(body, hole @ _let_go(self._product.parts[part], rng))
            self._until_it_rests(body)
            rest = hole.inverse() @ self._world.part_pose(body)
            found += [rest] if _astray(rest) else []
            if len(found) == FALLS:
                break
        self._world.place(body, _far_away(number))
        return found

    def _until_it_rests(self, body: WorldPart) -> None:
        model, data = self._world.model, self._world.data
        for _ in range(round(LONGEST_S / LOOK_S)):
            mujoco.mj_step(model, data, round(LOOK_S / model.opt.timestep))
            if np.all(np.abs(data.qvel[body.qvel : body.qvel + 6]) < REST_M_S):
                return

    def _hole(self, number: int) -> Pose:
        """One hole after the other."""
        holes_m = list(self._product.bracket.holes_m.values())
        x_m, y_m = holes_m[number % len(holes_m)]
        return self._bench.bracket.pose @ Pose((x_m, y_m, 0.0))


def _far_away(number: int) -> Pose:
    x_m, y_m, z_m = FAR_AWAY_M
    return Pose((x_m, y_m + number * APART_M, z_m))


def _let_go(kind: PartType, rng: np.random.Generator) -> Pose:
    """hole_from_part."""
    angle = float(rng.uniform(0, NEARLY_RAD if rng.random() < NEARLY_UPRIGHT else ANY_RAD))
    way, yaw = (float(value) for value in rng.uniform(-math.pi, math.pi, 2))
    turn = Pose.from_yaw((0, 0, 0), yaw) @ tilted(angle, way)
    length_m, width_m, height_m = kind.size_m
    corners = [
        (a, b, c)
        for a in (-length_m / 2, length_m / 2)
        for b in (-width_m / 2, width_m / 2)
        for c in (-kind.peg_length_m, height_m)
    ]
    lowest_m = min(float(turn.transform(np.array(corner))[2]) for corner in corners)
    x_m, y_m = (float(value) for value in rng.normal(0, BESIDE_M, 2))
    return Pose((x_m, y_m, float(rng.uniform(*ABOVE_M)) - lowest_m), turn.quaternion_wxyz)


def _astray(rest: Pose) -> bool:
    """Whether it rests at the hole, and does not stand in it."""
    x_m, y_m, z_m = rest.position_m
    upright: Array = rest.transform(np.array([0.0, 0.0, 1.0])) - np.array(rest.position_m)
    near = math.hypot(x_m, y_m) < NEAR_HOLE_M and abs(z_m) < NEAR_HOLE_M
    return near and float(upright[2]) < math.cos(SEATED_TILT_RAD)


def tilted(angle_rad: float, way_rad: float) -> Pose:
    """A turn about the level axis of this heading."""
    half = angle_rad / 2
    turn = (math.cos(half), math.sin(half) * math.cos(way_rad), math.sin(half) * math.sin(way_rad), 0.0)
    return Pose((0.0, 0.0, 0.0), turn)
