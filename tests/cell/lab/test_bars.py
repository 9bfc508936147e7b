"""Bars: a row for each figure, met or missed, from what the commands tell."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from cell.commands.lab.bars import BARS, Figure, Measured, chosen_bars, measured
from cell.errors import InputError
from cell.files.row_store import RowStore

FOUND = Figure(claim="found", key="trackers.slim.found", least=0.9)
ONE = Measured(command="hands --look hard", seeds=10, figures=(FOUND,))


def test_every_shipped_bar_names_a_command_and_one_bar() -> None:
    found = chosen_bars()
    assert {one.command.split()[0] for one in found} >= {"hands", "actions", "holes", "parts", "grasp", "semantic"}
    assert len({figure.claim for one in found for figure in one.figures}) == sum(len(one.figures) for one in found)


@pytest.mark.parametrize(("value", "met"), [(0.95, True), (0.85, False)])
def test_a_figure_is_met_or_missed(value: float, met: bool) -> None:
    told = {"trackers": {"slim": {"found": value, "found_low": value - 0.1, "found_high": 1.0}}}
    row = FOUND.of(told)
    assert (row["figure"], row["met"], row["bar"]) == (value, met, 0.9)
    assert row["interval"] == [pytest.approx(value - 0.1), 1.0]


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

    def ask(words: list[str]) -> Any:
        asked.append(words)
        return {"trackers": {"slim": {"found": 1.0}}}

    for _ in range(2):
        store = RowStore(tmp_path / "bars.jsonl", ["command"], {"first_seed": 900_000})
        (row,) = measured([ONE], 900_000, store, ask)
    assert asked == [["hands", "--look", "hard", "--seeds", "900000:900010", "--json"]]
    assert row["command"] == "cell lab eval hands --look hard --seeds 900000:900010 --json"


def test_a_bar_needs_a_side_and_a_name_that_exists(tmp_path: Path) -> None:
    wrong = tmp_path / "bars.yaml"
    wrong.write_text("bars:\n- command: hands\n  figures:\n  - {claim: found, key: found}\n")
    with pytest.raises(InputError, match=r"bars\.yaml:4:5: .*must have either `least` or `most`"):
        chosen_bars(path=wrong)
    with pytest.raises(InputError, match="--only feet: no such command; legal: actions, grasp, hands"):
        chosen_bars(["feet"])
    assert BARS.is_file()
