"""Every tree that works beside a person asks for a part that it cannot get, and waits for the answer."""

from __future__ import annotations

import pytest

from bracket_cell.trees.bench import TreeBench
from bracket_cell.trees.vocabulary import Part
from btxml.engine.node import RUNNING
from tests import ROOT
from tests.trees.nodes.rig import services

LEAST_S = 30.0  # a person who notices after 10 s on average has noticed by then, nearly always
MISSING = {
    **dict.fromkeys(("AssemblyFinished", "BracketTaken", "HoldsNeededPart", "BuiltBeside", "FindPart"), "F"),
    "AskForHelp": "R",
}
PREDICTED = {"PredictNextObject": {"part": Part("o3")}, "ChooseSparePart": {"part": Part("o3")}}


@pytest.mark.parametrize("name", ["ahead", "assemble", "shift", "shift_ahead"])
def test_a_part_that_is_not_there_is_asked_for_and_the_answer_awaited(name: str) -> None:
    made = TreeBench(ROOT / "trees" / f"{name}.xml", MISSING, PREDICTED)
    for _ in range(60):
        assert made.tick(0.1) == "R"
    (asks,) = [node for node in made.tree.nodes if type(node).__name__ == "AskForHelp" and node.status is RUNNING]
    assert vars(asks)["wait_s"].get() >= LEAST_S


@pytest.mark.parametrize(("answers", "looks"), [("RF", 1), ("RS", 4)])
def test_a_kit_waits_for_help_and_tries_again_only_where_it_was_given(
    answers: str, looks: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(ROOT)
    told = {"FindPart": "F", "AskForHelp": answers * 9}
    made = TreeBench(ROOT / "trees" / "jobs" / "kit.xml", told, services=services())
    while made.tick(0.1) == "R":
        pass
    assert made.started("AskForHelp") == looks
