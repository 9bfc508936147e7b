"""The last words of a run are words."""

from __future__ import annotations

from typing import Any

from bracket_cell.configuration import load_configuration, load_product
from bracket_cell.viewing.run_summary import run_summary

PRODUCT = load_product(load_configuration())
SUMMARY: dict[str, Any] = {
    "finished": True, "end": "finished", "reason": "the tree succeeded", "cause": "", "condition": "",
    "observer_problems": [], "correct": True, "goal": "g1", "placements": {"p2": "o1", "p1": "o2"},
    "wrong_placements": 0, "robot_placements": 1, "human_placements": 1, "contacts": 0, "inferred_goal": "g1",
    "help_requests": 0, "ticks": 1082, "overruns": 0, "sim_time_s": 43.24, "wall_time_s": 37.1,
    "real_time_factor": 1.17, "log": "runs/a.mcap", "log_parts": 1, "log_shortfall": "", "contact_sheet": "runs/a.png",
}  # fmt: skip


def test_parts_have_their_titles_and_nothing_is_python() -> None:
    rows = run_summary(SUMMARY, PRODUCT, 25.0)
    assert rows["result"] == "finished, and the bracket is right"
    assert rows["in the bracket"] == "p1 globe valve (o2), p2 gate valve (o1)"
    assert rows["goal"] == "the person built g1; the cell inferred the same"
    assert rows["calls for help"] == "none"
    assert rows["ticks"] == "1082, none of them took longer than the 40 ms that they have"
    said = " ".join([*rows, *rows.values()])
    assert not {"None", "True", "False", "{", "_"} & {*said.split(), *said}


def test_a_shift_is_told_by_its_brackets() -> None:
    one = {
        "finished": True,
        "sim_time_s": 60.0,
        "robot_placements": 2,
        "human_placements": 4,
        "known_wrong": [],
        "correct": True,
    }
    taken = {**one, "number": 2, "finished": False, "sim_time_s": 99.0, "known_wrong": ["p2", "p6"]}
    shift = {"brackets": [{**one, "number": 1}, taken], "right": 1, "wrong": 0, "unfinished": 1, "asked": 3}
    rows = run_summary({**SUMMARY, "correct": False, **shift}, PRODUCT, 25.0)
    assert rows["result"] == "finished", "the last bracket alone says nothing of the shift"
    assert rows["brackets"] == "2 begun, 1 finished, 1 right"
    assert rows["known to be wrong"] == "bracket 2 (p2, p6)"
    assert rows["a bracket took"] == "60 s on average, 60 s at most"
    assert (rows["placed by"], rows["questions"]) == ("robot 4, person 8", "3")
    assert "in the bracket" not in rows


def test_a_run_that_failed_says_why() -> None:
    failed = {"finished": False, "end": "failed", "reason": "the tree failed", "cause": "FindPart: no o9 in the tray"}
    rows = run_summary({**SUMMARY, **failed, "injected": "arm_nan came at 3.00 s"}, PRODUCT, 25.0)
    assert rows["result"] == "failed: the tree failed"
    assert rows["fault"] == "arm_nan came at 3.00 s"
    assert rows["why"] == "FindPart: no o9 in the tray"


def test_of_a_job_that_builds_no_goal_nothing_is_said_of_the_bracket() -> None:
    rows = run_summary({**SUMMARY, "correct": None, "wrong_placements": None, "inferred_goal": None}, PRODUCT, 25.0)
    assert rows["result"] == "finished"
    assert "goal" not in rows
    assert "wrong placements" not in rows
    assert rows["in the bracket"] == "p1 globe valve (o2), p2 gate valve (o1)"


def test_a_tree_that_is_no_assembly_says_nothing_of_one() -> None:
    rows = run_summary({key: value for key, value in SUMMARY.items() if key != "placements"}, PRODUCT, 25.0)
    assert rows["result"] == "finished"
    assert "goal" not in rows
