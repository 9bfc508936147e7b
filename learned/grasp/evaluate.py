"""Scores of a grasp planner: answers for each object (Table 2) and iterative solving (Table 3)."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from cell.interfaces.errors import ModelError
from cell.interfaces.planning import GraspPlan, GraspPlanner
from cell.interfaces.product import Product
from learned.grasp.boxes import Blocks, Boxes
from learned.grasp.candidates import graspable
from learned.grasp.physics import touching
from learned.grasp.scenes import Scene, Split, draw_scenes, observe
from learned.grasp.settings import SceneSettings
from learned.grasp.solution import solve, solves
from learned.scores import ScoreCounter

REQUIRED_TYPES = (1, 2, 3)
SCENE_SIZES = (3, 4, 5, 6)


def evaluate_grasp(
    planner: GraspPlanner,
    product: Product,
    seed: int,
    scenes: int = 1000,
    settings: SceneSettings | None = None,
    split: Split = "test",
) -> dict[str, float]:
    """Scores in 0..1, each with the ends of its 95 % confidence interval under `<name>_low` and `<name>_high`.

    `object_accuracy_by_type`: the same for the first of them, where parts of one type are alike;
    `object_accuracy_k`: the whole answer is right (graspable, or a shortest sequence that works, or help), over one
    required object of each of k types; `graspability_accuracy`: the verdict alone; `solution_accuracy`: the answer
    for objects that are not graspable; `iterative_success_n`: scenes of n parts in which Algorithm 2, looking anew
    after every grasp, ends with the required part grasped, or asks for help where nothing else helps;
    `steps_n`, `needless_moves_n`: grasps, and those beyond the fewest, per scene.
    """
    settings = settings or SceneSettings()
    scores = evaluate_scenes(planner, list(draw_scenes(product, seed, scenes, split, settings)), seed)
    for size in SCENE_SIZES:
        drawn = draw_scenes(product, seed, max(1, scenes // 4), split, settings, (size, size))
        scores |= iterative_scores(planner, drawn, seed, size, settings)
    return scores


def evaluate_scenes(planner: GraspPlanner, scenes: Sequence[Scene], seed: int) -> dict[str, float]:
    """The scores of single answers, over given scenes."""
    return object_scores(scenes, seed, lambda index, required: answer(planner, scenes[index], required))


def object_scores(scenes: Sequence[Scene], seed: int, ask: Callable[[int, int], GraspPlan]) -> dict[str, float]:
    """The scores of single answers.

    Args:
        seed: chooses which objects are required.
        ask: answer about a scene's number and a required object's.
    """
    counter = ScoreCounter()
    for index, scene in enumerate(scenes):
        right = []
        for required in _required_objects(scene, np.random.default_rng([seed, index])):
            plan = ask(index, required)
            right.append(is_right(plan, scene.blocks, required))
            counter.add("graspability_accuracy", (plan.graspable >= 0.5) == scene.graspable(required))
            if not scene.graspable(required):
                counter.add("solution_accuracy", right[-1])
            if not len(right) - 1:
                counter.add("object_accuracy_by_type", right[-1] or _right_by_type(plan, scene, required))
        for count in REQUIRED_TYPES:
            if len(right) >= count:
                for correct in right[:count]:
                    counter.add(f"object_accuracy_{count}", correct)
    return counter.scores()


def iterative_scores(
    planner: GraspPlanner, scenes: Iterator[Scene], seed: int, size: int, settings: SceneSettings
) -> dict[str, float]:
    """The scores of Algorithm 2 over scenes of `size` parts."""
    counter = ScoreCounter()
    for index, scene in enumerate(scenes):
        run = solve_iteratively(planner, scene, np.random.default_rng([seed, size, index]), settings)
        counter.add(f"iterative_success_{size}", run.success)
        counter.measure(f"steps_{size}", run.steps)
        counter.measure(f"needless_moves_{size}", run.needless_moves)
    return counter.scores()


@dataclass(frozen=True)
class IterativeRun:
    """How Algorithm 2 went in one scene, in geometry.

    Attributes:
        steps: grasps, the required part's included.
        needless_moves: grasps of other parts beyond the fewest.
    """

    success: bool
    steps: int
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
        needless = max(0, moves - len(wanted.moves))
        if target is None:
            return IterativeRun(wanted.needs_help, moves, needless, "asked for help")
        if not graspable(touching(boxes, settings.outline))[target]:
            return IterativeRun(False, moves, needless, "collided")
        if standing[target] == required:
            return IterativeRun(True, moves + 1, needless, "grasped")
        standing.pop(target)
        moves += 1


def answer(planner: GraspPlanner, scene: Scene, required: int) -> GraspPlan:
    """The planner's answer; one that it cannot put into words counts as a call for help."""
    try:
        return planner.plan(scene.parts, required)
    except ModelError:
        return GraspPlan(0.0, (), True, "help")


def is_right(plan: GraspPlan, blocks: Blocks, required: int) -> bool:
    """Whether a plan is one of the best that there are."""
    if plan.needs_help:
        return solve(blocks, required, range(len(blocks))).needs_help
    return solves(plan.blockers, blocks, required)


def _right_by_type(plan: GraspPlan, scene: Scene, required: int) -> bool:
    """Whether a plan moves as many parts of every type as the right one does: what the paper's words say."""
    wanted = scene.solution(required)
    types = [sorted(scene.boxes.types[part] for part in moves) for moves in (plan.blockers, wanted.moves)]
    return plan.needs_help == wanted.needs_help and types[0] == types[1]


def _required_objects(scene: Scene, rng: np.random.Generator) -> list[int]:
    """One object of each type in the scene, in random order."""
    types = sorted(set(scene.boxes.types))
    chosen = [types[i] for i in rng.permutation(len(types))]
    return [int(rng.choice([i for i, name in enumerate(scene.boxes.types) if name == kind])) for kind in chosen]


def _next_grasp(
    planner: GraspPlanner, boxes: Boxes, required: int, rng: np.random.Generator, settings: SceneSettings
) -> int | None:
    """Alg. 2 on one image: from the required part along "move b" to a part that is graspable; None asks for help."""
    seen = Scene(
        boxes, touching(boxes, settings.outline), observe(boxes, rng, settings.noise, settings.crops), settings.noise
    )
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
