"""The hierarchical task network: what its methods explain, and what they do not."""

from __future__ import annotations

from bracket_cell.learned.semantic.graph import Layout
from bracket_ground.interfaces.planning import UNKNOWN_GOAL, AssemblyState
from bracket_lab.experiments.paper.htn import HtnPlanner, methods_of
from bracket_lab.learned.semantic.evaluate import Answers, success
from bracket_lab.learned.semantic.scenarios import consistent, scenarios
from tests.learned.products import DEFAULT

LAYOUT = Layout.of(DEFAULT)
WHOLE = scenarios(LAYOUT, 0)


def test_each_method_builds_its_goal_type_by_type() -> None:
    for goal, task in methods_of(DEFAULT).items():
        assert {at: part for part, at in task.primitives()} == DEFAULT.goal_placements(goal)
        assert len(task.subtasks) == len(DEFAULT.parts)


def test_it_believes_in_the_goals_that_fit_and_is_as_good_as_possible_without_noise() -> None:
    planner = HtnPlanner(DEFAULT)
    for row, fits in zip(WHOLE.seen, consistent(LAYOUT, WHOLE.seen), strict=True):
        belief = planner.plan(LAYOUT.state(row)).goal_belief
        assert [belief[goal] > 0 for goal in LAYOUT.goals] == fits.tolist()
    scores = success(Answers(planner, LAYOUT), LAYOUT, WHOLE)
    assert scores["success"] == scores["bound"]
    assert scores["consistent_success"] == 1.0


def test_one_misdetection_leaves_it_without_an_answer() -> None:
    plan = HtnPlanner(DEFAULT).plan(AssemblyState({"p1": "o3", "p2": "o3"}))  # no goal has two of it
    assert plan.goal == UNKNOWN_GOAL
    assert plan.next_part is None
    assert not plan.next_belief
