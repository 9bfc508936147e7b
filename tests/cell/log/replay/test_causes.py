"""Changes of every kind on a kept run: each names its first cause, and the numbers are those that were compared.

`kept/helps.mcap` is the beginning of a run without images of seed 1 that builds g1, with trees/ahead.xml and the node
MayBegin before "one part ahead of the person"; `kept/late.mcap` is the same with frames that come .1 s later. After a
wanted change they are made anew with `cell run TREE --config FILE --look none --with kept/may_begin.py`, FILE as
`configured` below writes it, and `write_case`.
"""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import onnx
import pytest

from bracket_cell.commands.main import main
from bracket_cell.learned.inference.onnx_model import sealed, without_digest
from bracket_cell.log.read.reader import Log, read_log
from bracket_cell.log.replay.compare import Comparison
from bracket_cell.log.replay.explain import causes, changed_files, changed_keys
from bracket_cell.log.replay.loading import Changes
from bracket_cell.log.replay.replay import Replay
from bracket_cell.log.report.query import diff
from btxml.engine.causes import RELATIONS
from tests import ROOT
from tests.cell.conftest import changed_configuration

KEPT = Path(__file__).parent / "kept"
NODE = KEPT / "may_begin.py"
WEIGHTS = ROOT / "learned" / "weights"
NUMBER = r"(-?[\d.]+(?:e-?\d+)?|inf)"
TURN = re.compile(rf"\w+(?: of [\w ]+)?: {NUMBER} ([<>]=?) {NUMBER} is (true|false)")
Change = Callable[[Path], Changes]


@pytest.fixture(scope="module")
def kept() -> Log:
    return read_log(KEPT / "helps.mcap")


def tree(*edits: tuple[str, str]) -> Change:
    """Edits of the recorded trees."""

    def change(folder: Path) -> Changes:
        log = read_log(KEPT / "helps.mcap")
        texts = {name: content.decode() for name, content in log.attachments.items() if name.startswith("tree/")}
        for old, new in edits:
            assert any(old in text for text in texts.values()), old
            texts = {name: text.replace(old, new) for name, text in texts.items()}
        for name, text in texts.items():
            (folder / Path(name).name).write_text(text)
        return Changes(tree=folder / "ahead.xml", nodes=(str(NODE),))

    return change


def configured(old: str, new: str) -> Change:
    """The shipped configuration, changed, with the prior and the guard that the kept logs were made with."""

    def change(folder: Path) -> Changes:
        made = changed_configuration(folder, old, new)
        text = re.sub(r"  (placement_s|left_in_share): .*\n", "", made.read_text())
        made.write_text(text.replace("none_probability: 0.1", "none_probability: 0.02"))
        return Changes(configuration=made, nodes=(str(NODE),))

    return change


def weights(planner: str, file: str, names: str, change_of: Callable[[Any], Any]) -> Change:
    """Weights of a planner of which some are others."""

    def change(folder: Path) -> Changes:
        model = onnx.load_from_string(without_digest((WEIGHTS / file).read_bytes()))
        chosen = [tensor for tensor in model.graph.initializer if re.fullmatch(names, tensor.name)]
        assert chosen
        for tensor in chosen:
            values = onnx.numpy_helper.to_array(tensor)
            tensor.CopyFrom(onnx.numpy_helper.from_array(change_of(values).astype(values.dtype), tensor.name))
        (folder / file).write_bytes(sealed(model.SerializeToString()))
        return Changes(weights={planner: folder / file}, nodes=(str(NODE),))

    return change


def code(old: str, new: str) -> Change:
    def change(folder: Path) -> Changes:
        (folder / NODE.name).write_text(NODE.read_text().replace(old, new))
        return Changes(nodes=(str(folder / NODE.name),))

    return change


CLEAR = '<WaitForHandClear position="{position}" distance_m="0.25" way_m="0.10" lookahead_s="0.2"/>'
WHAT_IFS = {
    "threshold of a cost": (configured("question_s: 30.0", "question_s: 290.0"), "guard", "guard.question_s 30 -> 290"),
    "another cost": (configured("wrong_act_s: 300.0", "wrong_act_s: 30.0"), "guard", "guard.wrong_act_s 300 -> 30"),
    "separation": (
        configured("guard: #", "motion:\n  separation:\n    hysteresis_m: 0.3\n\nguard: #"),
        "supervisor hand_too_near",
        "hysteresis_m 0.03 -> 0.3",
    ),
    "lookahead": (tree(('lookahead_s="0.2"', 'lookahead_s="0.9"')), "WaitForHandClear", "lookahead_s 0.2 -> 0.9"),
    "distance": (tree(('distance_m="0.25"', 'distance_m="0.45"')), "WaitForHandClear", "distance_m 0.25 -> 0.45"),
    "way": (tree(('way_m="0.10"', 'way_m="2.0"')), "WaitForHandClear", "way_m 0.1 -> 2"),
    "settling": (
        tree(("<ReconcileGraph ", '<ReconcileGraph settle_s="0.0" ')),
        "ReconcileGraph",
        " -> 0",
    ),
    "weights of the goals": (
        weights("semantic", "semantic_factored.onnx", "prior", lambda prior: prior + np.array([2.0, 0.0, 0.0])),
        "planner semantic",
        "answers goals",
    ),
    "weights of grasps": (
        weights("grasp", "grasp_pairwise.onnx", r"members\.\d\.4\.bias", lambda bias: bias + 5.0),
        "planner grasp",
        "answers graspable",
    ),
    "code of a node": (code("BEGINS_S = 1.0", "BEGINS_S = 4.0"), "MayBegin", "changed: code of"),
    "a node more": (
        tree(("<MayBegin/>", '<MayBegin/><Delay delay_msec="2000"><AlwaysSuccess/></Delay>')),
        "Delay",
        "not there -> Delay",
    ),
    "a node less": (tree(("<MayBegin/>", "")), "MayBegin", "MayBegin -> not there"),
}


def explained(log: Log, changes: Changes) -> tuple[Comparison, list[str]]:
    replay = Replay(log, changes)
    comparison = replay.run(watch=lambda step: all(difference.aspect != "command" for difference in step.differences))
    return comparison, causes(comparison, changed_keys(replay))


FAST = ("distance", "code of a node")


@pytest.mark.parametrize(
    "name", [one if one in FAST else pytest.param(one, marks=pytest.mark.slow) for one in WHAT_IFS]
)
def test_a_change_names_its_first_cause(name: str, kept: Log, tmp_path: Path) -> None:
    change, by, changed = WHAT_IFS[name]
    comparison, found = explained(kept, change(tmp_path))
    assert not comparison.identical
    assert found, name
    assert by in found[0]
    assert changed in found[0]
    first = int(re.findall(r"^tick (\d+), ", found[0])[0])
    assert comparison.leading is not None
    assert first <= comparison.leading.tick
    holds_as_it_says("\n".join(found))


def holds_as_it_says(words: str) -> None:
    """Each comparison that is printed has the answer that its own numbers have."""
    for measured, relation, limit, answer in TURN.findall(words):
        assert str(RELATIONS[relation](float(measured), float(limit))).lower() == answer, words


def test_a_device_that_is_late_is_named_with_its_delay(kept: Log) -> None:
    late = read_log(KEPT / "late.mcap")
    found = causes(diff(kept, late), changed_files(kept, late))
    assert found[0].startswith("tick 3, 0.12 s: bench is seen otherwise; changed: ")
    assert "hardware.camera_latency_s: 0.05 -> 0.15" in found[0]
    assert any(
        "bench_stale" in line and "clear_s: 0.52 >= 0.5 is true -> clear_s: 0.04 >= 0.5" in line for line in found
    )


def test_a_log_without_records_has_no_cause(kept: Log, tmp_path: Path) -> None:
    older = replace(
        kept,
        ticks=tuple(
            replace(tick, notes=tuple(note for note in tick.notes if note[0] != "cause")) for tick in kept.ticks
        ),
    )
    change, *_ = WHAT_IFS["threshold of a cost"]
    assert explained(older, change(tmp_path))[1] == [
        "no record: the log holds no comparisons, as releases before 0.13 wrote none"
    ]


def test_nothing_changed_has_no_cause(kept: Log) -> None:
    assert explained(kept, Changes(nodes=(str(NODE),)))[1] == []


def test_the_command_says_the_cause(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    changes = WHAT_IFS["distance"][0](tmp_path)
    arguments = ["replay", str(KEPT / "helps.mcap"), "--tree", str(changes.tree), "--with", str(NODE)]
    assert main(arguments) == 1
    told = capsys.readouterr().out
    why = told[told.index("why:\n") :]
    assert "WaitForHandClear" in why
    assert "distance_m 0.25 -> 0.45" in why


def test_a_change_in_a_tree_that_is_called_often_is_told_once(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    changes = tree(('distance_m="0.25"', 'distance_m="0.45"'), ('distance_m="0.15"', 'distance_m="0.30"'))(tmp_path)
    main(["replay", str(KEPT / "helps.mcap"), "--tree", str(changes.tree), "--with", str(NODE)])
    told = capsys.readouterr().out
    changed = told[told.index("changed:\n") : told.index("why:\n")].splitlines()
    assert len(changed) == len(set(changed)) > 1
