"""Laws that every grasp planner keeps, and the scores of the shipped weights."""

from __future__ import annotations

import math
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from bracket_cell.learned.grasp.settings import SceneSettings
from bracket_cell.learned.grasp.solution import Solution
from bracket_cell.learned.inference.onnx_model import OnnxModel
from bracket_ground.errors import ModelError
from bracket_ground.interfaces.perception import PartDetection
from bracket_ground.interfaces.planning import GraspPlan, GraspPlanner
from bracket_ground.interfaces.pose import Pose
from bracket_ground.interfaces.product import Product
from bracket_lab.learned.grasp.evaluate import evaluate_grasp, evaluate_scenes
from bracket_lab.learned.grasp.language import END, MAX_WORDS, MOVE
from bracket_lab.learned.grasp.paper_planner import KINDS, PaperPlanner, load_grasp_planner
from bracket_lab.learned.grasp.scenes import draw_scenes
from tests.learned.grasp.layouts import PRODUCT, ROOT, WEIGHTS, chain, enclosed, moved, standing, walled
from tests.learned.grasp.rendered import Seeing, look

# Object accuracy for one required type and success of iterative solving with 3 parts, on fresh scenes: below the
# README's by the sampling error of 200 scenes.
SCORES = {"pairwise": (0.93, 0.95), "rule": (0.60, 0.80), "paper": (0.80, 0.85)}


@pytest.fixture(params=KINDS)
def kind(request: pytest.FixtureRequest) -> str:
    return str(request.param)


@pytest.fixture
def planner(kind: str) -> GraspPlanner:
    found = load_grasp_planner(kind, WEIGHTS / f"grasp_{kind}.onnx", PRODUCT)
    return Seeing(found) if kind == "paper" else found


class Constant:
    def __init__(self, plan: GraspPlan) -> None:
        self._plan = plan

    def plan(self, parts: tuple[PartDetection, ...], required: int) -> GraspPlan:  # noqa: ARG002
        return self._plan


def plans(planner: GraspPlanner, parts: tuple[PartDetection, ...]) -> list[GraspPlan]:
    return [planner.plan(parts, required) for required in range(len(parts))]


def test_permuting_detections_permutes_the_answer(planner: GraspPlanner) -> None:
    rng = np.random.default_rng(0)
    for scene in draw_scenes(PRODUCT, 21, 20, "test"):
        order = [int(i) for i in rng.permutation(len(scene.parts))]
        before = plans(planner, scene.parts)
        after = plans(planner, tuple(scene.parts[i] for i in order))
        for place, index in enumerate(order):
            assert after[place].graspable == pytest.approx(before[index].graspable, abs=1e-5)
            assert after[place].needs_help == before[index].needs_help
            assert tuple(order[i] for i in after[place].blockers) == before[index].blockers


@pytest.mark.parametrize("kind", ["pairwise", "rule"])
def test_turning_and_shifting_the_scene_changes_nothing(planner: GraspPlanner) -> None:
    for scene in draw_scenes(PRODUCT, 22, 20, "test"):
        turned = tuple(moved(part, 0.56, -0.38, 1.2) for part in scene.parts)
        for before, after in zip(plans(planner, scene.parts), plans(planner, turned), strict=True):
            assert after.graspable == pytest.approx(before.graspable, abs=1e-4)
            assert after.text == before.text


def test_a_lone_part_is_graspable(planner: GraspPlanner) -> None:
    for name in PRODUCT.parts:
        plan = planner.plan((standing(name, 0.05, -0.03, 1.0),), 0)
        assert plan.graspable >= 0.5
        assert plan.text == "grasp"


@pytest.mark.parametrize("kind", ["pairwise", "rule"])
def test_a_wall_of_tall_parts_blocks(planner: GraspPlanner) -> None:
    plan = planner.plan(enclosed(), 0)
    assert plan.graspable < 0.5
    assert plan.blockers == (1, 2) or plan.blockers == (2, 1)


def test_a_tall_wall_is_not_graspable(planner: GraspPlanner) -> None:
    assert planner.plan(walled("o3", "o3"), 0).graspable < 0.5


@pytest.mark.parametrize("kind", ["pairwise", "rule"])
def test_a_walled_part_is_grasped_by_its_ends(planner: GraspPlanner) -> None:
    assert planner.plan(walled("o1", "o3"), 0).text == "grasp"


@pytest.mark.parametrize("kind", ["pairwise", "rule"])
def test_what_blocks_the_blocker_moves_first(planner: GraspPlanner) -> None:
    plan = planner.plan(chain(), 0)
    assert plan.text == "move c and b"
    assert plan.blockers == (2, 1)


@pytest.mark.parametrize("kind", ["pairwise", "rule"])
def test_parts_that_block_each_other_need_help(planner: GraspPlanner) -> None:
    plan = planner.plan((standing("o3", 0.0, 0.0), standing("o3", 0.0, 0.048)), 0)
    assert plan.needs_help
    assert plan.text == "help"
    assert plan.blockers == ()


@pytest.mark.parametrize("kind", ["pairwise", "rule"])
def test_far_parts_change_nothing(planner: GraspPlanner) -> None:
    for scene in draw_scenes(PRODUCT, 23, 20, "test"):
        far = (*scene.parts, standing("o3", 2.0, 0.0), standing("o1", 0.0, -1.5, 0.4))
        assert plans(planner, far)[: len(scene.parts)] == plans(planner, scene.parts)


def test_answers_hang_together(planner: GraspPlanner) -> None:
    for scene in draw_scenes(PRODUCT, 24, 30, "test"):
        for required, plan in enumerate(plans(planner, scene.parts)):
            assert 0.0 <= plan.graspable <= 1.0
            assert (plan.graspable >= 0.5) == (plan.text == "grasp")
            assert required not in plan.blockers
            assert bool(plan.blockers) == plan.text.startswith("move ")


FEW_AND_MANY = [60, pytest.param(200, marks=pytest.mark.slow)]


@pytest.mark.parametrize("scenes", FEW_AND_MANY)
def test_weights_reach_their_score_on_fresh_scenes(kind: str, scenes: int) -> None:
    planner = load_grasp_planner(kind, WEIGHTS / f"grasp_{kind}.onnx", PRODUCT)
    scores = evaluate_grasp(planner, PRODUCT, seed=99, scenes=scenes, look=look if kind == "paper" else list)
    objects, solved = SCORES[kind]
    assert scores["object_accuracy_1"] >= objects
    assert scores["iterative_success_3"] >= solved


@pytest.mark.long
@pytest.mark.parametrize("count", FEW_AND_MANY)
@pytest.mark.parametrize(
    "clutter",
    [
        SceneSettings(farthest_gap_m=0.015, by_quantity=True),
        SceneSettings(neighbour_share=0.8, nearest_gap_m=0.004, farthest_gap_m=0.016, crowding=8),
        SceneSettings(tray_m=(0.20, 0.24), crowding=1, farthest_gap_m=0.02),
    ],
)
def test_the_papers_weights_beat_always_grasping_where_they_were_not_trained(
    clutter: SceneSettings, count: int
) -> None:
    planner = load_grasp_planner("paper", WEIGHTS / "grasp_paper.onnx", PRODUCT)
    scenes = look(list(draw_scenes(PRODUCT, 41, count, "validation", clutter)))
    right, always = (
        evaluate_scenes(grasp_planner, scenes, 41)["object_accuracy_2"]
        for grasp_planner in (planner, Constant(Solution().plan(1.0)))
    )
    assert right > always


def test_the_papers_planner_answers_about_one_graph_with_several_flags() -> None:
    planner = load_grasp_planner("paper", WEIGHTS / "grasp_paper.onnx", PRODUCT)
    assert isinstance(planner, PaperPlanner)
    for scene in look(list(draw_scenes(PRODUCT, 42, 10, "test"))):
        alone = [planner.plan(scene.parts, part) for part in (0, 1)]
        together = planner.plan_together(scene.parts, (0, 1))
        assert len(together) == 2
        assert [plan.graspable for plan in together] != [plan.graspable for plan in alone]  # flags are features


def test_the_papers_planner_needs_the_crops() -> None:
    planner = load_grasp_planner("paper", WEIGHTS / "grasp_paper.onnx", PRODUCT)
    with pytest.raises(ModelError, match="no embeddings"):
        planner.plan(walled("o1", "o3"), 0)


def test_a_planner_that_always_asks_for_help_scores_low() -> None:
    scores = evaluate_grasp(Constant(Solution(needs_help=True).plan(0.0)), PRODUCT, seed=1, scenes=40)
    assert scores["object_accuracy_1"] < 0.4
    assert scores["iterative_success_6"] < 0.6


@pytest.mark.parametrize("kind", ["pairwise", "rule"])
def test_scores_carry_confidence_intervals(planner: GraspPlanner) -> None:
    scores = evaluate_grasp(planner, PRODUCT, seed=1, scenes=20)
    for name in ("object_accuracy_1", "object_accuracy_2", "object_accuracy_3", "iterative_success_6"):
        assert scores[f"{name}_low"] <= scores[name] <= scores[f"{name}_high"]
        assert 0.0 < scores[f"{name}_high"] - scores[f"{name}_low"] < 1.0


@pytest.mark.parametrize("scale", [0.7, 0.85, 1.05])
def test_pairwise_knows_sizes_and_not_names(scale: float) -> None:
    parts = {
        f"x{name}": part.model_copy(update={"size_m": tuple(scale * length for length in part.size_m), "shape": ()})
        for name, part in PRODUCT.parts.items()
    }
    goals = {name: tuple(f"x{part}" for part in goal) for name, goal in PRODUCT.goals.items()}
    other = PRODUCT.model_copy(update={"parts": parts, "goals": goals})
    planner = load_grasp_planner("pairwise", WEIGHTS / "grasp_pairwise.onnx", other)
    assert evaluate_scenes(planner, list(draw_scenes(other, 7, 60, "test")), 7)["object_accuracy_1"] > 0.9


def test_another_product_needs_other_weights() -> None:
    parts = {f"x{name}": part for name, part in PRODUCT.parts.items()}
    goals: dict[str, tuple[str | tuple[str, ...], ...]] = {
        name: tuple(f"x{part}" for part in goal) for name, goal in PRODUCT.goals.items()
    }
    other = Product(name="other", parts=parts, bracket=PRODUCT.bracket, goals=goals)
    with pytest.raises(ModelError, match="train again"):
        load_grasp_planner("paper", WEIGHTS / "grasp_paper.onnx", other)


def test_missing_weights_are_refused() -> None:
    with pytest.raises(ModelError, match="cannot read"):
        load_grasp_planner("paper", Path("nowhere"), PRODUCT)


def test_not_a_number_in_a_detection_is_refused() -> None:
    planner = load_grasp_planner("pairwise", WEIGHTS / "grasp_pairwise.onnx", PRODUCT)
    parts = (standing("o1", 0.0, 0.0), standing("o1", 0.0, 0.05))
    broken = PartDetection("o1", 0.9, parts[1].world_from_part, (math.nan, 0.028, 0.02), (0, 0, 1, 1))
    with pytest.raises(ModelError, match="not finite"):
        planner.plan((parts[0], broken), 0)


def test_words_that_are_no_sentence_are_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    model = OnnxModel.load(WEIGHTS / "grasp_paper.onnx", "grasp.paper")
    planner = Seeing(PaperPlanner(model, PRODUCT))
    babble = {"verdict": np.array([-5.0]), "words": np.array([[MOVE, MOVE] + [END] * (MAX_WORDS - 2)])}
    monkeypatch.setattr(model, "run", lambda _: babble)
    with pytest.raises(ModelError, match="move move"):
        planner.plan(walled("o3", "o3"), 0)


def test_planning_never_imports_torch() -> None:
    code = (
        "import sys, bracket_cell.learned.grasp.model, bracket_lab.learned.grasp.evaluate;"
        "assert 'torch' not in sys.modules"
    )
    subprocess.run([sys.executable, "-c", code], check=True, cwd=ROOT)


def lying(name: str, x_m: float, y_m: float) -> PartDetection:
    """Something on the floor, 5 cm high, that does not stand."""
    return PartDetection(name, 0.9, Pose((x_m, y_m, 0.0)), (0.09, 0.05, 0.05), (0, 0, 10, 10), upright=False)


@pytest.mark.parametrize("kind", ["pairwise", "rule"])
@pytest.mark.parametrize("name", ["o3", "unknown"])
def test_what_lies_is_in_the_way_and_is_never_moved(planner: GraspPlanner, name: str) -> None:
    part = standing("o2", 0.0, 0.0)
    ends = 0.5 * (PRODUCT.parts["o2"].size_m[0] + 0.05) + 0.006
    for far, needs_help in ((0.2, False), (0.0, True)):
        walls = (lying(name, 0.0, 0.052 + far), lying(name, 0.0, -0.052 - far))
        ended = (replace(walls[0], world_from_part=Pose.from_yaw((ends + far, 0.0, 0.0), math.pi / 2)),)
        plan = planner.plan((part, *walls, *ended), 0)
        assert (plan.needs_help, plan.blockers) == (needs_help, ())
        assert (plan.graspable >= 0.5) is not needs_help


@pytest.mark.parametrize("kind", ["pairwise", "rule"])
def test_of_two_ways_the_one_that_nothing_lying_bars_is_freed(planner: GraspPlanner) -> None:
    before = walled("o1", "o3")
    assert planner.plan(before, 0).graspable >= 0.5, "by its ends"
    end = 0.5 * (PRODUCT.parts["o1"].size_m[0] + 0.09) + 0.004
    plan = planner.plan((*before, lying("o2", end, 0.0)), 0)
    assert plan.graspable < 0.5
    assert not plan.needs_help
    assert set(plan.blockers) <= {1, 2}
