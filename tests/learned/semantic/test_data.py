"""Files of demonstrations: what is written is read, and every mistake is named with its file and line."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from bracket_cell.learned.semantic.graph import EMPTY, Layout
from bracket_cell.learned.semantic.records import (
    Demonstration,
    PlacementRecord,
    load_demonstrations,
    save_demonstrations,
)
from bracket_ground.errors import InputError
from bracket_lab.learned.semantic.scenarios import scenarios, states_of
from tests.learned.products import DEFAULT, HARDER
from tests.learned.semantic.demonstrated import demonstrations_of

LAYOUT = Layout.of(DEFAULT)
ORDER = ("p6", "p1", "p3")


def demonstration(**changes: Any) -> Demonstration:
    wanted = DEFAULT.goal_placements("g0")
    placements = tuple(
        PlacementRecord(part=wanted[position], position=position, time_s=float(i)) for i, position in enumerate(ORDER)
    )
    return Demonstration.model_validate({"goal": "g0", "placements": placements, "source": "by hand", **changes})


def test_what_is_written_is_read(tmp_path: Path) -> None:
    path = tmp_path / "new" / "demonstrations.jsonl"
    written = [demonstration(), demonstration(unordered_n=2), *demonstrations_of(LAYOUT, scenarios(LAYOUT, 0))]
    save_demonstrations(path, DEFAULT, written, "a test")
    assert load_demonstrations(path, DEFAULT) == written
    assert json.loads(path.read_text().splitlines()[0])["version"] == 1


def test_scenarios_survive_the_way_through_a_file(tmp_path: Path) -> None:
    whole = scenarios(LAYOUT, 3)
    path = tmp_path / "scenarios.jsonl"
    save_demonstrations(path, DEFAULT, demonstrations_of(LAYOUT, whole), "a test")
    assert states_of(LAYOUT, load_demonstrations(path, DEFAULT)).sha256 == whole.sha256


def test_a_demonstration_is_the_states_on_its_way() -> None:
    states = states_of(LAYOUT, [demonstration()])
    assert [LAYOUT.state(row).placed for row in states.seen] == [{}, {"p6": "o3"}, {"p6": "o3", "p1": "o1"}]
    assert states.following.tolist() == [5, 0, 2]
    assert states_of(LAYOUT, [demonstration(unordered_n=2)]).following.tolist() == [2]


def test_what_the_robot_placed_is_no_habit_of_a_person() -> None:
    placements = [placed.model_dump() | {"by": "robot"} for placed in demonstration().placements]
    states = states_of(LAYOUT, [demonstration(placements=placements)])
    assert states.following.tolist() == [EMPTY] * 3
    assert np.array_equal(states.seen, states_of(LAYOUT, [demonstration()]).seen)


@pytest.mark.parametrize(
    ("changes", "what"),
    [
        ({"goal": "g9"}, "no goal 'g9'; goals: g0, g1, g2"),
        ({"unordered_n": 3}, "unordered_n is 3, but there are 3 placements"),
        ({"placements": [{"part": "o1", "position": "p9"}]}, "no position 'p9'; positions: p1, p2"),
        ({"placements": [{"part": "o3", "position": "p1"}]}, "'o3' at p1, where g0 wants o1"),
        ({"placements": [{"part": "o1", "position": "p1"}] * 2}, "position p1 is filled twice"),
        ({"placements": []}, "placements: .*at least 1"),
        ({"placements": [{"part": "o1", "position": "p1", "time_s": -1}]}, r"placements\.0\.time_s: "),
        ({"colour": "red"}, "colour: Extra inputs are not permitted"),
    ],
)
def test_mistakes_are_named_with_file_and_line(changes: dict[str, Any], what: str, tmp_path: Path) -> None:
    path = tmp_path / "some.jsonl"
    save_demonstrations(path, DEFAULT, [demonstration()], "a test")
    bad = {**demonstration().model_dump(), **changes}
    path.write_text(path.read_text() + json.dumps(bad) + "\n")
    with pytest.raises(InputError, match=rf"some\.jsonl:3: {what}"):
        load_demonstrations(path, DEFAULT)


def test_all_mistakes_are_told_at_once(tmp_path: Path) -> None:
    path = tmp_path / "some.jsonl"
    save_demonstrations(path, DEFAULT, [demonstration()], "a test")
    path.write_text(path.read_text() + '{"goal": "g0"\n\n{"goal": "g0"}\n')
    with pytest.raises(InputError, match=r"(?s)jsonl:3: Invalid JSON: .*jsonl:5: placements: Field required"):
        load_demonstrations(path, DEFAULT)


def test_files_of_another_kind_or_product(tmp_path: Path) -> None:
    path = tmp_path / "some.jsonl"
    with pytest.raises(InputError, match=r"some\.jsonl: cannot be read"):
        load_demonstrations(path, DEFAULT)
    path.write_text("")
    with pytest.raises(InputError, match=r"some\.jsonl:1: no header of cell\.demonstrations version 1"):
        load_demonstrations(path, DEFAULT)
    save_demonstrations(path, DEFAULT, [], "a test")
    with pytest.raises(InputError, match="no demonstration after the header"):
        load_demonstrations(path, DEFAULT)
    with pytest.raises(InputError, match=r"some\.jsonl:1: recorded with goals .*; the product has"):
        load_demonstrations(path, HARDER)
    path.write_text(path.read_text().replace('"version":1', '"version":2'))
    with pytest.raises(InputError, match=r"some\.jsonl:1: no header .*version: Input should be 1"):
        load_demonstrations(path, DEFAULT)


def test_nothing_is_written_that_could_not_be_read(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="demonstration 1: no goal 'g9'"):
        save_demonstrations(tmp_path / "some.jsonl", DEFAULT, [demonstration(goal="g9")], "a test")
    assert not list(tmp_path.iterdir())
