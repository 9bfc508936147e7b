"""Two trees compared by rows of runs: what is found, what is not proved, what a bound refuses."""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from bracket_cell.commands.main import main
from bracket_cell.fleet.compare import Limit, differing, findings, overall, pair
from bracket_cell.fleet.compare_text import as_json, by_person, lines, page, persons_as_json
from bracket_cell.fleet.table import read_table, write_table
from bracket_ground.errors import InputError

Rows = list[dict[str, Any]]


def rows(rng: np.random.Generator, count: int, more_s: float = 0.0, right: float = 1.0) -> Rows:
    """Runs of seeds in a row; what a seed brings is the same in every call."""
    common = np.random.default_rng(1).normal(50, 8, count)
    same = {"goal_asked": "random", "person": "careful", "look": "nominal", "fault": "", "goal": "g1"}
    zero = dict.fromkeys(("wrong_placements", "help_requests", "contacts"), 0)
    return [
        {
            **same,
            **zero,
            "seed": seed,
            "end": "finished",
            "correct": bool(rng.random() < right),
            "sim_time_s": float(common[seed] + more_s + rng.normal(0, 3)),
            "robot_placements": 2,
        }
        for seed in range(count)
    ]


def compared(more_s: float, right: float, seed: int, count: int = 40) -> str:
    rng = np.random.default_rng(seed)
    return overall(findings(pair(rows(rng, count), rows(rng, count, more_s, right))))


def test_a_known_improvement_is_found() -> None:
    assert [compared(-8.0, 1.0, seed) for seed in range(20)] == ["better"] * 20


def test_two_equal_trees_are_called_equal_in_19_of_20_repetitions() -> None:
    equal = sum(compared(0.0, 1.0, seed) == "no difference proved" for seed in range(200))
    assert equal >= 190


def test_faster_and_wrong_is_mixed() -> None:
    assert compared(-8.0, 0.6, 3) == "mixed"


def test_the_same_runs_do_not_differ() -> None:
    same = rows(np.random.default_rng(0), 10)
    found = findings(pair(same, same))
    assert overall(found) == "no difference proved"
    assert differing(pair(same, same)) == []


def test_a_few_pairs_that_all_say_the_same_prove_nothing() -> None:
    rng = np.random.default_rng(0)
    for count in (2, 5, 6):
        ones, others = rows(rng, count), [{**row, "help_requests": 1} for row in rows(rng, count)]
        (asked,) = (found for found in findings(pair(ones, others)) if found.measure.name == "questions")
        assert asked.verdict == ("worse" if count == 6 else "too few pairs")


def test_only_runs_of_the_same_seed_and_person_are_pairs() -> None:
    rng = np.random.default_rng(0)
    ones, others = rows(rng, 10), rows(rng, 20)
    others[3]["person"] = "careless"
    assert [a["seed"] for a, _ in pair(ones, others)] == [0, 1, 2, 4, 5, 6, 7, 8, 9]


@pytest.mark.parametrize(
    ("text", "broken"), [("right < -2%", True), ("right < -50%", False), ("time_s > 5%", False), ("time_s < -5", True)]
)
def test_bounds(text: str, broken: bool) -> None:
    rng = np.random.default_rng(5)
    found = findings(pair(rows(rng, 60), rows(rng, 60, -8.0, 0.9)))
    assert Limit.parse(text).broken(found) is broken


def test_what_was_not_measured_keeps_no_bound() -> None:
    assert Limit.parse("least_distance_m < -1").broken(findings(pair(rows(np.random.default_rng(0), 3), [])))


@pytest.mark.parametrize("text", ["right", "speed < 3", "right <= -2%", "right < x"])
def test_a_bound_that_is_none_is_refused(text: str) -> None:
    with pytest.raises(InputError, match="is not a bound like"):
        Limit.parse(text)


def test_the_comparison_can_be_read() -> None:
    rng = np.random.default_rng(0)
    pairs = pair(rows(rng, 40), rows(rng, 40, -8.0, 0.8))
    found = findings(pairs)
    assert any("time_s" in line and "better" in line for line in lines(found, ("a.xml", "b.xml"), 40))
    json.dumps(as_json(found, ("a.xml", "b.xml"), 40), allow_nan=False)
    html = page(found, ("<a>.xml", "b.xml"), pairs)
    assert "&lt;a&gt;.xml" in html
    assert html.count("<circle") == 40
    assert "http" not in html


def test_times_are_told_by_person() -> None:
    rng = np.random.default_rng(0)
    brisk, slow = pair(rows(rng, 40), rows(rng, 40, -8.0)), pair(rows(rng, 40), rows(rng, 40, 8.0))
    assert by_person(brisk) == []
    both = [*brisk, *(({**a, "person": "ordinary"}, {**b, "person": "ordinary"}) for a, b in slow)]
    times = [line.split() for line in by_person(both) if "time_s" in line]
    assert [(line[0], line[-1]) for line in times] == [("careful", "better"), ("ordinary", "worse")]
    assert persons_as_json(both).keys() == {"careful", "ordinary"}


def test_rows_come_back_from_a_table(tmp_path: Path) -> None:
    one = {"key": "a", "seed": 1, "placements": {"p1": "o1"}, "sim_time_s": 3, "correct": None, "odd": 1}
    other = {"key": "b", "seed": 2, "sim_time_s": 3.5, "correct": True, "odd": "x"}
    write_table([one, other], tmp_path / "runs.parquet")
    back = read_table(tmp_path / "runs.parquet")
    assert [row["sim_time_s"] for row in back] == [3.0, 3.5]
    assert json.loads(back[0]["placements"]) == {"p1": "o1"}
    assert [row["odd"] for row in back] == ["1", "x"]
    assert not math.isnan(back[1]["sim_time_s"])


def test_commands_refuse_what_makes_no_sense(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["compare", "trees/assemble.xml", "--out", str(tmp_path)]) == 2
    assert main(["compare", "a.xml", "b.xml", "--fail-if", "right is bad"]) == 2
    spec = tmp_path / "spec.yaml"
    spec.write_text("trees: [none.xml]\n")
    assert main(["lab", "sweep", str(spec), "--out", str(tmp_path / "out")]) == 2
    assert "none.xml" in capsys.readouterr().err
    assert not (tmp_path / "out").exists()
