"""Bars: a row for each figure, met or missed, from what the commands tell."""

from __future__ import annotations

import contextlib
import subprocess
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import pytest

from bracket_cell.commands.main import main
from bracket_cell.configuration import Configuration, load_configuration
from bracket_ground.errors import InputError
from bracket_ground.files.row_store import RowStore
from bracket_lab.commands.bars import BARS, Figure, Measured, ask, chosen_bars, measured, parts_of
from bracket_lab.evaluations.figures import FIGURES, paper, topics, write_rows
from tests import ROOT

FOUND = Figure(claim="found", key="trackers.slim.found", least=0.9)
ONE = Measured(command="hands --look hard", page="seeing", table="Hands", minutes=1, seeds=10, figures=(FOUND,))


def test_what_is_measured_has_its_place_in_the_pages_and_beside_the_paper() -> None:
    for bar in chosen_bars():
        assert bar.page in topics(), bar.command
        for figure in bar.figures:
            if figure.paper is not None:
                assert paper().printed(figure.paper, f"{bar.table}: {figure.claim}")


def test_measured_rows_take_the_places_of_those_before(tmp_path: Path) -> None:
    (tmp_path / "seeing.json").write_text((FIGURES / "seeing.json").read_text())
    (before,) = (table for table in topics(tmp_path)["seeing"].tables if table.title == "Hands")
    again = before.rows[1].model_copy(update={"figure": 0.5, "bar": None, "met": None})
    write_rows("seeing", "Hands", [again, again.model_copy(update={"claim": "new"})], tmp_path)
    (after,) = (table for table in topics(tmp_path)["seeing"].tables if table.title == "Hands")
    assert after.rows == (before.rows[0], again, *before.rows[2:], again.model_copy(update={"claim": "new"}))
    lines = (tmp_path / "seeing.json").read_text().splitlines()
    assert sum('"claim": "new"' in line and '"figure": 0.5' in line for line in lines) == 1, "a row is a line"
    write_rows("seeing", "Feet", [again], tmp_path)
    assert topics(tmp_path)["seeing"].tables[-1].rows == (again,)
    with pytest.raises(InputError, match="no page of figures 'smelling'; there are: seeing"):
        write_rows("smelling", "Feet", [again], tmp_path)


def test_a_share_of_a_number_has_an_interval_though_its_command_tells_none() -> None:
    strict = Figure(claim="strict", key="strict_success_all", n=186)
    assert strict.of({"strict_success_all": 132 / 186})["interval"] == [0.6407, 0.7701]
    assert strict.model_copy(update={"n": "186 states"}).of({"strict_success_all": 0.7})["interval"] is None


def test_the_cost_is_told_before_anything_is_measured(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["lab", "eval", "bars", "--first-seed", "982000", "--only", "holes", "--plan"]) == 0
    assert "h of a GPU in all" in capsys.readouterr().err


def test_a_command_that_fills_two_tables_costs_once(capsys: pytest.CaptureFixture[str]) -> None:
    minutes = {bar.command: bar.minutes for bar in chosen_bars(["grasp"])}
    assert len(minutes) < len(chosen_bars(["grasp"]))
    assert main(["lab", "eval", "bars", "--first-seed", "982000", "--only", "grasp", "--plan"]) == 0
    assert f"{sum(minutes.values()) / 60:.1f} h of one core" in capsys.readouterr().err


def test_every_shipped_bar_names_a_command_and_one_bar() -> None:
    found = chosen_bars()
    assert {measurement.command.split()[0] for measurement in found} >= {
        "hands",
        "actions",
        "holes",
        "parts",
        "grasp",
        "semantic",
    }
    assert len({figure.claim for measurement in found for figure in measurement.figures}) == sum(
        len(measurement.figures) for measurement in found
    )


@pytest.mark.parametrize(("value", "met"), [(0.95, True), (0.85, False)])
def test_a_figure_is_met_or_missed(value: float, met: bool) -> None:
    told = {"trackers": {"slim": {"found": value, "found_low": value - 0.1, "found_high": 1.0}}}
    row = FOUND.of(told)
    assert (row["figure"], row["met"], row["bar"]) == (value, met, 0.9)
    assert row["interval"] == [pytest.approx(value - 0.1), 1.0]


def test_the_trivial_answer_may_be_one_of_the_command_s_own() -> None:
    spared = Figure(claim="beside", key="reaches.beside", trivial="reaches.alone")
    assert spared.of({"reaches": {"alone": 15.0, "beside": 10.0}})["trivial"] == 15.0
    with pytest.raises(InputError, match=r"beside: the answer holds no number `reaches\.alone`"):
        spared.of({"reaches": {"beside": 10.0}})


def test_errors_are_met_from_below_and_shares_bring_their_interval() -> None:
    most = Figure(claim="palm", key="palm", most=6.0)
    assert most.of({"palm": 5.0})["met"]
    assert not most.of({"palm": 7.0})["met"]
    share = Figure(claim="right", key="right.share", least=0.5)
    assert share.of({"right": {"share": 0.6, "low": 0.4, "high": 0.8}})["interval"] == [0.4, 0.8]


@pytest.mark.parametrize("told", [{}, {"trackers": {"slim": {}}}, {"trackers": {"slim": {"found": "all"}}}, []])
def test_an_answer_without_the_figure_is_told(told: Any) -> None:
    with pytest.raises(InputError, match=r"found: the answer holds no number `trackers\.slim\.found`"):
        FOUND.of(told)


def test_what_was_asked_is_not_asked_again(tmp_path: Path) -> None:
    asked: list[list[str]] = []

    def ask(words: list[str], settings: Mapping[str, object]) -> Any:  # noqa: ARG001
        asked.append(words)
        return {"trackers": {"slim": {"found": 1.0}}}

    for _ in range(2):
        store = RowStore(tmp_path / "bars.jsonl", ["command"], {"first_seed": 900_000})
        (row,) = measured([ONE], 900_000, store, ask, tmp_path)
    assert asked == [["bracket_cell", "lab", "eval", "hands", "--look", "hard", "--seeds", "900000:900010", "--json"]]
    assert row["command"] == "cell lab eval hands --look hard --seeds 900000:900010 --json"


def test_a_command_goes_on_in_its_own_part_and_a_benchmark_is_a_module(tmp_path: Path) -> None:
    asked: list[list[str]] = []

    def ask(words: list[str], settings: Mapping[str, object]) -> Any:  # noqa: ARG001
        asked.append(words)
        if len(asked) == 1:
            raise KeyboardInterrupt
        return {"trackers": {"slim": {"found": 1.0}}}

    one = ONE.model_copy(update={"module": "tests.benchmarks.robot_alone", "command": "clutter", "out": True})
    out = tmp_path / "bars.jsonl"
    for ends in (pytest.raises(KeyboardInterrupt), contextlib.nullcontext()):
        with ends, parts_of(out) as folder:
            (row,) = measured([one], 900_000, RowStore(out, ["command"], {}), ask, folder)
    assert asked[0] == asked[1]
    assert asked[0][:2] == ["tests.benchmarks.robot_alone", "clutter"]
    assert Path(asked[0][-1]).parent == folder
    command = "python -m tests.benchmarks.robot_alone clutter --seeds 900000:900010 --json --out FILE"
    assert row["command"] == command


def test_modules_of_shipped_bars_exist() -> None:
    for bar in chosen_bars():
        assert not bar.module or (ROOT / f"{bar.module.replace('.', '/')}.py").is_file()


def test_a_bar_needs_a_side_and_a_name_that_exists(tmp_path: Path) -> None:
    wrong = tmp_path / "bars.yaml"
    place = "  page: seeing\n  table: Hands\n  minutes: 1\n"
    wrong.write_text(
        f"bars:\n- command: hands\n{place}  figures:\n  - {{claim: found, key: found, least: 1, most: 2}}\n"
    )
    with pytest.raises(InputError, match=r"bars\.yaml:7:5: .*must not have both `least` and `most`"):
        chosen_bars(path=wrong)
    with pytest.raises(InputError, match="--only feet: no such command; legal: actions, clutter, figure10"):
        chosen_bars(["feet"])
    assert BARS.is_file()


def test_what_is_set_otherwise_is_set_for_the_command_alone(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    given: list[Configuration] = []

    def run(program: list[str], **_: Any) -> subprocess.CompletedProcess[str]:
        given.append(load_configuration(Path(program[program.index("--config") + 1])))
        return subprocess.CompletedProcess(program, 0, '{"found": 1.0}\n', "")

    monkeypatch.setattr(subprocess, "run", run)
    settings: dict[str, Any] = {"bench.overhead.depth": True, "perception.hands": {"kind": "mediapipe"}}
    figures = (Figure(claim="f", key="found", least=1),)
    one = ONE.model_copy(update={"command": "hands", "seeds": 2, "settings": settings, "figures": figures})
    (row,) = measured([one], 900_000, RowStore(tmp_path / "bars.jsonl", ["command"], {}), ask, tmp_path)
    assert given[0].bench.overhead.depth
    assert given[0].perception.hands is not None
    assert not load_configuration().bench.overhead.depth
    told = 'with bench.overhead.depth: true, perception.hands: {"kind": "mediapipe"}'
    assert row["command"].endswith(f"--json --config FILE {told}")


@pytest.mark.parametrize("one", [bar for bar in chosen_bars() if bar.settings], ids=lambda one: one.command)
def test_settings_of_shipped_bars_are_legal(one: Measured, monkeypatch: pytest.MonkeyPatch) -> None:
    def run(program: list[str], **_: Any) -> subprocess.CompletedProcess[str]:
        load_configuration(Path(program[program.index("--config") + 1]))
        return subprocess.CompletedProcess(program, 0, "{}\n", "")

    monkeypatch.setattr(subprocess, "run", run)
    assert ask(one.words(900_000), one.settings) == {}


def test_the_first_seed_is_an_option_of_this_command(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["lab", "eval", "bars", "--first-seed", "900000", "--only", "feet"]) == 2
    assert "--only feet: no such command" in capsys.readouterr().err
