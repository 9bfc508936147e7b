"""Scores of a grasp planner on fresh scenes: answers per object (Table 2) and iterative solving (Table 3)."""

from __future__ import annotations

import math
from collections import Counter
from dataclasses import dataclass

import numpy as np

from cell.interfaces.errors import ModelError
from cell.interfaces.planning import GraspPlan, GraspPlanner
from cell.interfaces.product import Product
from learned.grasp.boxes import Blocks, Boxes
from learned.grasp.options import graspable
from learned.grasp.physics import touching
from learned.grasp.scenes import Scene, draw_scenes, observe
from learned.grasp.settings import SceneSettings
from learned.grasp.solution import solve, solves

REQUIRED_TYPES = (1, 2, 3)
SCENE_SIZES = (3, 4, 5, 6)
_Z_95 = 1.96


def evaluate_grasp(
    planner: GraspPlanner, product: Product, seed: int, scenes: int = 1000, settings: SceneSettings | None = None
) -> dict[str, float]:
    """Scores in 0..1, each with the half width of its 95 % confidence interval under `<name>_ci95`.

    `object_accuracy_k`: the whole answer is right (graspable, or a shortest sequence that works, or help), over one
    required object of each of k types; `graspability_accuracy`: the verdict alone; `solution_accuracy`: the answer
    for objects that are not graspable; `iterative_success_n`: scenes of n parts in which Algorithm 2, looking anew
    after every grasp, ends with the required part grasped, or asks for help where nothing else helps;
    `needless_moves_n`: moves beyond the fewest, per scene.
    """
    settings = settings or SceneSettings()
    tally = _Tally()
    for index, scene in enumerate(draw_scenes(product, seed, scenes, "test", settings)):
        _score_objects(planner, scene, np.random.default_rng([seed, index]), tally)
    for size in SCENE_SIZES:
        for index, scene in enumerate(draw_scenes(product, seed, scenes // 4, "test", settings, (size, size))):
            run = solve_iteratively(planner, scene, np.random.default_rng([seed, size, index]), settings)
            tally.add(f"iterative_success_{size}", run.success)
            tally.moves(f"needless_moves_{size}", run.needless_moves)
    return tally.scores()


@dataclass(frozen=True)
class IterativeRun:
    """How Algorithm 2 went in one scene, in geometry."""

    success: bool
    moves: int
    needless_moves: int
    reason: str


def solve_iteratively(
    planner: GraspPlanner, scene: Scene, rng: np.random.Generator, settings: SceneSettings
) -> IterativeRun:
    """Algorithm 2 on one scene: a random part is required; each grasp is judged by the truth, then all is seen anew."""
    standing = list(range(len(scene.boxes)))
    required = int(rng.integers(len(standing)))
    wanted = scene.solution(required)
    moves = 0
    while True:
        boxes = scene.boxes.take(standing)
        target = _next_grasp(planner, boxes, standing.index(required), rng, settings)
        if target is None:
            return _run(wanted.needs_help, moves, len(wanted.moves), "asked for help")
        if not graspable(touching(boxes, settings.outline))[target]:
            return _run(False, moves, len(wanted.moves), "collided")
        if standing[target] == required:
            return _run(True, moves, len(wanted.moves), "grasped")
        standing.pop(target)
        moves += 1


def answer(planner: GraspPlanner, parts_of: Scene, required: int) -> GraspPlan:
    """The planner's answer; one that it cannot put into words counts as a call for help."""
    try:
        return planner.plan(parts_of.parts, required)
    except ModelError:
        return GraspPlan(0.0, (), True, "help")


def is_right(plan: GraspPlan, blocks: Blocks, required: int) -> bool:
    """Whether a plan is one of the best that there are."""
    if plan.needs_help:
        return solve(blocks, required, range(len(blocks))).needs_help
    return solves(plan.blockers, blocks, required)


class _Tally:
    def __init__(self) -> None:
        self._right: Counter[str] = Counter()
        self._all: Counter[str] = Counter()
        self._moves: Counter[str] = Counter()
        self._scenes: Counter[str] = Counter()

    def add(self, name: str, right: bool) -> None:
        self._right[name] += right
        self._all[name] += 1

    def moves(self, name: str, count: int) -> None:
        self._moves[name] += count
        self._scenes[name] += 1

    def scores(self) -> dict[str, float]:
        scores: dict[str, float] = {}
        for name, count in self._all.items():
            share = self._right[name] / count
            scores[name] = share
            scores[f"{name}_ci95"] = _half_width(share, count)
        return scores | {name: self._moves[name] / count for name, count in self._scenes.items()}


def _half_width(share: float, count: int) -> float:
    """Half width of Wilson's 95 % interval, which does not collapse at 0 and 1."""
    spread = math.sqrt(share * (1 - share) / count + _Z_95**2 / (4 * count**2))
    return _Z_95 * spread / (1 + _Z_95**2 / count)


def _score_objects(planner: GraspPlanner, scene: Scene, rng: np.random.Generator, tally: _Tally) -> None:
    types = sorted(set(scene.boxes.types))
    chosen = [types[i] for i in rng.permutation(len(types))]
    objects = [int(rng.choice([i for i, name in enumerate(scene.boxes.types) if name == kind])) for kind in chosen]
    right = []
    for required in objects:
        plan = answer(planner, scene, required)
        right.append(is_right(plan, scene.blocks, required))
        tally.add("graspability_accuracy", (plan.graspable >= 0.5) == scene.graspable(required))
        if not scene.graspable(required):
            tally.add("solution_accuracy", right[-1])
    for count in REQUIRED_TYPES:
        if len(objects) >= count:
            for correct in right[:count]:
                tally.add(f"object_accuracy_{count}", correct)


def _next_grasp(
    planner: GraspPlanner, boxes: Boxes, required: int, rng: np.random.Generator, settings: SceneSettings
) -> int | None:
    """Alg. 2 on one image: from the required part along "move b" to a part that is graspable; None asks for help."""
    seen = Scene(boxes, touching(boxes, settings.outline), observe(boxes, rng, settings.noise), settings.noise)
    target, asked = required, {required}
    while True:
        plan = answer(planner, seen, target)
        if plan.needs_help:
            return None
        if not plan.blockers:
            return target
        target = plan.blockers[0]
        if target in asked:
            return None
        asked.add(target)


def _run(success: bool, moves: int, fewest: int, reason: str) -> IterativeRun:
    return IterativeRun(success, moves, max(0, moves - fewest), reason)
