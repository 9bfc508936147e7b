"""The tree of a shift with leaves that answer as told: brackets follow one another, and trouble is asked about."""

from __future__ import annotations

from collections.abc import Mapping

from bracket_cell.trees.bench import TreeBench
from tests import ROOT

BEGUN = {
    "WaitForAction": "R",
    "BracketTaken": "F",
    "AssemblyFinished": "FS",
    "AwaitMistake": "R",
    "AwaitMisfit": "R",
}


def bench(answers: Mapping[str, str]) -> TreeBench:
    return TreeBench(ROOT / "trees" / "shift.xml", {**BEGUN, **answers})


def run(made: TreeBench, ticks: int) -> str:
    """Statuses up to the end of the tree."""
    told = ""
    while len(told) < ticks and told[-1:] not in ("S", "F"):
        told += made.tick(0.04)
    return told


def test_brackets_follow_one_another_until_enough_are_done() -> None:
    made = bench({"ShiftIsOver": "FFS"})
    assert run(made, 40).endswith("S")
    assert (made.started("BeginBracket"), made.started("EndBracket")) == (3, 3)
    assert made.started("ActivateGripper") == 1


def test_a_bracket_that_is_taken_away_ends_and_the_next_one_begins() -> None:
    made = bench({"ShiftIsOver": "FS", "AssemblyFinished": "F", "BracketTaken": "FS"})
    assert run(made, 40).endswith("S")
    assert made.started("EndBracket") == 2


def test_a_part_that_cannot_be_put_back_is_asked_about_before_the_shift_goes_on() -> None:
    made = bench({"ShiftIsOver": "S", "GripperIsEmpty": "SFS", "ReturnToTray": "FS"})
    assert run(made, 40).endswith("S")
    made = bench({"ShiftIsOver": "S", "ReturnToTray": "F", "GripperIsEmpty": "F", "IdentifyHeldPart": "S"})
    assert run(made, 40).endswith("F")
    assert made.started("AskForHelp") >= 1


def test_a_run_that_begins_with_a_part_in_the_gripper_puts_it_back_before_anything_else() -> None:
    made = bench({"ShiftIsOver": "S", "GripperIsEmpty": "FS"})
    assert run(made, 40).endswith("S")
    order = [event.removeprefix("start ") for event in made.events if event.startswith("start ")]
    assert order.index("ReturnToTray") < order.index("WaitForEmptyBracket")
    assert order.index("IdentifyHeldPart") < order.index("LookAtTray") < order.index("ReturnToTray")


def test_a_wrong_part_is_told_beside_the_work_and_asked_again_before_it_is_left() -> None:
    answers = {"ShiftIsOver": "S", "AssemblyFinished": "FFFFFFFS", "AwaitMistake": "RSR"}
    made = bench({**answers, "AskToMend": "RFRS"})
    assert run(made, 40).endswith("S")
    assert (made.started("AskToMend"), made.started("LeaveMistake")) == (2, 0)
    made = bench({**answers, "AskToMend": "RFRF"})
    assert run(made, 40).endswith("S")
    assert (made.started("AskToMend"), made.started("LeaveMistake")) == (2, 1)


def test_a_bracket_with_something_wrong_in_it_does_not_end() -> None:
    made = bench({"ShiftIsOver": "S", "AssemblyFinished": "S", "BracketIsRight": "FFFFS", "AwaitMistake": "R"})
    told = run(made, 40)
    assert told.endswith("S")
    assert made.started("EndBracket") == 1
    assert told.index("S") >= 4


def test_ahead_of_the_person_a_shift_goes_the_same_way_and_asks_beside_the_work() -> None:
    answers = {**BEGUN, "ShiftIsOver": "FS", "AssemblyFinished": "FFS", "AskWhichGoal": "RRS", "HoldsNeededPart": "F"}
    made = TreeBench(ROOT / "trees" / "shift_ahead.xml", answers)
    assert run(made, 60).endswith("S")
    assert (made.started("BeginBracket"), made.started("EndBracket")) == (2, 2)
    order = [event.removeprefix("start ") for event in made.events if event.startswith("start ")]
    assert order.index("AskWhichGoal") < order.index("EndBracket")
    assert order.index("ChooseSparePart") < order.index("EndBracket"), "the robot fetches while the question stands"
