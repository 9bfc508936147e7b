"""Scores of a grasp planner: answers for each object (Table 2) and iterative solving (Table 3)."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Protocol, runtime_checkable

import numpy as np

from bracket_cell.learned.grasp.boxes import Blocks, Boxes
from bracket_cell.learned.grasp.candidates import graspable, touching
from bracket_cell.learned.grasp.crops import TrayCamera, with_embeddings
from bracket_cell.learned.grasp.settings import SceneSettings
from bracket_cell.learned.grasp.solution import solve, solves
from bracket_cell.learned.inference.onnx_model import Network
from bracket_ground.errors import ModelError
from bracket_ground.interfaces.perception import PartDetection
from bracket_ground.interfaces.planning import GraspPlan, GraspPlanner
from bracket_ground.interfaces.product import Product
from bracket_lab.learned.grasp.scenes import Scene, Split, draw_scenes, observe
from bracket_lab.learned.scores import ScoreCounter

Look = Callable[[list[Scene]], list[Scene]]
REQUIRED_TYPES = (1, 2, 3)
SCENE_SIZES = (3, 4, 5, 6)


@runtime_checkable
class Together(Protocol):
    """A planner that answers several questions about one graph."""

    def plan_together(self, parts: tuple[PartDetection, ...], required: Sequence[int]) -> tuple[GraspPlan, ...]:
        """Plans for all required parts."""
        ...

    def prepare(self, questions: Sequence[tuple[tuple[PartDetection, ...], tuple[int, ...]]]) -> None:
        """Work out the answer about the first required part of each question in one go."""
        ...


class AlwaysGrasp:
    """The trivial planner: whatever is required can be grasped as it stands (GraspPlanner)."""

    def plan(self, parts: tuple[PartDetection, ...], required: int) -> GraspPlan:
        del parts, required
        return GraspPlan(1.0, (), False, "grasp")


def evaluate_grasp(
    planner: GraspPlanner,
    product: Product,
    seed: int,
    scenes: int = 1000,
    settings: SceneSettings | None = None,
    split: Split = "test",
    look: Look = list,
) -> dict[str, float]:
    """Scores in 0..1, each with the ends of its 95 % confidence interval under `<name>_low` and `<name>_high`.

    `object_accuracy_k`: the whole answer is right (graspable, or a shortest sequence that works, or help), over one
    required object of each of k types; `by_type_k`: the same, where parts of one type are alike, as the paper's words
    name types; `graspability_accuracy`: the verdict alone; `solution_accuracy`: the answer
    for objects that are not graspable; `iterative_success_n`: scenes of n parts in which Algorithm 2, looking anew
    after every grasp, ends with the required part grasped, or asks for help where nothing else helps;
    `steps_n`, `needless_moves_n`: grasps, and those beyond the fewest, per scene. Where a planner answers several
    questions about one graph, those of k types are asked together.

    Args:
        look: what the detector adds to scenes, as embeddings of crops.
    """
    settings = settings or SceneSettings()
    scores = evaluate_scenes(planner, look(list(draw_scenes(product, seed, scenes, split, settings))), seed)
    for size in SCENE_SIZES:
        drawn = draw_scenes(product, seed, max(1, scenes // 4), split, settings, (size, size))
        scores |= iterative_scores(planner, drawn, seed, size, settings, look)
    return scores


def evaluate_scenes(planner: GraspPlanner, scenes: Sequence[Scene], seed: int) -> dict[str, float]:
    """The scores of single answers, over given scenes."""
    if isinstance(planner, Together):
        planner.prepare(
            [
                (scene.parts, (asked, *(other for other in some if other != asked)))
                for index, scene in enumerate(scenes)
                for some in _questions(scene, seed, index)
                for asked in some
            ]
        )
    counter = ScoreCounter()
    for index, scene in enumerate(scenes):
        for required in _questions(scene, seed, index):
            for part, plan in zip(required, answers(planner, scene, required), strict=True):
                _count(counter, plan, scene, part, len(required))
    return counter.scores()


def _questions(scene: Scene, seed: int, index: int) -> list[list[int]]:
    """One required object; one of each of two types; one of each of three: if the product has that many types."""
    required = _required_objects(scene, np.random.default_rng([seed, index]))
    return [required[:count] for count in REQUIRED_TYPES if len(required) >= count]


def _count(counter: ScoreCounter, plan: GraspPlan, scene: Scene, required: int, types: int) -> None:
    right = is_right(plan, scene.blocks, required)
    counter.add(f"object_accuracy_{types}", right)
    counter.add(f"by_type_{types}", right or _right_by_type(plan, scene, required))
    if types == 1:
        counter.add("graspability_accuracy", (plan.graspable >= 0.5) == scene.graspable(required))
        if not scene.graspable(required):
            counter.add("solution_accuracy", right)


def iterative_scores(
    planner: GraspPlanner, scenes: Iterator[Scene], seed: int, size: int, settings: SceneSettings, look: Look = list
) -> dict[str, float]:
    """The scores of Algorithm 2 over scenes of `size` parts."""
    counter = ScoreCounter()
    for index, scene in enumerate(scenes):
        run = solve_iteratively(planner, scene, np.random.default_rng([seed, size, index]), settings, look)
        counter.add(f"iterative_success_{size}", run.success)
        counter.measure(f"steps_{size}", run.steps)
        counter.measure(f"needless_moves_{size}", run.needless_moves)
    return counter.scores()


def embedded(scenes: Sequence[Scene], camera: TrayCamera, network: Network) -> list[Scene]:
    """The scenes, their detections with features of rendered crops."""
    crops = camera([(scene.boxes, scene.parts) for scene in scenes])
    return [
        replace(scene, parts=with_embeddings(scene.parts, some, network))
        for scene, some in zip(scenes, crops, strict=True)
    ]


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
    planner: GraspPlanner, scene: Scene, rng: np.random.Generator, settings: SceneSettings, look: Look = list
) -> IterativeRun:
    """Algorithm 2 on one scene: a random part is required; each grasp is judged by the truth, then all is seen anew."""
    standing = list(range(len(scene.boxes)))
    required = int(rng.integers(len(standing)))
    wanted = scene.solution(required)
    moves = 0
    while True:
        boxes = scene.boxes.take(standing)
        target = _next_grasp(planner, boxes, standing.index(required), rng, settings, look)
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


def answers(planner: GraspPlanner, scene: Scene, required: Sequence[int]) -> list[GraspPlan]:
    """The answers to several questions about a scene, of one graph where the planner can."""
    if not isinstance(planner, Together):
        return [answer(planner, scene, part) for part in required]
    found: list[GraspPlan] = []
    for part in required:
        try:
            found += planner.plan_together(scene.parts, (part, *(other for other in required if other != part)))[:1]
        except ModelError:
            found.append(GraspPlan(0.0, (), True, "help"))
    return found


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
    planner: GraspPlanner, boxes: Boxes, required: int, rng: np.random.Generator, settings: SceneSettings, look: Look
) -> int | None:
    """Alg. 2 on one image: from the required part along "move b" to a part that is graspable; None asks for help."""
    (seen,) = look(
        [Scene(boxes, touching(boxes, settings.outline), observe(boxes, rng, settings.noise), settings.noise)]
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
