"""Images of the wrist camera over random trays, with type, pose, posture and box of everything in them."""

from __future__ import annotations

import mujoco
import numpy as np
from numpy.typing import NDArray

from bracket_ground.files.data_folder import DataFolder
from bracket_ground.interfaces.bench import Bench
from bracket_ground.interfaces.product import Product
from bracket_lab.drawing.sight import Masks, Projection, box_of, told_pose, true_camera
from bracket_sim.rendering.photographer import Exposure, Photographer, SensorSetup
from bracket_sim.rendering.studio import ScenePoses, visible_poses
from bracket_sim.scene.clutter import full_set, sample_clutter
from bracket_sim.scene.look import Look
from bracket_sim.scene.settings import SimSettings
from bracket_sim.scene.world import World, build_world
from bracket_sim.truth.labels import resting_parts

CAMERA = "wrist"
LEAST_PX = 30  # of a part that counts as seen
ARM_OFF_RAD = 0.02  # standard deviation of each joint from the pose in which the arm looks


def write_objects(
    product: Product, bench: Bench, settings: SimSettings, seed: int, folder: DataFolder, views: int = 1
) -> None:
    """An image and a row of objects.jsonl for each view of one tray; the scene is drawn from the seed.

    Args:
        views: how many images are taken of the tray, each with the arm a little elsewhere.
    """
    rng = np.random.default_rng([seed, 4])
    look = settings.look.draw(seed)
    types = full_set(product)
    chosen = [types[index] for index in rng.permutation(len(types))[: int(rng.integers(1, len(types) + 1))]]
    scene = sample_clutter(product, bench.tray, chosen, rng, settings.clutter)
    world = build_world(product, bench, scene, settings.physics, None, look)
    world.settle()
    photographer = Photographer(world.model, {CAMERA: SensorSetup(bench.wrist, look.camera, rng)})
    masks = Masks(world, CAMERA, bench.wrist, look)
    for view in range(views):
        world.set_arm(np.array(bench.arm_look_rad) + rng.normal(0.0, ARM_OFF_RAD, len(bench.arm_look_rad)))
        exposure = Exposure(CAMERA, view, 0.0, world.camera_pose(CAMERA), (visible_poses(world.data),))
        frame = photographer.take(exposure)
        name = f"seed{seed:06d}" + (f"-{view}" if view else "")
        folder.row(
            "objects",
            {
                "file": folder.image(f"images/{name}.png", frame.image),
                "log": f"seed{seed:06d}",
                "camera": CAMERA,
                "world_from_camera": told_pose(frame.world_from_camera),
                "true_camera": true_camera(world, CAMERA, bench.wrist),
                "parts": _parts(world, product, bench, masks, exposure.moments[0], look),
            },
        )
    photographer.close()
    masks.close()


def _parts(
    world: World, product: Product, bench: Bench, masks: Masks, poses: ScenePoses, look: Look
) -> list[dict[str, object]]:
    """Everything in the tray of which enough is seen; `on` are the rows of this list that carry it."""
    seen = masks.bodies(poses)
    projection = Projection(world, CAMERA, bench.wrist, look)
    resting, shown_of = resting_parts(world), dict[str, NDArray[np.bool_]]()
    parts: list[dict[str, object]] = []
    for body in world.bodies:
        shown = masks.of(seen, [body.body])
        if int(shown.sum()) >= LEAST_PX:
            shown_of[body.name] = shown
    rows = {name: number for number, name in enumerate(shown_of)}
    for body, rests in zip(world.bodies, resting, strict=True):
        if body.name not in shown_of:
            continue
        shown = shown_of[body.name]
        kind = product.parts.get(body.part)
        parts.append(
            {
                "part": body.part,
                "posture": rests.posture,
                "on": [rows[name] for name in rests.on if name in rows],
                "world_from_part": told_pose(rests.world_from_part),
                "size_m": None if kind is None else kind.size_m,
                "box_px": box_of(shown),
                "whole_box_px": projection.box(poses, _geoms(world.model, body.body)),
                "visible_px": int(shown.sum()),
            }
        )
    return parts


def _geoms(model: mujoco.MjModel, body: int) -> NDArray[np.int64]:
    """Everything of a body that is seen."""
    found: NDArray[np.int64] = np.flatnonzero((model.geom_bodyid == body) & (model.geom_group < 3))
    return found
