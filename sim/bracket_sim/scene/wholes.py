"""Sub-assemblies in the physics: parts that are stacked as they belong become one body, welded, of the whole's type."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from itertools import product as pairs
from typing import TYPE_CHECKING

import mujoco
import numpy as np

from bracket_ground.interfaces.product import PartType, Product
from bracket_sim.scene.parts import ScenePart

if TYPE_CHECKING:
    from bracket_sim.scene.world import World, WorldPart

SEATED_M = 0.003  # how far off a part may stand on the one below it
UPRIGHT = 0.996  # cosine of its largest tilt
STILL = np.array([0.01] * 3 + [0.1] * 3)  # m/s, rad/s
PRESSED_S = 0.3  # it stands so for so long


def weld_name(low: str, upper: str) -> str:
    """Of the weld between two bodies."""
    return f"{low}+{upper}"


def add_welds(spec: mujoco.MjSpec, product: Product, scene: Mapping[str, ScenePart]) -> None:
    """Add a weld, not yet active, for every two parts that may become one body.

    Args:
        scene: parts by the names of their bodies.
    """
    named = {part: [name for name, scene_part in scene.items() if scene_part.part == part] for part in product.parts}
    couples = {
        couple: None
        for kind in product.wholes.values()
        for part in kind.made_of[1:]
        for couple in pairs(named[kind.made_of[0]], named[part])
    }
    for low, upper in couples:
        if low != upper:
            weld = spec.add_equality(name=weld_name(low, upper), type=mujoco.mjtEq.mjEQ_WELD, active=False)
            weld.objtype, weld.name1, weld.name2 = mujoco.mjtObj.mjOBJ_BODY, low, upper


class Joining:
    """Joins what stands on each other as a sub-assembly wants it, whoever put it there."""

    def __init__(self, world: World) -> None:
        self._world, self._wholes = world, world.product.wholes
        self._since_s: dict[tuple[str, str], float] = {}  # by body and sub-assembly

    def update(self, time_s: float, _dt_s: float, /) -> None:
        """Look at the parts once; called in every control period."""
        for whole, kind in self._wholes.items():
            for low in [body for body in self._world.bodies if self._begins(body, kind)]:
                stack, so = self._stack(low, kind), (low.name, whole)
                if stack is None:
                    self._since_s.pop(so, None)
                elif time_s - self._since_s.setdefault(so, time_s) >= PRESSED_S:
                    self._world.join(stack, whole)

    def _joined(self, low: WorldPart) -> tuple[str, ...]:
        """What a body is made of so far: one sub-assembly may be the beginning of another."""
        kind = self._wholes.get(low.part)
        return (low.part,) if kind is None else kind.made_of

    def _begins(self, low: WorldPart, kind: PartType) -> bool:
        done = self._joined(low)
        return len(done) < len(kind.made_of) and kind.made_of[: len(done)] == done

    def _stack(self, low: WorldPart, kind: PartType) -> list[WorldPart] | None:
        """A body and what a sub-assembly has on it, from the bottom up, where all stand still as they should."""
        kinds, done, stack = self._world.product.parts, self._joined(low), [low]
        height_m = sum(kinds[part].size_m[2] for part in done)
        for part in kind.made_of[len(done) :]:
            found = next(self._seated(low, part, height_m, stack), None)
            if found is None:
                return None
            stack.append(found)
            height_m += kinds[part].size_m[2]
        return stack if all(self._still(world_part) for world_part in stack) else None

    def _seated(self, low: WorldPart, part: str, height_m: float, stack: Sequence[WorldPart]) -> Iterator[WorldPart]:
        place = self._world.part_pose(low)
        at_m = place.transform(np.array([0.0, 0.0, height_m]))
        for body in self._world.bodies:
            if body.part == part and body not in stack:
                pose = self._world.part_pose(body)
                level = float(pose.rotation[:, 2] @ place.rotation[:, 2]) > UPRIGHT
                if level and float(np.abs(np.array(pose.position_m) - at_m).max()) < SEATED_M:
                    yield body

    def _still(self, part: WorldPart) -> bool:
        return bool(np.all(np.abs(self._world.data.qvel[part.qvel : part.qvel + 6]) < STILL))
