"""Trees beside the file, trees that replace others, stubs for nodes that nobody knows, entries from outside."""

from __future__ import annotations

from pathlib import Path

import pytest

from bracket_cell.commands.main import main
from bracket_cell.trees.bench import TreeBench
from bracket_cell.trees.node_library import node_registry
from btxml.files.check import Circumstances, findings
from btxml.files.loader import load_tree
from btxml.testing import assert_ticks

RETRY = """<root BTCPP_format="4" main_tree_to_execute="FetchOne"><include path="{shipped}"/>
  <BehaviorTree ID="PickPart" _replaces="true">
    <RetryUntilSuccessful num_attempts="2"><PickPart parts="{{parts}}" index="{{index}}"/></RetryUntilSuccessful>
  </BehaviorTree>
</root>"""
SHIPPED = Path("trees/clear_and_grasp.xml").resolve()


def files(folder: Path, **texts: str) -> list[Path]:
    for name, text in texts.items():
        (folder / f"{name}.xml").write_text(f'<root BTCPP_format="4">{text}</root>')
    return [folder / f"{name}.xml" for name in texts]


def test_a_retry_around_a_node_of_a_shipped_tree_is_five_lines(tmp_path: Path) -> None:
    file = tmp_path / "retry.xml"
    file.write_text(RETRY.format(shipped=SHIPPED))
    assert findings([file], node_registry()).problems == []
    bench = TreeBench(file, {"PickPart": "FS"}, {"FindPart": {"index": 0}})
    assert_ticks(bench, "RS")
    assert bench.started("PickPart") == 2
    assert bench.started("FindPart") == 1  # without the retry the tray is looked at again


def test_a_tree_takes_the_place_of_an_included_one_and_may_call_it(tmp_path: Path) -> None:
    first, second = files(
        tmp_path,
        base='<BehaviorTree ID="Main"><SubTree ID="Work"/></BehaviorTree>'
        '<BehaviorTree ID="Work"><Script code="x := 1"/></BehaviorTree>',
        mine='<include path="base.xml"/><BehaviorTree ID="Work" _replaces="true">'
        '<Sequence><SubTree ID="Work" _autoremap="true"/><Script code="x += 10"/></Sequence></BehaviorTree>',
    )
    tree = load_tree(second, node_registry(), "Main")
    tree.tick()
    assert [scope.values() for scope in tree.scopes][1] == {"x": 11}
    assert load_tree(first, node_registry(), "Main").nodes[-1].name == "Script"


def test_a_second_tree_of_a_name_is_a_mistake_that_tells_the_way_out(tmp_path: Path) -> None:
    _, second = files(
        tmp_path,
        base='<BehaviorTree ID="Work"><AlwaysSuccess/></BehaviorTree>',
        mine='<include path="base.xml"/><BehaviorTree ID="Work"><AlwaysFailure/></BehaviorTree>',
    )
    (problem,) = findings([second], node_registry()).problems
    assert 'let this one take its place: _replaces="true"' in str(problem)


def test_trees_of_files_and_folders_beside_may_be_named(tmp_path: Path) -> None:
    (tmp_path / "more").mkdir()
    (file,) = files(tmp_path, main='<BehaviorTree ID="Main"><SubTree ID="Other"/></BehaviorTree>')
    files(tmp_path / "more", other='<BehaviorTree ID="Other"><AlwaysSuccess/></BehaviorTree>')
    assert "there is no BehaviorTree 'Other'" in str(findings([file], node_registry()).problems[0])
    for beside in (tmp_path / "more", tmp_path / "more" / "other.xml"):
        assert findings([file], node_registry(), Circumstances((beside,))).problems == []
    assert load_tree(file, node_registry(), beside=(tmp_path / "more",)).tick().name == "SUCCESS"


def test_stubs_stand_for_what_nobody_knows_and_doubts_become_warnings(tmp_path: Path) -> None:
    (file,) = files(
        tmp_path,
        main="""<BehaviorTree ID="Main"><PauseResumeController number_of_retries="2">
          <ComputePath goal="{goal}" path="{path}" planner="Grid; fast"/><Sequence><Spin turn="{angle}"/></Sequence>
          </PauseResumeController></BehaviorTree>""",
    )
    assert len(findings([file], node_registry()).problems) == 1 + 1 + 1
    problems, warnings, _ = findings([file], node_registry(), Circumstances(stubs=True))
    assert (problems, warnings) == ([], [])
    (doubtful,) = files(
        tmp_path,
        doubt="""<BehaviorTree ID="Main"><Fallback><AlwaysSuccess/><Spin/></Fallback></BehaviorTree>""",
    )
    problems, warnings, _ = findings([doubtful], node_registry(), Circumstances(stubs=True))
    assert [problem.what.split(":")[0] for problem in warnings] == ["Spin is never ticked"]
    assert problems == []


def test_entries_come_from_the_command_line(tmp_path: Path) -> None:
    (file,) = files(
        tmp_path, main='<BehaviorTree ID="Main"><FindPart part="{part}" parts="{parts}" index="{i}"/></BehaviorTree>'
    )
    assert main(["check", str(file)]) == 2
    (tmp_path / "entries.yaml").write_text("part: o2\nparts: [1, 2]\n")
    assert main(["check", str(file), "--set", str(tmp_path / "entries.yaml")]) == 2  # a list is no PartsView
    (file,) = files(tmp_path, main='<BehaviorTree ID="Main"><ShowMessage text="{t}"/></BehaviorTree>')
    assert main(["check", str(file)]) == 2
    assert main(["check", str(file), "--set", "t=hello"]) == 0
    for wrong in ("1x=3", "no_such.yaml", "=3", "u=3"):
        assert main(["check", str(file), "--set", wrong]) == 2


def test_an_entry_that_the_tree_does_not_have_is_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """A misspelt name was taken without a word, and the tree ran without it."""
    models = '<TreeNodesModel><SubTree ID="Main"><input_port name="declared"/></SubTree></TreeNodesModel>'
    (file,) = files(
        tmp_path,
        main=f'<BehaviorTree ID="Main"><Script code="told:=text; @far:=1"/></BehaviorTree>{models}',
    )
    (other,) = files(tmp_path, other='<BehaviorTree ID="Main"><ShowMessage text="{other}"/></BehaviorTree>')
    legal = [f"{name}=1" for name in ("text", "told", "far", "declared")]
    log = tmp_path / "log.mcap"
    assert main(["check", str(file), *(word for one in legal for word in ("--set", one))]) == 0
    capsys.readouterr()
    for command in (["run", str(file), "--log", str(log)], ["check", str(file)]):
        assert main([*command, "--set", "text=1", "--set", "tex=2"]) == 2
        said = capsys.readouterr().err
        assert "'tex' is given, and the main tree has no such entry" in said
        assert "did you mean 'text'?" in said
    assert not log.exists()
    assert main(["check", str(file), str(other), "--set", "text=1", "--set", "other=2"]) == 0


def test_a_subtree_without_nodes_is_told_and_no_more(tmp_path: Path) -> None:
    (file,) = files(
        tmp_path,
        main='<BehaviorTree ID="Main"><SubTree ID="Empty"/></BehaviorTree><BehaviorTree ID="Empty"></BehaviorTree>',
    )
    assert ["has 0 nodes" in problem.what for problem in findings([file], node_registry()).problems] == [True]


def test_a_tree_named_like_a_node_is_told(tmp_path: Path) -> None:
    (file,) = files(tmp_path, main='<BehaviorTree ID="Sequence"><AlwaysSuccess/></BehaviorTree>')
    (problem,) = findings([file], node_registry()).problems
    assert "a node is named 'Sequence', too" in str(problem)


def test_subtrees_of_one_name_beside_each_other_have_paths_of_their_own(tmp_path: Path) -> None:
    calls = '<SubTree ID="Inner" name="same" p="1"/><SubTree ID="Inner" name="same" p="2"/>'
    inner = '<BehaviorTree ID="Inner"><ScriptCondition code="p &gt; 0"/></BehaviorTree>'
    (file,) = files(tmp_path, main=f'<BehaviorTree ID="Main"><Sequence>{calls}</Sequence></BehaviorTree>{inner}')
    tree = load_tree(file, node_registry(), "Main")
    assert [scope.name for scope in tree.scopes] == ["", "same", "same::4"]
    assert len({node.full_path for node in tree.nodes}) == len(tree.nodes)


def test_a_node_of_another_program_may_have_the_name_of_one_of_ours(tmp_path: Path) -> None:
    file = tmp_path / "theirs.xml"
    file.write_text(
        '<root BTCPP_format="4"><BehaviorTree ID="Main"><Sequence><MoveToPose group="arm" target="{t}"/>'
        "<AlwaysSuccess/></Sequence></BehaviorTree></root>"
    )
    assert findings([file], node_registry(), Circumstances()).problems
    assert findings([file], node_registry(), Circumstances(stubs=True, provided={"t": 1})).problems == []
