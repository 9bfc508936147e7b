"""Where things are in the images of a camera: boxes of geoms from their poses, and masks from rendering."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import mujoco
import numpy as np
from numpy.typing import NDArray

from bracket_ground.errors import InputError
from bracket_ground.interfaces.bench import CameraCalibration, CameraSetup
from bracket_ground.interfaces.places import Mount
from bracket_ground.interfaces.pose import Array, Pose
from bracket_ground.interfaces.product import Product
from bracket_sim.rendering.studio import VISIBLE, ScenePoses, show_poses
from bracket_sim.scene.hand import FOREARM_SKIN_GROUP
from bracket_sim.scene.lens import Lens
from bracket_sim.scene.look import Look
from bracket_sim.scene.settings import ClutterSettings
from bracket_sim.scene.world import CAMERA_FROM_MUJOCO, World

MOST_FOREIGN = 2
LYING_SHARE, STACKED_SHARE = 0.2, 0.06  # of the parts in a mixed tray
STEEL_LEVELS = (0.40, 0.58)  # grey of bare steel, drawn for each type
TINT = 0.02
CLUTTER_STREAM, STEEL_STREAM = 6, 7
SPLITS = {"train": range(800_000), "validation": range(800_000, 900_000), "test": range(900_000, 1_000_000)}


def mixed_clutter(
    settings: ClutterSettings, seed: int, lying_share: float = LYING_SHARE, stacked_share: float = STACKED_SHARE
) -> ClutterSettings:
    """Trays in which some parts lie, some are on top of others, and up to MOST_FOREIGN objects are of no type."""
    foreign = int(np.random.default_rng([seed, CLUTTER_STREAM]).integers(MOST_FOREIGN + 1))
    mixed = {"lying_share": lying_share, "stacked_share": stacked_share, "foreign_objects": foreign}
    return settings.model_copy(update=mixed)


def sometimes_steel(product: Product, share: float, seed: int) -> Product:
    """The product in bare steel with this probability, and as it is otherwise; shapes stay what they are."""
    rng = np.random.default_rng([seed, STEEL_STREAM])
    if rng.random() >= share:
        return product
    parts = {}
    for name, kind in product.parts.items():
        red, green, blue = (float(level) for level in rng.uniform(*STEEL_LEVELS) + rng.uniform(-TINT, TINT, 3))
        parts[name] = kind.model_copy(update={"colour_rgb": (red, green, blue), "finish": "steel"})
    return product.model_copy(update={"parts": parts})


def seeds(first_seed: int, recordings: int) -> tuple[str, range]:
    """The split of a number of seeds in a row, and the seeds.

    Raises:
        InputError: they are not all of one split.
    """
    asked = range(first_seed, first_seed + recordings)
    for name, split in SPLITS.items():
        if asked and asked[0] in split and asked[-1] in split:
            return name, asked
    legal = ", ".join(f"{name} {split[0]} to {split[-1]}" for name, split in SPLITS.items())
    raise InputError(f"seeds {first_seed} to {first_seed + recordings - 1} are not of one split; legal: {legal}")


CORNERS = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)], dtype=np.float64)
GEOM_POSITIONS, GEOM_TURNS = VISIBLE.index("geom_xpos"), VISIBLE.index("geom_xmat")
SITE_POSITIONS = VISIBLE.index("site_xpos")
CAMERA_POSITIONS, CAMERA_TURNS = VISIBLE.index("cam_xpos"), VISIBLE.index("cam_xmat")

Box = tuple[int, int, int, int]


def fingertip(model: mujoco.MjModel, poses: ScenePoses, bone: int, palm_m: Array) -> Array:
    """The end of a finger's last bone (a capsule's geom) that is away from the palm, (3,)."""
    along = poses[GEOM_TURNS][bone].reshape(3, 3)[:, 2] * model.geom_size[bone][1]
    ends: Array = poses[GEOM_POSITIONS][bone] + np.array([along, -along])
    farthest: Array = ends[np.linalg.norm(ends - palm_m, axis=1).argmax()]
    return farthest


class Projection:
    """The true camera of a look: its own mount and lens, not those that the controller believes in.

    Attributes:
        camera: its number in the compiled world.
    """

    def __init__(self, world: World, camera: str, setup: CameraSetup, look: Look) -> None:
        self._model, self.camera = world.model, int(world.model.camera(camera).id)
        self._setup, self._look = setup, look.camera

    def inside(self, pixels: Array) -> NDArray[np.bool_]:
        """(n,) Which pixels (n, 2) are in the image."""
        size = (self._setup.width_px, self._setup.height_px)
        found: NDArray[np.bool_] = np.all((pixels >= 0) & (pixels < size), axis=1)
        return found

    def box(self, poses: ScenePoses, geoms: NDArray[np.int64]) -> Box | None:
        """(left, top, right, bottom) around geoms, from the boxes around each; None where it is out of the image."""
        centres = poses[GEOM_POSITIONS][geoms]
        turns = poses[GEOM_TURNS][geoms].reshape(-1, 3, 3)
        aabb = self._model.geom_aabb[geoms]
        local = aabb[:, np.newaxis, :3] + CORNERS * aabb[:, np.newaxis, 3:]
        pixels = self.pixels(poses, (centres[:, np.newaxis] + local @ turns.transpose(0, 2, 1)).reshape(-1, 3))
        low, high = np.floor(pixels.min(axis=0)), np.ceil(pixels.max(axis=0)) + 1
        left, top = (int(value) for value in np.maximum(low, 0))
        right, bottom = (int(value) for value in np.minimum(high, (self._setup.width_px, self._setup.height_px)))
        return (left, top, right, bottom) if left < right and top < bottom else None

    def pixels(self, poses: ScenePoses, points_m: Array) -> Array:
        """World points (n, 3) to pixels (n, 2) as (column, row)."""
        turn = poses[CAMERA_TURNS][self.camera].reshape(3, 3)
        x, y, z = ((points_m - poses[CAMERA_POSITIONS][self.camera]) @ turn).T
        straight = np.stack([x, -y], axis=1) / -z[:, np.newaxis]
        square = (straight**2).sum(axis=1, keepdims=True)
        bent = straight * (1 + self._look.distortion_k1 * square + self._look.distortion_k2 * square**2)
        model = self._setup.model
        pixels: Array = bent * model.focals_px * (1 + self._look.focal_error) + model.middle_px
        return pixels


def told_pose(pose: Pose) -> dict[str, Any]:
    """As rows tell it."""
    return {"position_m": pose.position_m, "quaternion_wxyz": pose.quaternion_wxyz}


def true_camera(world: World, camera: str, setup: CameraSetup) -> dict[str, Any]:
    """Where a camera really is, and its real lens, as rows tell it."""
    seen, look = world.data.camera(camera), world.look.camera
    turned = np.eye(4)
    turned[:3, :3], turned[:3, 3] = seen.xmat.reshape(3, 3), seen.xpos
    pose = Pose.from_matrix(turned) @ CAMERA_FROM_MUJOCO.inverse()
    lens = {"distortion_k1": look.distortion_k1, "distortion_k2": look.distortion_k2}
    return {**told_pose(pose), **_true_axes(setup, look.focal_error), **lens}


def _true_axes(setup: CameraSetup, focal_error: float) -> dict[str, Any]:
    longer = 1 + focal_error
    focals = {"focal_px": setup.focal_px * longer, "focal_y_px": setup.focal_y_px and setup.focal_y_px * longer}
    return {**focals, "principal_px": setup.principal_px}


class Masks:
    """Renders which body each pixel of a camera shows; close it."""

    def __init__(self, world: World, camera: str, setup: CameraSetup, look: Look) -> None:
        self._model, self._camera, self._setup = world.model, camera, setup
        self._data = mujoco.MjData(world.model)
        self._renderer = mujoco.Renderer(world.model, setup.height_px, setup.width_px)
        self._renderer.enable_segmentation_rendering()
        self._options = mujoco.MjvOption()
        self._options.geomgroup[FOREARM_SKIN_GROUP] = 0
        self._lens = Lens(setup, look.camera)

    def bodies(self, poses: ScenePoses) -> NDArray[np.int64]:
        """(height, width) body ids, -1 for the background, before the lens bends the image."""
        show_poses(self._data, poses)
        self._renderer.update_scene(self._data, self._camera, self._options)
        seen = self._renderer.render()
        geoms = np.where(seen[..., 1] == int(mujoco.mjtObj.mjOBJ_GEOM), seen[..., 0], -1)
        found: NDArray[np.int64] = np.where(geoms >= 0, self._model.geom_bodyid[geoms], -1).astype(np.int64)
        return found

    def of(self, bodies: NDArray[np.int64], wanted: Sequence[int]) -> NDArray[np.bool_]:
        """(height, width) which pixels of the camera's frame show one of these bodies."""
        mask = np.isin(bodies, wanted).astype(np.uint8) * 255
        shown: NDArray[np.bool_] = self._lens.bend(mask) > 127
        return shown

    def close(self) -> None:
        """Let go of the graphics context."""
        self._renderer.close()


def box_of(mask: NDArray[np.bool_]) -> Box | None:
    """Around all pixels of a mask; None where it has none."""
    rows, columns = np.flatnonzero(mask.any(axis=1)), np.flatnonzero(mask.any(axis=0))
    if not len(rows):
        return None
    return int(columns[0]), int(rows[0]), int(columns[-1]) + 1, int(rows[-1]) + 1


def true_calibration(world: World, camera: str, setup: CameraSetup) -> CameraCalibration:
    """What a perfect calibration would find in a simulated world."""
    look = world.look
    pose = getattr(look.mounts, camera).apply(setup.mount.pose)
    return CameraCalibration(
        mount=Mount(position_m=pose.position_m, quaternion_wxyz=pose.quaternion_wxyz),
        **_true_axes(setup, look.camera.focal_error),
        distortion_k1=look.camera.distortion_k1,
        distortion_k2=look.camera.distortion_k2,
    )
