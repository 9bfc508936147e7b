"""`cell new tree --convert`: tree files of version 3 become those of version 4, and nothing is lost in silence."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest

from bracket_cell.commands.main import main
from btxml.files.check import Circumstances, findings
from btxml.files.compile.registry import Registry
from btxml.files.parse.version3 import Converted, convert

Write = Callable[[str], Path]
WHOLE = """<?xml version="1.0"?>
<!-- <SequenceStar> stays -->
<root main_tree_to_execute="M">
  <BehaviorTree ID="M">
    <SequenceStar>
      <SubTree ID="S" target="where" other="{x}"/>
      <SubTreePlus ID="S" target="{where}" n="7" __autoremap="1"/>
    </SequenceStar>
  </BehaviorTree>
  <BehaviorTree ID="S"><AlwaysSuccess/></BehaviorTree>
</root>
"""


def converted(node: str) -> tuple[str, Converted]:
    """What a node becomes."""
    start, end = '<root><BehaviorTree ID="M">', "</BehaviorTree></root>"
    told = convert(Path("old.xml"), f"{start}{node}{end}")
    return told.text.removeprefix(start.replace("<root", '<root BTCPP_format="4"')).removesuffix(end), told


@pytest.mark.parametrize(
    ("old", "new"),
    [
        ("<SequenceStar><A/></SequenceStar>", "<SequenceWithMemory><A/></SequenceWithMemory>"),
        ('<Control ID="SequenceStar"/>', '<Control ID="SequenceWithMemory"/>'),
        ('<SubTree ID="S" name="n" target="where"/>', '<SubTree ID="S" name="n" target="{where}"/>'),
        ('<SubTree ID="S" target="{where}"/>', '<SubTree ID="S" target="{where}"/>'),
        ('<SubTree ID="S" __shared_blackboard="false"/>', '<SubTree ID="S"/>'),
        ('<SubTreePlus ID="S" n="7"/>', '<SubTree ID="S" n="7"/>'),
        ('<Parallel threshold="2"><A/></Parallel>', '<Parallel success_count="2"><A/></Parallel>'),
        ("<RetryUntilSuccesful num_attempts='3'><A/></RetryUntilSuccesful>",) * 2,
        ('<Foo text=">"/>', '<Foo text=">"/>'),
    ],
)
def test_what_is_kept(old: str, new: str) -> None:
    found, told = converted(old)
    assert found == new.replace("Succesful", "Successful")
    assert (bool(told.changes), told.lost) == (old != found, [])


@pytest.mark.parametrize(
    ("old", "new", "lost"),
    [
        ('<SubTree ID="S" __shared_blackboard="true"/>', '<SubTree ID="S" _autoremap="true"/>', "not shared"),
        (
            "<BlackboardCheckString value_A='{mode}' value_B='7'><A/></BlackboardCheckString>",
            """<Precondition if="mode == '7'" else="FAILURE"><A/></Precondition>""",
            "in every tick",
        ),
        (
            '<BlackboardCheckInt value_A="{n}" value_B="7" return_on_mismatch="SUCCESS"><A/></BlackboardCheckInt>',
            '<Precondition if="n == 7" else="SUCCESS"><A/></Precondition>',
            "in every tick",
        ),
        ("<ManualSelector><A/></ManualSelector>", "<ManualSelector><A/></ManualSelector>", "has no ManualSelector"),
        ('<Foo _skipIf="a"/>', '<Foo _skipIf="a"/>', "keeps for itself"),
    ],
)
def test_what_is_lost_is_said(old: str, new: str, lost: str) -> None:
    found, told = converted(old)
    assert found == new
    assert [lost in problem.what for problem in told.lost] == [True]


def test_a_whole_file_keeps_its_comments_and_loads(write: Write) -> None:
    told = convert(write(WHOLE), WHOLE)
    assert told.text.replace('BTCPP_format="4" ', "").splitlines()[:3] == WHOLE.splitlines()[:3]
    assert [problem.place.line for problem in told.changes] == [5, 6, 7, 7]
    found = findings([write(told.text)], Registry(), Circumstances(provided={"x": 1, "where": 2}))
    assert (found.problems, found.notes) == ([], [])


def test_check_says_what_a_file_of_version_3_is(write: Write) -> None:
    (note,) = [one for one in findings([write(WHOLE)], Registry()).notes if "BTCPP" in one.what]
    assert "as in line 5: SequenceStar is SequenceWithMemory" in note.what
    assert "`cell new tree NAME --convert FILE`" in note.legal
    (problem, *_) = findings([write(WHOLE.replace("<root", '<root BTCPP_format="3"'))], Registry()).problems
    assert "`cell new tree NAME --convert FILE`" in problem.legal
    plain = '<root BTCPP_format="3"><BehaviorTree ID="M"><AlwaysSuccess/></BehaviorTree></root>'
    found = findings([write(plain)], Registry())
    assert (found.problems, len(found.notes)) == ([], 1)


def test_no_file_is_overwritten(
    write: Write, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    old, new = write(WHOLE), tmp_path / "trees" / "mine.xml"

    def converted_by_command(path: Path) -> int:
        return main(["new", "tree", "Mine", "--convert", str(path)])

    assert converted_by_command(old) == 0
    assert "SequenceStar is SequenceWithMemory" in capsys.readouterr().err
    new.write_text("mine")
    assert converted_by_command(old) == 2
    assert (new.read_text(), old.read_text()) == ("mine", WHOLE)
    new.unlink()
    assert converted_by_command(write('<root BTCPP_format="4"/>')) == 2
    assert "only files of version 3" in capsys.readouterr().err
    assert converted_by_command(write("<root><ManualSelector/></root>")) == 1
    assert new.read_text() == '<root BTCPP_format="4"><ManualSelector/></root>'


def test_with_stubs_a_tree_may_have_the_name_of_a_node_of_this_cell(write: Write) -> None:
    from bracket_cell.trees.node_library import node_registry

    text = '<BehaviorTree ID="OpenGripper"><{} position="1"/></BehaviorTree>'
    for inner in ("MoveGripper", "OpenGripper"):
        file = write(text.format(inner))
        assert findings([file], node_registry(), Circumstances(stubs=True))[:2] == ([], [])
        assert findings([file], node_registry()).problems
    told = findings(
        [write('<BehaviorTree ID="Sequence"><A/></BehaviorTree>')], node_registry(), Circumstances(stubs=True)
    )
    assert "a node is named 'Sequence', too" in told.problems[0].what
