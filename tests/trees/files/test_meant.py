"""What a tree file may mean and mostly does not is a warning: it runs, and `cell check` ends with 1."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

from bracket_cell.commands.main import main
from bracket_cell.trees.node_library import node_registry
from btxml.files.check import Circumstances, Findings, findings
from btxml.files.loader import load_tree

ROOT = '<root BTCPP_format="4" main_tree_to_execute="M">\n{}\n</root>'
MAIN = '<BehaviorTree ID="M"><Sequence>\n{}\n</Sequence></BehaviorTree>'
READS = '<BehaviorTree ID="S"><ScriptCondition code="x == 1"/></BehaviorTree>'
DOUBTFUL = {
    '<Parallel success_count="5"><AlwaysSuccess/><AlwaysSuccess/></Parallel>': (
        2, "2 children can never succeed 5 times; at most 2",
    ),
    '<ParallelAll max_failures="3"><AlwaysSuccess/></ParallelAll>': (2, "1 child can never fail 3 times; at most 1"),
    '<RetryUntilSuccessful num_attempts="0"><AlwaysSuccess/></RetryUntilSuccessful>': (
        2, "port 'num_attempts' is '0'; at least 1, or -1",
    ),
    '<Repeat num_cycles="-2"><AlwaysSuccess/></Repeat>': (2, "port 'num_cycles' is '-2'; at least 1, or -1"),
    '<Timeout msec="0"><AlwaysSuccess/></Timeout>': (2, "port 'msec' is '0'; at least 1"),
    '<Delay delay_msec="-100"><AlwaysSuccess/></Delay>': (2, "port 'delay_msec' is '-100'; at least 0"),
    '<Script code="cuont := 1"/>': (2, "'code' of Script writes {cuont}, and nothing reads it; remove it"),
    '<Script code="count := 1"/>\n<ScriptCondition code="count == 1"/>\n<Script code="cuont := 1"/>': (
        4, "'code' of Script writes {cuont}, and nothing reads it; did you mean {count}?",
    ),
    '<SetBlackboard value="1" output_key="n"/>': (
        2, "port 'output_key' of SetBlackboard writes {n}, and nothing reads it; remove it",
    ),
    '<LookAtTray parts="{t}"/>': (2, "port 'parts' of LookAtTray writes {t}, and nothing reads it; remove it"),
    "<ActivateGripper/>\n<ReturnToTray/>": (
        3,
        "ReturnToTray needs a part in the gripper, and nothing before it sees to that; "
        "TakeFromHand or PickLying or PickPart or Pick does",
    ),
    '<Parallel success_count="2"><Script code="a:=1"/>\n<Script code="a:=2"/></Parallel>'
    '<ScriptCondition code="a==1"/>': (
        3, "'code' of Script writes {a} while 'code' of Script at m.xml:2:43 may; "
        "whoever is ticked last wins; give each an entry of its own",
    ),
    '<SubTree ID="S" x="1" z="2"/>': (2, "nothing in SubTree 'S' reads 'z'; remove it"),
    '<ReactiveSequence><ActivateGripper/><Sequence><GripperIsEmpty/>\n<MoveTo pose="park"/></Sequence>'
    '<ForceSuccess><MoveTo pose="look"/></ForceSuccess></ReactiveSequence>': (
        3, "MoveTo is asked again in every tick while MoveTo at m.xml:3:47 commands the arm; "
        "put both into a Sequence, where each is asked until it is done",
    ),
}  # fmt: skip
SOUND = (
    '<RetryUntilSuccessful num_attempts="-1"><AlwaysSuccess/></RetryUntilSuccessful>',
    '<Script code="n := 1"/><Sleep msec="40" _skipIf="n == 1"/>',
    "<GripperIsEmpty/><IdentifyHeldPart/><ReturnToTray/>",
    '<Parallel><Script code="a:=1"/><Script code="b:=2"/></Parallel><ScriptCondition code="a==b"/>',
    '<SubTree ID="S" x="1"/>',
    '<LookAtTray parts="{t}"/><FindPart part="o1" parts="{t}"/>',
    '<ReactiveSequence><Fallback><GripperIsEmpty/><OpenGripper/></Fallback><GiveWay/><MoveTo pose="park"/>'
    "</ReactiveSequence>",
)


def test_an_entry_has_the_name_that_its_tree_gives_it(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    inner = """<Script code="x := 4; y := 'q'"/>\n<ScriptCondition code="x &lt; 5"/>"""
    trees = f'<BehaviorTree ID="B"><Sequence>{inner}</Sequence></BehaviorTree>'
    text = ROOT.format(MAIN.format('<SubTree ID="B" x="{y}" y="{x}"/>') + trees)
    [warning] = found_in(tmp_path, monkeypatch, text).warnings
    assert str(warning.what) == "'code' of Script writes {y}, and nothing reads it"


def found_in(folder: Path, monkeypatch: pytest.MonkeyPatch, text: str) -> Findings:
    monkeypatch.chdir(folder)
    file = Path("m.xml")
    file.write_text(text)
    return findings([file], node_registry())


@pytest.mark.parametrize(("body", "told"), DOUBTFUL.items())
def test_what_can_hardly_be_meant_is_told_and_runs(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, body: str, told: tuple[int, str]
) -> None:
    text = ROOT.format(MAIN.format(body) + (READS if "SubTree" in body else ""))
    found = found_in(tmp_path, monkeypatch, text.replace("\n<Behavior", "<Behavior", 1))
    assert found.problems == []
    [warning] = found.warnings
    assert (warning.place.line, f"{warning.what}; {warning.legal}") == told
    load_tree(Path("m.xml"), node_registry())


@pytest.mark.parametrize("body", SOUND)
def test_what_is_meant_is_not_told(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, body: str) -> None:
    found = found_in(tmp_path, monkeypatch, ROOT.format(MAIN.format(body) + (READS if "SubTree" in body else "")))
    assert found == Findings([], [], [])


def test_what_one_of_two_calls_needs_is_not_told(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    calls = '<SubTree ID="L" t="{t}"/><SubTree ID="L"/><FindPart part="o1" parts="{t}"/>'
    look = '<BehaviorTree ID="L"><LookAtTray parts="{t}"/></BehaviorTree>'
    assert found_in(tmp_path, monkeypatch, ROOT.format(MAIN.format(calls) + look)) == Findings([], [], [])


def test_a_foreign_dialect_is_noted_where_nodes_are_foreign(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The attribute of a port of the library to TypeScript is written much like ours."""
    text = ROOT.format(MAIN.format("<AlwaysSuccess/>")).replace("<root", '<root BTTS_format="4"')
    [problem] = found_in(tmp_path, monkeypatch, text).problems
    stubs = findings([Path("m.xml")], node_registry(), Circumstances(stubs=True))
    assert stubs == Findings([], [], [problem])


@pytest.mark.parametrize(
    ("body", "told"),
    [
        ('<AskForHelp text=" " part="o1"/>', "port 'text' is empty"),
        ('<SubTree ID="S" wait="-1"/>', "port 'wait_s' of AskForHelp at m.xml:1:175 gets -1"),
    ],
)
def test_what_never_works_is_a_mistake(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, body: str, told: str) -> None:
    inner = '<BehaviorTree ID="S"><AskForHelp text="a" wait_s="{wait}"/></BehaviorTree>' if "SubTree" in body else ""
    text = ROOT.format(MAIN.format(body) + inner).replace("\n", "")
    [problem] = found_in(tmp_path, monkeypatch, text).problems
    assert problem.what == told


def test_a_file_of_several_trees_says_which_to_run_and_all_are_called(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    trees = '<BehaviorTree ID="M"><AlwaysSuccess/></BehaviorTree><BehaviorTree ID="B"><AlwaysSuccess/></BehaviorTree>'
    [none_called] = found_in(tmp_path, monkeypatch, ROOT.format(trees)).warnings
    assert none_called.what == "nothing calls BehaviorTree 'B'"
    [no_main] = found_in(tmp_path, monkeypatch, f'<root BTCPP_format="4">{trees}</root>').warnings
    assert no_main.what == "the file does not say which of its trees to run: M, B"
    other = '<include path="m.xml"/><BehaviorTree ID="N"><SubTree ID="B"/></BehaviorTree>'
    Path("n.xml").write_text(ROOT.format(other).replace('"M"', '"N"'))
    assert findings([Path("m.xml"), Path("n.xml")], node_registry()).warnings == []


def test_the_command_knows_the_configuration_of_its_folder(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """A folder that `cell init` made, with a node and a part of its own."""
    monkeypatch.chdir(tmp_path)
    assert main(["init", "."]) == 0
    assert main(["new", "leaf", "CountNuts"]) == 0
    body = '<CountNuts count="{n}"/><AskForHelp text="a" part="o1"/><ScriptCondition code="n == 1"/>'
    file = Path("trees/mine.xml")
    file.write_text(ROOT.format(MAIN.format(body)))
    capsys.readouterr()
    assert main(["check", str(file)]) == 0, capsys.readouterr().err
    file.write_text(ROOT.format(MAIN.format('<Script code="p := 1"/>')))
    assert main(["check", str(file)]) == 1
    assert "warning: 'code' of Script writes {p}" in capsys.readouterr().err
    file.write_text(ROOT.format(MAIN.format('<LookAtTray parts="{t}"/><FindPart part="o9" parts="{t}"/>')))
    assert main(["check", str(file)]) == 2
    assert "the product has no part type 'o9'" in capsys.readouterr().err
    assert main(["check", "--no-config", str(file)]) == 0
    assert main(["show", "trees/ahead.xml"]) == 0


def test_what_is_no_file_beside_a_tree_is_passed_over(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """An editor's lock is a link to nowhere; a pipe would be waited for."""
    (tmp_path / "m.xml").write_text(ROOT.format(MAIN.format("<AlwaysSuccess/>") + READS))
    (tmp_path / ".#m.xml").symlink_to("me@host.1234:56")
    (tmp_path / "._m.xml").write_bytes(b"\0\5\x16\7")
    (tmp_path / "folder.xml").mkdir()
    os.mkfifo(tmp_path / "pipe.xml")
    (tmp_path / ".#n.py").symlink_to("me@host.1234:56")
    (tmp_path / "n.py").write_text("")
    options = ["--no-config", "--with", str(tmp_path)]
    assert main(["check", str(tmp_path / "m.xml"), *options]) == 1
    assert "nothing calls BehaviorTree 'S'" in capsys.readouterr().err
