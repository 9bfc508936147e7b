"""Brackets are counted from what the nodes note; a part of the log begins with each."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from bracket_cell.configuration import for_shift, load_configuration
from bracket_cell.production.book import Book, RunRow
from bracket_cell.production.bookkeeper import Bookkeeper
from bracket_cell.recording.recorder import Heading, McapRecorder
from bracket_cell.settings import LogSettings
from bracket_cell.watching.observer import Outcome, SentCommand, TickRecord
from bracket_ground.interfaces.command import Command, Display
from bracket_ground.interfaces.notes import Topic
from bracket_ground.interfaces.observation import Observation
from tests.trees.nodes.rig import EMPTY_GRIPPER, STANDING

Note = tuple[Topic, dict[str, object]]
BEGIN: tuple[Note, ...] = (("bracket", {"number": 1, "edge": "begin"}),)
NEXT: tuple[Note, ...] = (("bracket", {"number": 2, "edge": "begin"}),)
END: tuple[Note, ...] = (("bracket", {"number": 1, "edge": "end", "finished": True}),)


def record(tick: int, notes: tuple[Note, ...] = (), belief: dict[str, float] | None = None) -> TickRecord:
    seen = Observation(tick, float(tick), STANDING, EMPTY_GRIPPER)
    command = Command(display=Display(goal_belief=belief)) if belief else Command()
    return TickRecord(seen, "RUNNING", (), notes, command, SentCommand(), 0.0, False)


def test_times_goals_and_questions_belong_to_their_bracket() -> None:
    tally = Bookkeeper(Book(), RunRow(""))
    for tick_record in (
        record(0),
        record(1, BEGIN),
        record(5, (("help", {"text": "o3"}),), {"g0": 0.2, "g1": 0.8}),
        record(9, END),
        record(12, NEXT, {"g2": 1.0}),
        record(15),
    ):
        tally.tick(tick_record)
    told: Any = tally.report([{"goal": "g1", "correct": True, "robot_placements": 2, "human_placements": 4}])
    first, second = told["brackets"]
    assert (first["goal"], first["inferred_goal"], first["correct"], first["sim_time_s"]) == ("g1", "g1", True, 8.0)
    assert (first["robot_placements"], first["help_requests"], second["help_requests"]) == (0, 1, 0)
    assert (second["correct"], second["finished"], second["sim_time_s"]) == (None, None, 3.0)
    assert (told["right"], told["wrong"], told["unfinished"], told["asked"]) == (1, 0, 1, 1)


def test_a_tree_without_brackets_tells_of_none() -> None:
    tally = Bookkeeper(Book(), RunRow(""))
    tally.tick(record(0))
    assert tally.report([{"correct": True}]) == {}


def test_a_part_of_the_log_begins_with_every_bracket_but_the_first(tmp_path: Path) -> None:
    settings = for_shift(load_configuration(), 2).log
    assert settings.rotate_brackets
    recorder = McapRecorder(tmp_path / "shift.mcap", settings, Heading({}, {}))
    for tick_record in (record(0), record(1, BEGIN), record(2, END), record(3, NEXT), record(4)):
        recorder.tick(tick_record)
    recorder.close(Outcome("finished", "", 5, 0, 5.0, 0.1))
    assert sorted(path.name for path in tmp_path.glob("*.mcap")) == ["shift.0001.mcap", "shift.0002.mcap"]


def test_a_log_that_rotates_otherwise_keeps_its_way() -> None:
    configuration = load_configuration()
    own = configuration.model_copy(update={"log": LogSettings(rotate_s=60, keep_parts=5)})
    assert for_shift(own, 3).log == own.log
