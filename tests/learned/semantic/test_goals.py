"""The open list of goals: its prior, its file, its commands, and what planners make of it."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from bracket_cell.commands.main import main
from bracket_cell.learned.semantic.goals import FinishedGoal, OpenGoals
from bracket_cell.learned.semantic.model import BayesPlanner, FactoredPlanner
from bracket_cell.learned.semantic.settings import NewGoals
from bracket_ground.errors import InputError
from bracket_ground.interfaces.planning import UNKNOWN_GOAL, AssemblyState
from bracket_lab.learned.semantic.paper_planner import load_semantic_planner
from tests.learned.products import DEFAULT

NEW = ("o3", "o2", "o1", "o2", "o1", "o1")
OTHER = ("o2", "o3", "o2", "o1", "o1", "o1")


def listed(goal: str) -> tuple[str, ...]:
    """The part types of a listed goal, in the order of the holes."""
    return tuple(DEFAULT.goal_placements(goal).values())


def seen(parts: tuple[str, ...], times: int) -> OpenGoals:
    goals = OpenGoals.of(DEFAULT)
    for _ in range(times):
        goals = goals.with_bracket(parts)
    return goals


def test_before_anything_was_finished_the_listed_goals_are_alike_and_none_has_its_own_probability() -> None:
    prior = OpenGoals.of(DEFAULT, NewGoals(none_probability=0.05)).prior()
    assert np.allclose(prior, [0.95 / 3] * 3 + [0.05])


def test_what_was_finished_is_expected_more_and_new_goals_raise_the_expectation_of_further_ones() -> None:
    none = [goals.prior()[-1] for goals in (seen(NEW, 0), seen(NEW, 1), seen(NEW, 1).with_bracket(OTHER))]
    assert none[0] < none[1] < none[2]
    assert seen(NEW, 3).prior()[3] > seen(NEW, 1).prior()[3]
    assert seen(listed("g1"), 5).prior()[1] > 1 / 3
    assert seen(listed("g1"), 50).prior()[-1] < none[0]
    for goals in (seen(NEW, 2), seen(listed("g0"), 7)):
        assert np.isclose(goals.prior().sum(), 1.0)


def test_a_learned_goal_is_one_of_the_products_goals() -> None:
    goals = seen(NEW, 2)
    assert goals.product.goals == {**DEFAULT.goals, "new1": NEW}
    assert goals.with_bracket(OTHER).product.goals["new2"] == OTHER
    with pytest.raises(InputError, match=r"needs .* but the quantities are"):
        goals.with_bracket(("o1",) * 6)


def test_the_file_can_be_read_edited_and_written(tmp_path: Path) -> None:
    path = tmp_path / "new" / "goals.yaml"
    assert OpenGoals.load(path, DEFAULT) == OpenGoals.of(DEFAULT)
    seen(NEW, 2).save(path)
    assert "  new1:" in path.read_text()
    path.write_text(path.read_text().replace("new1", "spare bracket").replace("finished: 2", "finished: 9"))
    assert OpenGoals.load(path, DEFAULT).learned == {"spare bracket": FinishedGoal(parts=NEW, finished=9)}


@pytest.mark.parametrize(
    ("before", "after", "what"),
    [
        ("valve bracket", "gearbox", "goals of 'gearbox'"),
        ("o3, o2", "o3, o9", "unknown part types"),
        ("o3, o2", "o3, o3", "but the quantities are"),
        ("finished: 2", "finished: -2", "goals.yaml:"),
        ("new1", "g0", "goal g0 is o1 o1 o1 o2 o2 o3 in the product file"),
    ],
)
def test_mistakes_in_the_file_are_named(before: str, after: str, what: str, tmp_path: Path) -> None:
    path = tmp_path / "goals.yaml"
    seen(NEW, 2).save(path)
    assert before in path.read_text()
    path.write_text(path.read_text().replace(before, after))
    with pytest.raises(InputError, match=what):
        OpenGoals.load(path, DEFAULT)


@pytest.mark.parametrize("kind", ["factored", "bayes"])
def test_a_goal_that_was_seen_twice_is_believed_in(kind: str) -> None:
    weights = Path("learned/weights/semantic_factored.onnx")
    state = AssemblyState(dict(list(zip(DEFAULT.positions, NEW, strict=True))[:3]))
    before, after = (load_semantic_planner(kind, weights, DEFAULT, goals).plan(state) for goals in (None, seen(NEW, 2)))
    assert before.goal == UNKNOWN_GOAL
    assert after.goal == "new1"
    assert after.goal_belief["new1"] > 0.9
    assert after.next_belief["o2", "p4"] > 0.9
    assert np.isclose(sum(after.goal_belief.values()), 1.0)


def test_the_open_list_of_the_network_is_that_of_exact_inference() -> None:
    """Shipped weights were trained on people without habits, so both see learned goals alike."""
    goals = seen(NEW, 2).with_bracket(listed("g1"))
    weights = Path("learned/weights/semantic_factored.onnx")
    planners = [load_semantic_planner(kind, weights, DEFAULT, goals) for kind in ("factored", "bayes")]
    for count in range(1, 6):
        state = AssemblyState(dict(list(zip(DEFAULT.positions, NEW, strict=True))[:count]))
        one, other = (planner.plan(state).goal_belief for planner in planners)
        assert one.keys() == other.keys()
        assert all(abs(one[name] - other[name]) < 0.1 for name in one)


@pytest.mark.parametrize("kind", ["factored", "bayes"])
def test_what_the_person_said_counts(kind: str) -> None:
    planner = load_semantic_planner(kind, Path("learned/weights/semantic_factored.onnx"), DEFAULT)
    assert isinstance(planner, FactoredPlanner | BayesPlanner)
    placed = {"p1": "o1"}
    told = planner.plan(AssemblyState(placed, "g2"))
    assert told.goal_belief["g2"] == 1.0
    assert all(DEFAULT.goal_placements("g2")[place] == part for part, place in told.next_belief)
    unknown = planner.plan(AssemblyState(placed, UNKNOWN_GOAL))
    assert unknown.goal == UNKNOWN_GOAL
    assert max(unknown.next_belief.values()) < 0.9
    assert AssemblyState(placed, "g2").with_placement("o2", "p2").told_goal == "g2"


@pytest.mark.parametrize("kind", ["factored", "bayes"])
def test_of_a_goal_that_nobody_knows_only_what_must_come_last_is_planned(kind: str) -> None:
    planner = load_semantic_planner(kind, Path("learned/weights/semantic_factored.onnx"), DEFAULT)
    assert isinstance(planner, FactoredPlanner | BayesPlanner)
    placed = {"p2": "o1", "p5": "o1", "p1": "o2", "p4": "o1"}
    nobody_knows = planner.plan(AssemblyState(placed, UNKNOWN_GOAL))
    assert not any(nobody_knows.guidance.values())
    last = planner.plan(AssemblyState({**placed, "p3": "o3"}, UNKNOWN_GOAL))
    assert last.guidance == {"o1": (), "o2": ("p6",), "o3": ()}
    assert last.next_part == "o2"
    assert last.next_belief["o2", "p6"] == pytest.approx(1.0)


def test_the_command_shows_adds_and_forgets(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    file = ["--file", str(tmp_path / "goals.yaml")]
    assert main(["goals", "add", "odd", *NEW, *file]) == 0
    assert main(["goals", *file, "--json"]) == 0
    assert '"goal": "odd"' in capsys.readouterr().out
    assert main(["goals", "--json", *file, "add", "odd", *NEW]) == 0
    assert json.loads(capsys.readouterr().out)["finished"] == 3
    assert main(["goals", "add", "wrong", *["o1"] * 6, *file]) == 2
    assert main(["goals", "add", "odd", "--finished", "0", *file]) == 0
    assert "finished 0" in capsys.readouterr().err
    assert main(["goals", "add", "odd", "--finished", "0", *file]) == 2
    assert OpenGoals.load(tmp_path / "goals.yaml", DEFAULT).finished == {}


def test_a_configuration_without_a_file_of_goals_says_so(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["goals", "add", "odd", *NEW]) == 2
    assert "planners.semantic.goals" in capsys.readouterr().err
