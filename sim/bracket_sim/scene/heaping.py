"""Sets parts of a tray down on others, as everyday objects are stacked; what falls or leaves the tray is put again."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import mujoco
import numpy as np

from bracket_ground.interfaces.bench import Tray
from bracket_ground.interfaces.pose import Array, Pose
from bracket_ground.interfaces.product import Product
from bracket_sim.scene.furniture import add_tray, set_physics
from bracket_sim.scene.palette import FLOOR
from bracket_sim.scene.parts import ScenePart, add_part, add_unknown_object
from bracket_sim.scene.posture import LYING, TURNS
from bracket_sim.scene.settings import PhysicsSettings
from bracket_sim.stacks.settings import StackSettings
from bracket_sim.stacks.stacking import Stack
from bracket_sim.stacks.stage import Stage

STACKS = StackSettings(deepest=2, bridging_share=0.25)
STEP_S = 0.002
TRIES, FALLEN_M = 15, 0.015  # parts are far smaller than everyday objects, and fall onto their pegs
LIES = tuple(TURNS[side] for side in LYING)


def heaped(
    product: Product,
    tray: Tray,
    floor: Sequence[ScenePart],
    high: Sequence[str],
    rng: np.random.Generator,
    margin_m: float,
) -> tuple[ScenePart, ...] | None:
    """Parts on the tray's floor, and then those that were set down on them, all as they came to rest.

    One that stays nowhere on others lies on the floor.

    Args:
        high: types of the parts that are set down on others, one after the other; they lie.
        margin_m: from the tray's wall, as far as what was set down may reach.

    Returns:
        First those of the floor, then the others; None where one found no place, or something did not come to rest.
    """
    scene = [*floor, *(ScenePart(name, Pose((0.0, 0.0, 0.0))) for name in high)]
    stage = _stage(product, tray, scene)
    middle, room_m = np.array(tray.centre_m), np.array(tray.size_m) / 2 - margin_m
    heap = Stack(stage, [LIES] * len(scene), STACKS, rng, room_m, TRIES, FALLEN_M)
    for number, part in enumerate(floor):
        stage.put(number, np.array(part.world_from_part.position_m) - middle, part.world_from_part.quaternion_wxyz)
        heap.level[number] = 0
    limit = int(rng.integers(1, STACKS.deepest + 1))
    if not heap.at_rest():
        return None
    for number in range(len(floor), len(scene)):
        if not heap.set_on_others(number, limit) and not heap.set_on_table(number):
            return None
    if not heap.at_rest() or stage.diverged:
        return None
    return tuple(
        replace(scene_part, world_from_part=_pose(stage, number, middle)) for number, scene_part in enumerate(scene)
    )


def _stage(product: Product, tray: Tray, scene: Sequence[ScenePart]) -> Stage:
    """An empty tray whose floor's middle is the origin, and its parts, which nobody has put into it yet."""
    spec = mujoco.MjSpec()
    set_physics(spec, PhysicsSettings(step_s=STEP_S))
    add_tray(spec.worldbody, tray.model_copy(update={"centre_m": (0.0, 0.0, 0.0)}), FLOOR)
    names, kinds = [f"part_{number}" for number in range(len(scene))], list(product.parts)
    for name, part in zip(names, scene, strict=True):
        if part.foreign is not None:
            add_unknown_object(spec, name, part, part.foreign)
        else:
            add_part(spec, name, part, product.parts[part.part], kinds.index(part.part))
    return Stage(spec, names)


def _pose(stage: Stage, number: int, middle_m: Array) -> Pose:
    x, y, z, *turn = stage.data.qpos[7 * number : 7 * number + 7].tolist()
    w, a, b, c = turn
    dx, dy, dz = middle_m.tolist()
    return Pose((x + dx, y + dy, z + dz), (w, a, b, c))
