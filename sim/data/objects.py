"""Images of the wrist camera over random trays, with type, pose and visible box of every part."""

from __future__ import annotations

import numpy as np

from cell.interfaces.bench import Bench
from cell.interfaces.product import Product
from sim.clutter import full_set, sample_clutter
from sim.data.folder import DataFolder
from sim.data.sight import Masks, box_of
from sim.photographer import Exposure, Photographer, SensorSetup
from sim.settings import SimSettings
from sim.studio import visible_poses
from sim.world import build_world

CAMERA = "wrist"
LEAST_PX = 30  # of a part that counts as seen
ARM_OFF_RAD = 0.02  # standard deviation of each joint from the pose in which the arm looks


def write_objects(product: Product, bench: Bench, settings: SimSettings, seed: int, folder: DataFolder) -> None:
    """One image, one row of objects.jsonl; the scene is drawn from the seed."""
    rng = np.random.default_rng([seed, 4])
    look = settings.look.draw(seed)
    types = full_set(product)
    chosen = [types[index] for index in rng.permutation(len(types))[: int(rng.integers(1, len(types) + 1))]]
    scene = sample_clutter(product, bench.tray, chosen, rng, settings.clutter)
    world = build_world(product, bench, scene, settings.physics, None, look)
    world.settle()
    world.set_arm(np.array(bench.arm_look_rad) + rng.normal(0.0, ARM_OFF_RAD, 6))
    photographer = Photographer(world.model, {CAMERA: SensorSetup(bench.wrist, look.camera, rng)})
    masks = Masks(world, CAMERA, bench.wrist, look)
    exposure = Exposure(CAMERA, 0, 0.0, world.camera_pose(CAMERA), (visible_poses(world.data),))
    frame, bodies = photographer.take(exposure), masks.bodies(exposure.moments[0])
    parts = []
    for body in world.bodies:
        shown = masks.of(bodies, [body.body])
        box = box_of(shown)
        if box is None or int(shown.sum()) < LEAST_PX:
            continue
        pose, kind = world.part_pose(body), product.parts[body.part]
        parts.append(
            {
                "part": body.part,
                "world_from_part": {"position_m": pose.position_m, "quaternion_wxyz": pose.quaternion_wxyz},
                "size_m": kind.size_m,
                "box_px": box,
                "visible_px": int(shown.sum()),
            }
        )
    photographer.close()
    masks.close()
    mount = frame.world_from_camera
    folder.row(
        "objects",
        {
            "file": folder.image(f"images/seed{seed:06d}.png", frame.image),
            "log": f"seed{seed:06d}",
            "camera": CAMERA,
            "world_from_camera": {"position_m": mount.position_m, "quaternion_wxyz": mount.quaternion_wxyz},
            "parts": parts,
        },
    )
