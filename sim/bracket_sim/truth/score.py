"""Judges an assembly from the simulator's truth; nothing in the controller reads it."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from bracket_ground.interfaces.places import EMPTY, BenchPlace
from bracket_ground.interfaces.pose import Array
from bracket_sim.scene.jobs import Job
from bracket_sim.scene.world import World, WorldPart

NEAR_HOLE_M = 0.03  # a part whose origin is this close to a hole's axis is in or on that hole
NEAR_HOLE_HEIGHT_M = 0.06
SEATED_SLACK_M = 0.002  # beyond the hole's clearance
SEATED_HEIGHT_M = 0.003
UPRIGHT_RAD = math.radians(5.0)
NEAR_SPOT_M = 0.012  # from the middle of a spot at a place with a name

Hand = Literal["robot", "human"]


@dataclass(frozen=True)
class Placement:
    """A part in or on a hole.

    Attributes:
        seated: it stands upright with its peg in the hole and its body on the plate.
        by: who touched it last before it was seated.
    """

    part: str
    seated: bool
    by: Hand | None


class Score:
    """Watches who touches which part, and reports how the bracket looks.

    Args:
        job: the configuration that is to be assembled.
    """

    def __init__(self, world: World, job: Job) -> None:
        self._world, self._job = world, job
        bracket = world.bench.bracket.pose
        self._holes = {
            name: bracket.transform(np.array(world.product.slot_m(name))) for name in world.product.positions
        }
        names = [world.model.body(index).name for index in range(world.model.nbody)]
        self._robot = np.array([name.startswith("finger_") for name in names])
        self._human = np.array([name.startswith("hand") for name in names])
        self._handling = self._robot | self._human
        self._part = {part.body: part for part in world.bodies}
        self._movable = np.array([index in self._part for index in range(len(names))])
        self._touched: dict[str, Hand] = {}

    @property
    def goal(self) -> str:
        """Name of what is to be assembled."""
        return self._job.goal

    def begin(self, job: Job) -> None:
        """Another bracket: nobody has touched its parts yet."""
        self._job = job
        self._touched.clear()

    def observe(self, _time_s: float, /) -> None:
        """Note who touches parts that are not seated; brushing a seated one does not count."""
        data = self._world.data
        if not data.ncon or not self._handling[pairs := self._world.model.geom_bodyid[data.contact.geom]].any():
            return
        for mine, other in ((pairs[:, 0], pairs[:, 1]), (pairs[:, 1], pairs[:, 0])):
            self._note("robot", mine[self._movable[mine] & self._robot[other]])
            self._note("human", mine[self._movable[mine] & self._human[other]])

    def _note(self, hand: Hand, bodies: NDArray[np.int32]) -> None:
        for body in set(bodies.tolist()):
            part = self._world.carriers.get(body, self._part[body])
            if not any(self._seated(part, hole) for hole in self._holes.values()):
                self._touched[part.name] = hand

    def placements(self) -> dict[str, Placement]:
        """What is in or on every hole that is not empty; what the gripper still brings is not there yet."""
        found, held = {}, self._world.held()
        for position, hole in self._holes.items():
            for part in self._world.bodies:
                seated = self._seated(part, hole)
                if self._near(part, hole) and self._nearest(part) == position and (seated or part is not held):
                    found[position] = Placement(part.part, seated, self._touched.get(part.name))
                    break
        return found

    def report(self) -> dict[str, object]:
        """Keys of `cell run --json` that only the truth can give."""
        product, found = self._world.product, self.placements()
        there = {position: placement.part for position, placement in found.items()}
        wanted: Mapping[str, str] = self._job.placements
        if self._job.goal in product.goals:
            wanted = product.goal_placements(self._job.goal, there)
        good = {
            position
            for position, placement in found.items()
            if placement.seated and placement.part == wanted.get(position)
        }
        return {
            "correct": len(good) == len(wanted) == len(found),
            "goal": self._job.goal,
            "placements": {position: placement.part for position, placement in found.items()},
            "wrong_placements": len(found) - len(good),
            "robot_placements": sum(placement.by == "robot" for placement in found.values()),
            "human_placements": sum(placement.by == "human" for placement in found.values()),
            **({"places": self._places()} if self._world.bench.places else {}),
        }

    def _places(self) -> dict[str, list[str]]:
        """Type of the part that stands upright at each spot of the places with names; `empty` where none does."""
        world = self._world
        return {
            name: [
                next((body.part for body in world.bodies if self._stands(body, place, number)), EMPTY)
                for number in range(len(place.spots_m))
            ]
            for name, place in world.bench.places.items()
        }

    def _stands(self, part: WorldPart, place: BenchPlace, number: int) -> bool:
        kind = self._world.product.parts.get(part.part)
        if kind is None:
            return False
        wanted, found = place.stands(number, kind.peg_length_m), self._world.part_pose(part)
        x, y, z = np.subtract(found.position_m, wanted.position_m)
        upright = found.rotation[2, 2] > math.cos(UPRIGHT_RAD)
        return bool(upright and math.hypot(x, y) < NEAR_SPOT_M and abs(z) < SEATED_HEIGHT_M)

    def _nearest(self, part: WorldPart) -> str:
        place = self._world.data.xpos[part.body]
        return min(self._holes, key=lambda name: float(np.linalg.norm(place - self._holes[name])))

    def _near(self, part: WorldPart, hole: Array) -> bool:
        x, y, z = self._world.data.xpos[part.body] - hole
        return math.hypot(x, y) < NEAR_HOLE_M and abs(z) < NEAR_HOLE_HEIGHT_M

    def _seated(self, part: WorldPart, hole: Array) -> bool:
        x, y, z = self._world.data.xpos[part.body] - hole
        cosine = self._world.data.xmat[part.body][8]
        slack = self._world.product.bracket.hole_clearance_m + SEATED_SLACK_M
        return bool(math.hypot(x, y) < slack and abs(z) < SEATED_HEIGHT_M and cosine > math.cos(UPRIGHT_RAD))
