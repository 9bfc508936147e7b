"""A bench with a person at it, for the tests of hand and worker."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import cache, partial
from pathlib import Path

import numpy as np
import yaml

from bracket_ground.interfaces.bench import Bench
from bracket_ground.interfaces.product import Product
from bracket_sim.scene.hand import add_hand
from bracket_sim.scene.parts import ScenePart
from bracket_sim.scene.person import Person
from bracket_sim.scene.storage import lay_out
from bracket_sim.scene.world import World, build_world
from bracket_sim.worker.worker import Worker

PERIOD_S = 0.008
CONFIG = Path(__file__).parents[2] / "config"


@cache
def product() -> Product:
    return Product(**yaml.safe_load((CONFIG / "products.yaml").read_text(encoding="utf-8")))


@cache
def bench() -> Bench:
    return Bench(**yaml.safe_load((CONFIG / "cell.yaml").read_text(encoding="utf-8"))["bench"])


def world_with_hand(scene: Sequence[ScenePart] | None = None) -> World:
    world = build_world(product(), bench(), scene, extend=partial(add_hand, bench=bench()))
    world.settle()
    return world


def world_of(person: Person, seed: int) -> World:
    """The bench of a person who keeps parts in their own way."""
    layout = lay_out(product(), bench(), person.storage, np.random.default_rng(seed))
    extend = partial(add_hand, bench=bench(), habits=person)
    world = build_world(product(), bench(), layout.parts, extend=extend, bins=layout.bins)
    world.settle()
    return world


class Shift:
    """A worker in a world, advanced together."""

    def __init__(
        self, goal: str = "g0", seed: int = 0, settings: Person | None = None, world: World | None = None
    ) -> None:
        self.world = world or world_with_hand()
        rng = np.random.default_rng(seed)
        chance = np.random.default_rng(seed + 1000)
        wanted = product().goal_placements(goal)
        self.worker = Worker(self.world, product(), bench(), settings or Person(), wanted, rng, chance)
        self.goal = goal
        self.time_s = 0.0

    def period(self) -> None:
        self.worker.update(self.time_s, PERIOD_S)
        self.world.step_period()
        self.time_s += PERIOD_S

    def until(self, condition: Callable[[], bool], longest_s: float = 150.0) -> bool:
        """Go on until something is so; whether it came to be in time."""
        end_s = self.time_s + longest_s
        while not condition() and self.time_s < end_s:
            self.period()
        return condition()

    def doing(self, kind: str) -> bool:
        """Whether the person does this now."""
        return bool(self.worker.events) and self.worker.events[-1].kind == kind

    def placed(self) -> dict[str, str]:
        """Type of the part that sits well in a hole, by position."""
        found = {}
        for position, (x, y) in product().bracket.holes_m.items():
            hole = bench().bracket.pose.transform(np.array([x, y, 0.0]))
            for part in self.world.bodies:
                pose = self.world.part_pose(part)
                near = np.linalg.norm(np.array(pose.position_m) - hole) < 0.006
                if near and pose.rotation[2, 2] > 0.996:
                    found[position] = part.part
        return found
