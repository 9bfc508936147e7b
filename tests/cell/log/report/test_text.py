"""Lines for people say what the data says."""

from __future__ import annotations

import shutil
from pathlib import Path

import pytest

from bracket_cell.commands.main import main
from bracket_cell.log.read.reader import Log
from bracket_cell.log.replay.compare import Difference
from bracket_cell.log.report.text import change_lines, difference_lines, entry_text, note_text, short
from btxml.engine.node import StatusChange
from btxml.engine.status import Status


@pytest.mark.parametrize(
    ("topic", "fields", "words"),
    [
        ("belief", {"edge": ["o1", "p2"], "source": "robot"}, ["o1 at p2", "robot"]),
        ("belief", {"edge": [None, "p2"], "source": "seen hole"}, ["nothing at p2", "seen hole"]),
        ("belief", {"goals": {"g0": 0.987, "g1": 0.013}, "placed": {"p6": "o3"}}, ["g0 98.7%", "p6=o3"]),
        ("plan", {"guidance": {"o1": ["p1", "p2"], "o2": []}}, ["o1 to p1, p2"]),
        ("plan", {"guidance": {"o1": []}}, ["nothing remains"]),
        ("plan", {"guidance": {"o3": []}, "any_part": ["p1", "p2"]}, ["any part to p1, p2"]),
        ("plan", {"next": ["o2", "p4"]}, ["next o2 to p4"]),
        ("plan", {"required": 3, "graspable": 0.25, "solution": "move 1"}, ["part 3", "move 1", "25.0%"]),
        ("verdict", {"subject": "o1 at p2", "decision": "wait", "reason": "o1 at p2 is likely"}, ["wait: o1 at p2 is"]),
        ("verdict", {"subject": "o1 at p2", "decision": "ask", "reason": "p2 is full"}, ["ask: o1 at p2: p2 is full"]),
        ("skill", {"node": "PickPart", "status": "failure", "reason": "missed"}, ["PickPart failure: missed"]),
        ("help", {"text": "please place it"}, ["please place it"]),
        (
            "help",
            {"text": "which?", "belief": {"g0": 0.125, "g1": 0.875}, "costs": {"act_s": 37.5, "after_one_s": 4.0}},
            ["which?; g1 0.875, acting 37.5 s, after one more part 4 s"],
        ),
        ("plan", {"new": 1}, ['{"new": 1}']),
    ],
)
def test_notes_in_words(topic: str, fields: dict[str, object], words: list[str]) -> None:
    assert all(word in note_text(topic, fields) for word in words)


def test_a_difference_names_only_what_differs() -> None:
    was = {"holes": {"p1": {"part": "o1", "seen_s": 1.0}, "p2": {"part": None, "seen_s": 1.0}}, "time_s": 2.0}
    now = {"holes": {"p1": {"part": "o1", "seen_s": 1.0}, "p2": {"part": "o3", "seen_s": 1.0}}, "time_s": 2.0}
    lines = difference_lines(Difference(7, 0.28, "bench", was, now), ("a", "b"))
    assert lines == ["    tick 7 at 0.28 s: bench", "      holes.p2.part: a null, b o3"]


def test_notes_and_commands_that_differ_are_told_in_words() -> None:
    acted = [{"subject": "o1 at p2", "decision": "act", "reason": "o1 at p2 is likely"}]
    lines = difference_lines(Difference(7, 0.28, "verdict", acted, []))
    assert lines[1:] == ["      was  guard act: o1 at p2 is likely", "      now  nothing"]
    moved = {"follow": {"times_s": [0.0, 0.4, 0.8]}, "stop_arm": False, "gripper": {"opening_m": 0.04}}
    lines = difference_lines(Difference(7, 0.28, "command", None, moved))
    assert lines[2] == "      now  command arm follows a trajectory of 0.80 s, gripper to 40.0 mm"


def test_notes_that_read_alike_are_told_by_their_fields() -> None:
    one, other = ([{"required": 1, "graspable": share, "solution": "grasp"}] for share in (0.50001, 0.50002))
    [_, line] = difference_lines(Difference(7, 0.28, "plan", one, other))
    assert "graspable" in line


def test_what_a_node_went_through_in_a_tick_is_one_line() -> None:
    running, success, invalid = Status.RUNNING, Status.SUCCESS, Status.INVALID
    changes = [
        StatusChange("A::1", 1, running, success, "done"),
        StatusChange("B::2", 2, invalid, running, "goes"),
        StatusChange("A::1", 1, success, invalid, ""),
    ]
    assert list(change_lines(changes)) == [
        "A::1: RUNNING > SUCCESS > INVALID  done",
        "B::2: INVALID > RUNNING  goes",
    ]


def test_an_answer_of_a_query_is_a_line_that_people_read() -> None:
    change = {"tick": 82, "time_s": 3.28, "path": "A::1/Timeout::7", "uid": 7, "old": "RUNNING", "new": "FAILURE"}
    assert entry_text({**change, "feedback": "late"}) == "    3.28 s  A::1/Timeout::7: RUNNING > FAILURE  late"
    assert entry_text({**change, "feedback": ""}).endswith("FAILURE")
    assert entry_text({"topic": "/bench", "time_s": 1.736, "sequence": 26}) == '    1.74 s  /bench  {"sequence": 26}'
    assert len(entry_text({"topic": "/bench", "time_s": 1.0, "hand": "x" * 500}, 100)) == 112


def test_long_lists_and_numbers_are_shortened() -> None:
    assert short([0.123456789, *range(50)]) == '[0.1235, "… 49 more …", 49]'
    assert len(short("x" * 1000)) == 160


def test_commands_tell_people_what_they_ask_for(assembly_log: Log, capsys: pytest.CaptureFixture[str]) -> None:
    path = str(assembly_log.path)
    assert main(["log", "info", path]) == 0
    told = capsys.readouterr().out
    assert f"{len(assembly_log.ticks)} in " in told
    assert "/observation" in told
    assert main(["log", "ticks", path]) == 0
    told = capsys.readouterr().out
    assert "guard      " in told
    assert "shown      " in told
    assert main(["log", "query", path, "--node", "PickPart", "--status", "FAILURE"]) == 0
    assert "nothing of that" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("words", "told"),
    [
        (["--node", "Pickpart"], "--node Pickpart: no tick changes such a node"),
        (["--topic", "bensh", "--key", "held_part"], "--topic bensh: no JSON has such a topic"),
        (["--topic", "bench", "--key", "heldpart"], "--key heldpart: no JSON has such a key"),
        (["--topic", "joint_states"], "--topic joint_states: no JSON has such a topic"),
    ],
)
def test_a_question_for_what_no_log_has_is_told_as_such(
    words: list[str], told: str, assembly_log: Log, capsys: pytest.CaptureFixture[str]
) -> None:
    """A misspelt node was told like one that never failed."""
    assert main(["log", "query", str(assembly_log.path), *words]) == 0
    assert capsys.readouterr().err == f"cell: nothing of that is in the log\ncell: {told}\n"


@pytest.mark.parametrize("command", [["log", "ticks"], ["log", "query"], ["replay"]])
@pytest.mark.parametrize("span", [["--from", "nan"], ["--until", "nan"], ["--from", "9", "--until", "3"]])
def test_a_span_that_is_none_is_bad_input(
    assembly_log: Log, capsys: pytest.CaptureFixture[str], command: list[str], span: list[str]
) -> None:
    assert main([*command, str(assembly_log.path), *span]) == 2
    told = capsys.readouterr()
    assert told.out == ""
    assert ("nan is not a time" if "nan" in span else "--from is later than --until") in told.err


@pytest.mark.parametrize(
    "command",
    [
        ["report", "LOG", "-o", "LOG"],
        ["show", "LOG", "--svg", "LOG"],
        ["log", "diff", "LOG", "LOG", "--html", "LOG"],
        *(["log", "export", "LOG", "--to", kind, "-o", "LOG"] for kind in ("csv", "btlog", "video")),
    ],
)
def test_no_command_writes_over_the_log_that_it_reads(
    assembly_log: Log, tmp_path: Path, capsys: pytest.CaptureFixture[str], command: list[str]
) -> None:
    log = tmp_path / "run.mcap"
    shutil.copy(assembly_log.path, log)
    assert main([str(log) if word == "LOG" else word for word in command]) == 2
    assert f"{log}: is also the input" in capsys.readouterr().err
    assert log.read_bytes() == assembly_log.path.read_bytes()
