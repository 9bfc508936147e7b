"""Finished brackets are noted in the file of goals; what was not finished, or misread, is not."""

from __future__ import annotations

from pathlib import Path

import pytest

from bracket_cell.learned.semantic.goals import OpenGoals
from bracket_cell.watching.observer import End, Outcome, SentCommand, TickRecord
from bracket_cell.watching.statistics import FinishedBrackets
from bracket_ground.interfaces.command import Command
from bracket_ground.interfaces.observation import ArmState, GripperState, ObjectStatus, Observation
from bracket_ground.interfaces.perception import Action, BenchView, HoleView
from tests.learned.products import DEFAULT

NEW = ("o3", "o2", "o1", "o2", "o1", "o1")
ARM = ArmState(1.0, (0.0,) * 6, (0.0,) * 6, False)
GRIPPER = GripperState(1.0, True, ObjectStatus.AT_POSITION, 0.08, 0.0, 0)


def listed(goal: str) -> tuple[str, ...]:
    """The part types of a listed goal, in the order of the holes."""
    return tuple(DEFAULT.goal_placements(goal).values())


def finish(path: Path, parts: tuple[str | None, ...], end: End = "finished") -> FinishedBrackets:
    holes = {position: HoleView(part, 1.0, 1.0) for position, part in zip(DEFAULT.positions, parts, strict=True)}
    view = BenchView(1, 1.0, None, holes, Action("idle", 1.0))
    observer = FinishedBrackets(path, DEFAULT)
    observer.tick(
        TickRecord(Observation(1, 1.0, ARM, GRIPPER, view), "RUNNING", (), (), Command(), SentCommand(), 0.0, False)
    )
    observer.close(Outcome(end, "", 1, 0, 1.0, 1.0))
    return observer


def test_brackets_of_known_and_of_new_goals_are_noted(tmp_path: Path) -> None:
    path = tmp_path / "goals.yaml"
    assert finish(path, listed("g1")).learned == "g1"
    assert finish(path, NEW).learned == "new1"
    assert finish(path, NEW).learned == "new1"
    finished = OpenGoals.load(path, DEFAULT).finished
    assert {name: goal.finished for name, goal in finished.items()} == {"g1": 1, "new1": 2}


@pytest.mark.parametrize(
    ("parts", "end"),
    [(NEW, "failed"), ((None, *NEW[1:]), "finished"), (("o1",) * 6, "finished")],
)
def test_what_was_not_finished_or_was_misread_is_not_noted(
    parts: tuple[str | None, ...], end: End, tmp_path: Path
) -> None:
    path = tmp_path / "goals.yaml"
    assert finish(path, parts, end).learned is None
    assert not path.exists()
