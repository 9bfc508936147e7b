"""Mocks from a file replace leaves as in BehaviorTree.CPP, which reads the same files."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest

from btxml import InputPort, Node, Status
from btxml.engine.errors import TreeFileError
from btxml.files.compile.registry import Registry
from btxml.testing import TreeBench

TREE = """<root BTCPP_format="4" main_tree_to_execute="Main"><BehaviorTree ID="Main"><Sequence>
<Script code="n := 0; note := ''"/><Fetch name="first" part="o1"/><SubTree ID="Side" name="left" n="{n}" note="{note}"/>
</Sequence></BehaviorTree>
<BehaviorTree ID="Side"><Sequence><Fetch name="second" part="o2"/><Fetch part="o3"/></Sequence></BehaviorTree></root>"""


class Fetch(Node):
    """A leaf of the cell."""

    part = InputPort(str, "what to fetch")

    def update(self) -> Status:
        return Status.SUCCESS


class Refuse(Node):
    """Another leaf, which fails."""

    def update(self) -> Status:
        return Status.FAILURE


REGISTRY = Registry([Fetch, Refuse])


def bench(folder: Path, rules: dict[str, str], configured: dict[str, Any] | None = None, **more: Any) -> TreeBench:
    (folder / "tree.xml").write_text(TREE)
    told = {"SubstitutionRules": rules, **({} if configured is None else {"TestNodeConfigs": configured})}
    (folder / "mocks.json").write_text(json.dumps(told))
    return TreeBench(folder / "tree.xml", registry=REGISTRY, mocks=folder / "mocks.json", **more)


@pytest.mark.parametrize("pattern", ["first", "Fetch", "left/*", "left/second", "l*/Fet??", "*/Fetch"])
def test_a_rule_means_names_tags_and_paths(tmp_path: Path, pattern: str) -> None:
    made = bench(tmp_path, {pattern: "AlwaysFailure"})
    assert made.tick() == "F"
    begun = {"first": 0, "Fetch": 0, "left/*": 1, "left/second": 1, "l*/Fet??": 2, "*/Fetch": 2}[pattern]
    assert sum(event.startswith("start") for event in made.events) == begun


def test_scripts_and_delays_are_those_of_the_library(tmp_path: Path) -> None:
    late = {
        "return_status_script": "n += 1; n > 1 ? FAILURE : SUCCESS",
        "success_script": "note = note .. 's'",
        "failure_script": "note = note .. 'f'",
        "post_script": "note = note .. 'p'",
        "async_delay": 100,
    }
    made = bench(tmp_path, {"left/*": "Late"}, {"Late": late})
    assert "".join(made.tick(0.04) for _ in range(7)) == "RRRRRRF"
    assert made.tree.blackboard.values()["note"] == "spfp"
    assert (made.started("second"), made.started("left/Fetch")) == (1, 1)


@pytest.mark.parametrize(("status", "root"), [("SUCCESS", "S"), ("FAILURE", "F"), ("RUNNING", "R"), ("SKIPPED", "S")])
def test_a_status_is_answered(tmp_path: Path, status: str, root: str) -> None:
    assert bench(tmp_path, {"first": "One"}, {"One": {"return_status": status}}).tick() == root


@pytest.mark.parametrize(
    ("script", "root"), [("2", "S"), ("3", "F"), ("'FAILURE'", "F"), ("n == 0 ? SUCCESS : FAILURE", "S")]
)
def test_a_script_may_answer_by_name_or_number(tmp_path: Path, script: str, root: str) -> None:
    assert bench(tmp_path, {"first": "One"}, {"One": {"return_status_script": script}}).tick() == root


def test_another_leaf_may_take_the_place(tmp_path: Path) -> None:
    assert bench(tmp_path, {"second": "Refuse"}).tick() == "S"  # a stand-in, too
    assert bench(tmp_path, {"second": "Refuse"}, real=[Refuse]).tick() == "F"


@pytest.mark.parametrize(
    ("rules", "configured", "message"),
    [
        ({"first": "Nothing"}, {}, "'first' is replaced by 'Nothing'; name a TestNodeConfig or a leaf"),
        ({"first": "Sequence"}, {}, "'first' is replaced by 'Sequence'"),
        ({}, {"A": {}}, "A needs return_status or return_status_script"),
        ({}, {"A": {"return_status": "IDLE"}}, "return_status is 'IDLE'; one of SUCCESS, FAILURE, RUNNING, SKIPPED"),
        ({}, {"A": {"return_status": "SUCCESS", "async_delay": -1}}, "async_delay is -1; whole milliseconds from 0"),
        ({}, {"A": {"return_status": "SUCCESS", "dealy": 1}}, "A has no 'dealy'"),
        ({}, {"A": {"return_status_script": "a :="}}, "return_status_script: bad script: the script ends"),
        ([], {}, "holds an object with TestNodeConfigs and SubstitutionRules"),
    ],
)
def test_a_wrong_file_is_refused(tmp_path: Path, rules: Any, configured: Any, message: str) -> None:
    with pytest.raises(TreeFileError, match=message):
        bench(tmp_path, rules, configured)


def test_a_rule_for_nothing_is_refused(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match="nothing is named 'frist'; did you mean 'first'"):
        bench(tmp_path, {"frist": "AlwaysSuccess"})
