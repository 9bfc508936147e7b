"""Spare parts beside the bench: finished brackets go there, and bins and tray are filled from there.

How fingers carry a box of parts is not simulated: the hand is over the bracket, the bins or the tray, and parts go or
come below it, between one control period and the next.
"""

from __future__ import annotations

import math
from collections.abc import Iterable

import numpy as np

from bracket_ground.interfaces.bench import Bench
from bracket_ground.interfaces.pose import Pose
from bracket_ground.interfaces.product import Product
from bracket_sim.scene.clutter import add_to_clutter
from bracket_sim.scene.settings import ClutterSettings
from bracket_sim.scene.world import World, WorldPart
from bracket_sim.worker.worker_sight import GRASPABLE_TILT_RAD, NEAR_HOLE_HEIGHT_M, NEAR_HOLE_M

SHELF_M, SHELF_PITCH_M = (4.0, 4.0, 1.0), 0.2  # far from bench and cameras
GRIPPED_M = 0.12  # a part this close to the tool is the robot's business


class Stock:
    """Takes parts away and puts them back where such parts are kept.

    Attributes:
        kept: what is in the stock, by name of its body.

    Args:
        rng: for places in the tray.
    """

    def __init__(
        self, world: World, product: Product, bench: Bench, clutter: ClutterSettings, rng: np.random.Generator
    ) -> None:
        self._world, self._product, self._bench = world, product, bench
        self._clutter, self._rng = clutter, rng
        self._homes = {body.name: world.part_pose(body) for body in world.bodies if body.owner == "person"}
        self._known = [body for body in world.bodies if body.part in product.parts]
        bracket = bench.bracket.pose
        self._holes_m = [bracket.transform(np.array([*xy, 0.0])) for xy in product.bracket.holes_m.values()]
        self.kept: dict[str, WorldPart] = {}

    def update(self, _time_s: float, _dt_s: float, /) -> None:
        """Keep what is in the stock where it is; called in every control period."""
        for number, body in enumerate(self.kept.values()):
            x, y, z = SHELF_M
            self._set(body, Pose((x + SHELF_PITCH_M * number, y, z)))

    def take_bracket(self) -> None:
        """Take the bracket with everything in or on it, and set an empty one there."""
        self.take([body for body in self._known if self._in_bracket(body)])

    def take(self, bodies: Iterable[WorldPart]) -> None:
        """Take parts away."""
        self.kept |= {part.name: part for body in bodies for part in (body, *self._world.split(body))}
        self.update(0.0, 0.0)

    def take_held(self) -> None:
        """Take what is at the robot's fingers out of them."""
        self.take([body for body in self._known if self._at_tool(body) and not self._in_bracket(body)])

    def fallen(self) -> list[WorldPart]:
        """Parts that lie about on the bench, and not in the tray, where parts may lie."""
        return [
            body
            for body in self._known
            if body.name not in self.kept
            and self._world.data.xmat[body.body][8] < math.cos(GRASPABLE_TILT_RAD)
            and not self._in_tray(body)
            and not self._at_tool(body)
        ]

    def fill_bins(self) -> None:
        """Bring the person's parts that are in the stock to their places."""
        for body in list(self.kept.values()):
            if body.name in self._homes:
                del self.kept[body.name]
                self._set(body, self._homes[body.name])

    def fill_tray(self) -> None:
        """Put the robot's parts that are in the stock, or that fell beside the tray, between those that stand there."""
        for body in self._known:
            if body.owner == "robot" and not self._in_tray(body) and not self._busy(body):
                self.kept[body.name] = body
        self._stand([body for body in self.kept.values() if body.name not in self._homes])

    def exchange_tray(self) -> None:
        """Put another tray there: what stood in this one stands in that one, in other places."""
        self.take([body for body in self._known if self._in_tray(body) and not self._busy(body)])
        self.fill_tray()

    def free(self, part: str) -> bool:
        """Set one part of a type upright into the tray, with room around it; false where there is none to be had."""
        bodies = [body for body in self._known if body.part == part and body.owner == "robot" and not self._busy(body)]
        if not bodies:
            return False
        stored = [body for body in bodies if body.name in self.kept]
        chosen = (stored or bodies)[0]
        self.kept[chosen.name] = chosen
        self._stand([chosen], apart=True)
        return True

    def _stand(self, bodies: Iterable[WorldPart], apart: bool = False) -> None:
        bodies = list(bodies)
        there = [
            (body.part, self._world.part_pose(body))
            for body in self._known
            if body.name not in self.kept and self._in_tray(body)
        ]
        settings = self._clutter
        if apart:
            settings = settings.model_copy(update={"neighbour_share": 0.0, "nearest_gap_m": 0.03})
        for body, entry in zip(
            bodies,
            add_to_clutter(self._product, self._bench.tray, there, [part.part for part in bodies], self._rng, settings),
            strict=True,
        ):
            self.kept.pop(body.name, None)
            self._set(body, entry.world_from_part)

    def _set(self, body: WorldPart, pose: Pose) -> None:
        data = self._world.data
        data.qpos[body.qpos : body.qpos + 7] = (*pose.position_m, *pose.quaternion_wxyz)
        data.qvel[body.qvel : body.qvel + 6] = 0.0

    def _in_bracket(self, body: WorldPart) -> bool:
        offsets = (self._world.data.xpos[body.body] - hole for hole in self._holes_m)
        return any(np.hypot(x, y) < NEAR_HOLE_M and abs(z) < NEAR_HOLE_HEIGHT_M for x, y, z in offsets)

    def _in_tray(self, body: WorldPart) -> bool:
        off = np.abs(self._world.data.xpos[body.body][:2] - np.array(self._bench.tray.centre_m[:2]))
        return bool(np.all(off < np.array(self._bench.tray.size_m) / 2))

    def _busy(self, body: WorldPart) -> bool:
        """Whether the robot has it, or it is in the bracket."""
        return self._at_tool(body) or self._in_bracket(body)

    def _at_tool(self, body: WorldPart) -> bool:
        tool_m = np.array(self._world.tool_pose().position_m)
        return float(np.linalg.norm(self._world.data.xpos[body.body] - tool_m)) < GRIPPED_M
