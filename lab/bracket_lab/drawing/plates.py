"""Stills of the bracket's plate: any parts in any holes, well or badly seated, with hand or arm over them or not."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

import mujoco
import numpy as np
from numpy.typing import NDArray

from bracket_ground.files.data_folder import DataFolder
from bracket_ground.interfaces.bench import Bench
from bracket_ground.interfaces.pose import Array, Pose
from bracket_ground.interfaces.product import Product
from bracket_lab.drawing.actions import COVERED_BY
from bracket_lab.drawing.fallen import FallenParts, tilted
from bracket_lab.drawing.sight import Masks, Projection, told_pose, true_camera
from bracket_sim.rendering.photographer import Exposure, Photographer, SensorSetup
from bracket_sim.rendering.studio import ScenePoses, visible_poses
from bracket_sim.scene.hand import DIGITS, GANTRY, add_hand
from bracket_sim.scene.parts import ScenePart
from bracket_sim.scene.settings import SimSettings
from bracket_sim.scene.storage import person_set
from bracket_sim.scene.world import World, WorldPart, build_world

SHOWN_GROUPS = np.array([1, 1, 1, 0, 0, 0], np.uint8)
FROM_M = 0.2  # over the plate's upper side; no part reaches so high
RAYS = 7  # across the opening
LEAST_SHARE = 0.1  # of the opening; a part that covers less lies beside the hole
DOWN = np.array([0.0, 0.0, -1.0])
CAMERA = "overhead"
FAR_AWAY_M = (3.0, 3.0, 0.1)
MORE_OF_EACH = 2  # parts beyond those of one product, so that any mixture can stand on the plate
FILLED_SHARE, ASTRAY_SHARE = 0.55, 0.15  # of holes; of parts in them
SEATED_M, SEATED_RAD = 0.0015, 0.02
FALLEN_SHARE = 0.6  # of parts that are astray: they fell there; the others stand askew
ASKEW_M, ASKEW_RAD = (0.0, 0.014), (0.1, 0.5)
HAND_SHARE, ARM_SHARE, HOLDING_SHARE = 0.4, 0.35, 0.6
OVER_M = (0.005, 0.14)  # of fingertips over the plate's upper side
COVERED_HALF_M = 0.03  # half the width of the square around a hole whose hidden share is told
Reach = Callable[[Array, float], Array | None]


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


@dataclass
class Still:
    """What stands on the plate of one image.

    Attributes:
        holes: by position, the part's type or None, and whether it is well seated.
        held: parts in a hand or gripper.
    """

    holes: dict[str, tuple[str | None, bool]]
    held: list[WorldPart]


class Plate:
    """A world whose plate is filled at random, again and again."""

    def __init__(
        self,
        product: Product,
        bench: Bench,
        settings: SimSettings,
        seed: int,
        reach: Reach,
        astray_share: float = ASTRAY_SHARE,
    ) -> None:
        self._product, self._bench, self._reach, self._astray_share = product, bench, reach, astray_share
        self._fallen = FallenParts(product, bench, settings.physics, seed)
        self._rng = np.random.default_rng([seed, 5])
        self.look = settings.look.draw(seed)
        more = [ScenePart(name, Pose(FAR_AWAY_M), "person") for name in product.parts for _ in range(MORE_OF_EACH)]
        scene = [*person_set(product, bench), *more]
        hand = partial(add_hand, bench=bench, person=self.look.person, habits=settings.person)
        self.world = build_world(product, bench, scene, settings.physics, hand, self.look)
        model = self.world.model
        self._openings = Openings(self.world, product, bench)
        self._start = self.world.data.qpos.copy()
        self._gantry = [int(model.joint(name).qposadr[0]) for name in GANTRY]
        self._digits = [int(model.joint(name).qposadr[0]) for name in DIGITS]
        self._rest_m: Array = model.body("hand").pos.copy()

    def shuffle(self) -> Still:
        """Put everything elsewhere."""
        self.world.data.qpos[:] = self._start
        self.world.put_arm(self._bench.arm_park_rad)
        self.world.update_poses()
        rng, left = self._rng, list(self.world.bodies)
        for body in left:  # what is not used stays in its bin or far away
            if self.world.part_pose(body).position_m[0] > FAR_AWAY_M[0] - 1:
                self.world.put(body, Pose((FAR_AWAY_M[0], 3.0 + 0.2 * left.index(body), 0.1)))
        still = Still(dict.fromkeys(self._product.positions, (None, True)), [])
        rng.shuffle(left)
        for position in self._product.positions:
            if rng.random() < FILLED_SHARE:
                still.holes[position] = self._fill(position, left.pop())
        self.world.update_poses()
        self._tell_astray(still)
        if rng.random() < HAND_SHARE:
            still.held += self._hand_over(left)
        if rng.random() < ARM_SHARE:
            still.held += self._arm_over(left)
        self.world.update_poses()
        return still

    def _fill(self, position: str, part: WorldPart) -> tuple[str | None, bool]:
        """Put a part into a hole, well or not; what stays in its bin leaves the hole empty."""
        hole, astray = self._hole(position), self._rng.random() < self._astray_share
        rest = self._astray(part.part) if astray else self._seated()
        if rest is None:
            return None, True
        self.world.put(part, hole @ rest)
        return part.part, not astray

    def _tell_astray(self, still: Still) -> None:
        """What fell may lie beside its hole, or over another: what covers an opening is what is in the hole."""
        for position, (part, seated) in still.holes.items():
            if part is None or not seated:
                over = self._openings.covered_by(position)
                still.holes[position] = (None, True) if over is None else (over.part, False)

    def _seated(self) -> Pose:
        rng = self._rng
        tilt = tilted(rng.normal(0, SEATED_RAD), rng.uniform(-math.pi, math.pi))
        x, y = (float(value) for value in rng.normal(0, SEATED_M, 2))
        return Pose((x, y, 0.0)) @ Pose.from_yaw((0, 0, 0), self._yaw()) @ tilt

    def _astray(self, part: str) -> Pose | None:
        """Fallen there, or standing askew as what is not pressed home; None for a type that cannot fall so."""
        rng = self._rng
        if rng.random() < FALLEN_SHARE:
            return self._fallen.draw(part, rng)
        angle, way, off = rng.uniform(*ASKEW_RAD), rng.uniform(-math.pi, math.pi), rng.uniform(*ASKEW_M)
        high = self._product.parts[part].peg_length_m * math.cos(angle) * rng.uniform()
        x, y, z = off * math.cos(way), off * math.sin(way), high
        return Pose((x, y, z)) @ Pose.from_yaw((0, 0, 0), self._yaw()) @ tilted(angle, way)

    def _yaw(self) -> float:
        """People and robot like the directions of the plate."""
        rng, yaw = self._rng, self._rng.uniform(-math.pi, math.pi)
        if rng.random() < 0.5:
            yaw = round(yaw / (math.pi / 2)) * math.pi / 2 + rng.normal(0, 0.05)
        return float(yaw)

    def _hand_over(self, left: list[WorldPart]) -> list[WorldPart]:
        """The hand somewhere over the plate, now and then with a part."""
        rng, data = self._rng, self.world.data
        tips = self._spot_m()
        data.qpos[self._gantry] = [*(tips - self._rest_m), rng.normal(0, 0.4)]
        if rng.random() >= HOLDING_SHARE:
            data.qpos[self._digits] = rng.uniform(0, 0.03)
            return []
        part = left.pop()
        length, width, height = self._product.parts[part.part].size_m
        data.qpos[self._digits] = min(length, width) / 2
        x, y, z = (float(value) for value in tips)
        self.world.put(part, Pose.from_yaw((x, y, z - height / 2), float(rng.normal(0, 0.3))))
        return [part]

    def _arm_over(self, left: list[WorldPart]) -> list[WorldPart]:
        """The gripper somewhere over the plate, now and then with a part; parked where the arm cannot reach."""
        rng = self._rng
        tool, yaw = self._spot_m(), float(rng.uniform(-math.pi, math.pi))
        joints = self._reach(tool, yaw)
        if joints is None:
            return []
        self.world.put_arm(joints)
        if rng.random() >= HOLDING_SHARE:
            return []
        part = left.pop()
        _, width, height = self._product.parts[part.part].size_m
        self.world.set_opening(min(width, 0.08))
        x, y, z = (float(value) for value in tool)
        self.world.put(part, Pose.from_yaw((x, y, z - height + 0.02), yaw + math.pi / 2))
        return [part]

    def _spot_m(self) -> Array:
        """Over a hole or between holes."""
        holes = np.array([self.hole_m(position) for position in self._product.positions])
        low, high = holes.min(axis=0), holes.max(axis=0)
        spot = self._rng.uniform(low, high)
        spot[:2] += self._rng.normal(0, 0.03, 2)
        spot[2] += self._rng.uniform(*OVER_M)
        return np.asarray(spot, float)

    def _hole(self, position: str) -> Pose:
        """world_from_hole."""
        x_m, y_m = self._product.bracket.holes_m[position]
        return self._bench.bracket.pose @ Pose((x_m, y_m, 0.0))

    def hole_m(self, position: str) -> Array:
        """(3,) in the world frame."""
        return np.array(self._hole(position).position_m)


def write_plates(
    product: Product,
    bench: Bench,
    settings: SimSettings,
    seed: int,
    folder: DataFolder,
    stills: int,
    reach: Reach,
    frames: int = 1,
    astray_share: float = ASTRAY_SHARE,
) -> None:
    """An image and a row of plates.jsonl for each frame; look and stills are drawn from the seed.

    Args:
        reach: joints that bring the tool to a place with its fingers down and a heading; None where the arm cannot.
        frames: in a row of each still, which differ by the sensor's noise.
        astray_share: of parts, that lie, lean or stand beside their hole.
    """
    plate = Plate(product, bench, settings, seed, reach, astray_share)
    world, look = plate.world, plate.look
    rng = np.random.default_rng([seed, 8])
    photographer = Photographer(world.model, {CAMERA: SensorSetup(bench.overhead, look.camera, rng)})
    masks = Masks(world, CAMERA, bench.overhead, look)
    projection = Projection(world, CAMERA, bench.overhead, look)
    model = world.model
    hiding = [body for body in range(model.nbody) if model.body(body).name.startswith(COVERED_BY)]
    for number in range(stills):
        still = plate.shuffle()
        world.pose_hand()
        exposure = Exposure(CAMERA, number, 0.0, world.camera_pose(CAMERA), (visible_poses(world.data),))
        taken = [photographer.take(exposure) for _ in range(frames)]
        hidden = masks.of(masks.bodies(exposure.moments[0]), [*hiding, *(part.body for part in still.held)])
        holes = [
            {
                "position": position,
                "part": part,
                "upright": upright,
                "covered": round(_covered(hidden, projection, exposure.moments[0], plate.hole_m(position)), 3),
            }
            for position, (part, upright) in still.holes.items()
        ]
        for place, frame in enumerate(taken):
            name = f"seed{seed:06d}-{number:02d}" + (f"-{place:02d}" if frames > 1 else "")
            folder.row(
                "plates",
                {
                    "file": folder.image(f"images/{name}.png", frame.image),
                    "log": f"seed{seed:06d}",
                    "camera": CAMERA,
                    "world_from_camera": told_pose(frame.world_from_camera),
                    "true_camera": true_camera(world, CAMERA, bench.overhead),
                    "holes": holes,
                },
            )
    photographer.close()
    masks.close()


def _covered(hidden: NDArray[np.bool_], projection: Projection, poses: ScenePoses, hole_m: Array) -> float:
    """Share of what is seen around a hole that something hides."""
    corners = np.array([[-1.0, -1.0, 0.0], [1.0, 1.0, 0.0]]) * COVERED_HALF_M + hole_m
    pixels = projection.pixels(poses, corners)
    left, top = np.clip(np.floor(pixels.min(axis=0)), 0, None).astype(int)
    right, bottom = np.ceil(pixels.max(axis=0)).astype(int)
    seen = hidden[top:bottom, left:right]
    return float(seen.mean()) if seen.size else 1.0
