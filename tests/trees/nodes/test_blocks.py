"""Blocks that need no motion: choosing, grids, loops, counters, timers, files, reports."""

from __future__ import annotations

import json
import os
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from bracket_cell.trees.loading import load_tree
from bracket_cell.trees.node_library import node_registry
from bracket_cell.trees.nodes.each import rows_of
from bracket_cell.trees.nodes.files import LoggedFiles, WorkingFolder
from bracket_cell.trees.nodes.poses import FramedPose
from bracket_cell.trees.nodes.services import Services
from bracket_cell.trees.nodes.shift import TeachGoal
from bracket_cell.trees.nodes.telling import Beep, TakeSnapshot
from bracket_cell.trees.nodes.tray import ChoosePart, GridSpot
from bracket_ground.interfaces.clock import ManualClock
from bracket_ground.interfaces.notes import ListJournal
from bracket_ground.interfaces.operator import OperatorOrder, OperatorState
from bracket_ground.interfaces.perception import HoleView, PartsView
from bracket_ground.interfaces.planning import AssemblyState, GraspPlan
from btxml.engine.errors import NodeError
from btxml.engine.status import Status
from btxml.testing import alone
from tests.trees.nodes.rig import HOLDING, PRODUCT, ScriptedGrasps, see, seen_parts, services


def run(body: str, to: Services, ticks: int = 50, **provided: Any) -> tuple[Status, dict[str, object]]:
    """Run a tree to its end; its last status and its blackboard."""
    models = "".join(f'<input_port name="{name}"/>' for name in provided)
    text = f'<BehaviorTree ID="Main">{body}</BehaviorTree><TreeNodesModel><SubTree ID="Main">{models}</SubTree>'
    file = Path("tree.xml")
    file.write_text(f'<root BTCPP_format="4" main_tree_to_execute="Main">{text}</TreeNodesModel></root>')
    tree = load_tree(file, node_registry(PRODUCT), provided=provided)
    tree.setup(to, ManualClock())
    for _ in range(ticks):
        status = tree.tick()
        if status is not Status.RUNNING:
            break
    return status, dict(tree.blackboard.values())


@pytest.fixture(autouse=True)
def _in_a_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)


def test_a_part_is_chosen_by_type_by_place_or_by_ease() -> None:
    view = seen_parts("o1", "o2", "o1")  # at x = 0.4, 0.5, 0.6
    plans = {0: GraspPlan(0.7, (), False, ""), 1: GraspPlan(0.6, (), False, ""), 2: GraspPlan(0.9, (), False, "")}
    to = services(grasp=ScriptedGrasps(plans), rule_grasp=ScriptedGrasps(plans))
    node = alone(ChoosePart("any"), services=to, parts=view)
    assert node.execute() is Status.SUCCESS
    assert node.feedback_message == "chose o1, one of 3"
    _, board = run('<ChoosePart parts="{v}" index="{i}" part="{p}"/>', to, v=view)
    assert (board["i"], board["p"]) == (2, "o1")
    _, board = run('<ChoosePart parts="{v}" type="o2" index="{i}"/>', to, v=view)
    assert board["i"] == 1
    _, board = run('<ChoosePart parts="{v}" near="world: 0.41 -0.4 0" index="{i}"/>', to, v=view)
    assert board["i"] == 0
    status, _ = run('<ChoosePart parts="{v}" near="world: 0.0 0.0 0" within_m="0.1" index="{i}"/>', to, v=view)
    assert status is Status.FAILURE
    status, _ = run('<ChoosePart parts="{v}" type="o3"/>', to, v=view)
    assert status is Status.FAILURE


def test_spots_of_a_grid_go_row_by_row_in_the_corner_s_axes() -> None:
    ports = {"corner": FramedPose.from_text("world: 0.5 0.5 0; 0 0 90"), "columns": 2, "rows": 2}
    places = []
    for number in range(4):
        node = alone(GridSpot("grid"), pitch_m=[0.1, 0.2], number=number, **ports)
        assert node.execute() is Status.SUCCESS
        places.append(vars(node)["spot"].entry.value.pose.position_m)
    rounded = [tuple(round(value, 6) for value in place) for place in places]
    assert rounded == [(0.5, 0.5, 0.0), (0.5, 0.6, 0.0), (0.3, 0.5, 0.0), (0.3, 0.6, 0.0)]
    full = alone(GridSpot("grid"), pitch_m=[0.1], number=4, **ports)
    assert full.execute() is Status.FAILURE
    assert full.feedback_message == "the grid has 4 spots, and none with number 4"


def test_each_part_sees_what_the_rounds_before_left() -> None:
    view = seen_parts("o1", "o2", "o1")
    body = """<Sequence><Script code="seen := ''"/>
      <ForEachPart seen="{v}" type="o1" parts="{left}" index="{i}" part="{p}" number="{n}">
        <Script code="seen := seen .. n .. p .. i .. ' '"/>
      </ForEachPart></Sequence>"""
    status, board = run(body, services(), v=view)
    assert status is Status.SUCCESS
    assert board["seen"] == "0o10 1o11 "
    left = board["left"]
    assert isinstance(left, PartsView)
    assert left.detections == view.detections[1:]


def test_each_hole_and_each_type_come_once_and_a_failed_round_ends_the_loop() -> None:
    body = """<Sequence><Script code="seen := ''"/>
      <ForEachType type="{t}"><Script code="seen := seen .. t"/></ForEachType>
      <ForEachHole position="{p}"><Script code="seen := seen .. p"/></ForEachHole>
      <ForEachHole positions="p5;p2" position="{p}"><Script code="seen := seen .. p"/></ForEachHole></Sequence>"""
    assert run(body, services())[1]["seen"] == "o1o2o3p1p2p3p4p5p6p5p2"
    failing = '<ForEachHole position="{p}"><ScriptCondition code="p != \'p3\'"/></ForEachHole>'
    status, board = run(failing, services())
    assert (status, board["p"]) == (Status.FAILURE, "p3")


def test_rows_of_a_table_fill_the_ports_that_name_its_columns() -> None:
    Path("order.csv").write_text("part, spot ,note\no1,tray: 0 0 0,a\n\no2,world: 0.4 0.5 0,b\n")
    body = """<Sequence><Script code="seen := ''"/>
      <ForEachRow file="order.csv" part="{p}" spot="{s}"><Sequence><Script code="seen := seen .. p .. '|'"/>
      <GridSpot corner="{s}" columns="1" pitch_m="0" number="0" spot="{spot}"/></Sequence></ForEachRow></Sequence>"""
    status, board = run(body, services())
    assert (status, board["seen"], str(board["spot"])) == (Status.SUCCESS, "o1|o2|", "world: 0.400 0.500 0.000")
    status, _ = run('<ForEachRow file="no.csv" part="{p}"><AlwaysSuccess/></ForEachRow>', services())
    assert status is Status.FAILURE


@pytest.mark.parametrize(
    ("text", "told"),
    [
        ("", "has no column 'part'; it has: none"),
        ("a,b\n1,2\n", "has no column 'part'; it has: a, b"),
        ("part,b\n1,2\n1\n", "order.csv:3: this row has not 2 cells"),
        ('part\n"a', ""),
    ],
)
def test_a_table_that_does_not_fit_is_told(text: str, told: str) -> None:
    if not told:
        assert rows_of(text, "order.csv", ("part",)) == [{"part": "a"}]
        return
    with pytest.raises(NodeError, match=told):
        rows_of(text, "order.csv", ("part",))


@pytest.mark.parametrize("path", ["../x", "/etc/passwd", "", "a/../../x", "a\0b", "."])
def test_files_stay_in_the_working_folder(path: str) -> None:
    with pytest.raises(NodeError):
        WorkingFolder().read(path, ListJournal())
    with pytest.raises(NodeError):
        WorkingFolder().write(path, "x", ListJournal())


def test_a_replay_reads_what_was_read_and_writes_nothing() -> None:
    journal = ListJournal()
    assert WorkingFolder().read("a.txt", journal) is None
    Path("a.txt").write_text("one")
    assert WorkingFolder().read("a.txt", journal) == "one"
    WorkingFolder().write("a.txt", "two", journal)
    assert WorkingFolder().read("a.txt", journal) == "two"
    notes = [fields for topic, fields in journal.take() if topic == "file"]
    Path("a.txt").write_text("three")
    again, files = ListJournal(), LoggedFiles(notes)
    assert files.read("a.txt", again) is None
    assert files.read("a.txt", again) == "one"
    files.write("a.txt", "two", again)
    assert files.read("a.txt", again) == "two"
    assert [fields for _, fields in again.take()] == notes
    assert Path("a.txt").read_text() == "three"


def test_values_are_saved_and_loaded_with_their_types() -> None:
    to = services()
    given: dict[str, Any] = {"n": 3, "x": 0.25, "t": "007", "b": True, "w": FramedPose.from_text("p1: 0 0 0.1; 0 0 33")}
    ports = " ".join(f'{name}="{{{name}}}"' for name in given)
    assert run(f'<SaveBlackboard file="kept/a.json" {ports}/>', to, **given)[0] is Status.SUCCESS
    status, board = run(f'<LoadBlackboard file="kept/a.json" {ports}/>', to)
    assert status is Status.SUCCESS
    assert {name: board[name] for name in given} == given
    assert type(board["b"]) is bool


def test_what_somebody_else_wrote_is_neither_loaded_nor_replaced() -> None:
    Path("mine.json").write_text(json.dumps({"entries": {"n": 1}}))
    for node in ("SaveBlackboard", "LoadBlackboard"):
        provided = {"n": 1} if node.startswith("Save") else {}
        assert run(f'<{node} file="mine.json" n="{{n}}"/>', services(), **provided)[0] is Status.FAILURE
    assert json.loads(Path("mine.json").read_text()) == {"entries": {"n": 1}}


@pytest.mark.parametrize("node", ["SaveBlackboard", "LoadBlackboard", "AppendRow"])
@pytest.mark.parametrize("name", ["a.json", "a.json.partial"])
def test_a_pipe_never_holds_up_a_tick(node: str, name: str) -> None:
    os.mkfifo(name)
    provided = {} if node == "LoadBlackboard" else {"n": 1}
    status, _ = run(f'<{node} file="a.json" n="{{n}}"/>', services(), **provided)
    fails = name == "a.json" or node == "LoadBlackboard"
    assert status is (Status.FAILURE if fails else Status.SUCCESS)


@pytest.mark.parametrize("x_m", [str(10**400), "NaN", "Infinity", '"nan"', "50", "null", "[]"])
def test_a_pose_of_a_file_that_lies_nowhere_is_the_node_s_failure(x_m: str) -> None:
    pose = f'{{"frame": "world", "position_m": [{x_m}, 0, 0], "quaternion_wxyz": [1, 0, 0, 0]}}'
    Path("a.json").write_text(f'{{"format": "cell.blackboard", "version": 1, "entries": {{"p": {pose}}}}}')
    assert run('<LoadBlackboard file="a.json" p="{p}"/>', services())[0] is Status.FAILURE


def test_half_a_character_of_a_file_is_not_loaded() -> None:
    Path("a.json").write_text('{"format": "cell.blackboard", "version": 1, "entries": {"t": "\\ud800"}}')
    assert run('<LoadBlackboard file="a.json" t="{t}"/>', services())[0] is Status.FAILURE


def test_a_text_that_no_file_can_hold_is_the_node_s_failure() -> None:
    status, _ = run('<AppendRow file="r.csv" said="{said}"/>', services(), said="half a sign: \ud800")
    assert status is Status.FAILURE
    assert not Path("r.csv").exists()
    assert not list(Path().glob("*.partial"))
    with pytest.raises(NodeError, match="surrogates not allowed"):
        LoggedFiles([]).write("r.csv", "\ud800", ListJournal())  # a replay fails where the run did


def test_rows_are_appended_under_the_names_of_their_columns() -> None:
    to = services()
    for n in (1, 2):
        assert run('<AppendRow file="r.csv" hole="p1" n="{n}"/>', to, n=n)[0] is Status.SUCCESS
    assert Path("r.csv").read_text() == "hole,n\np1,1\np1,2\n"
    assert run('<AppendRow file="r.csv" other="1"/>', to)[0] is Status.FAILURE
    assert Path("r.csv").read_text() == "hole,n\np1,1\np1,2\n"


def test_counters_begin_with_0_and_timers_follow_the_cell_s_clock() -> None:
    body = """<Sequence><CountUp count="{n}"/><CountUp count="{n}" by="2"/><CountIsReached count="{n}" limit="3"/>
      <StartTimer timer="{t}"/><Inverter><TimerIsOver timer="{t}" after_s="1"/></Inverter>
      <ReadTimer timer="{t}" elapsed_s="{e}"/></Sequence>"""
    status, board = run(body, services())
    assert (status, board["n"], board["e"]) == (Status.SUCCESS, 3, 0.0)


def test_the_last_result_is_kept_with_its_reason() -> None:
    body = '<KeepResult result="{r}" reason="{why}"><ChoosePart parts="{v}"/></KeepResult>'
    status, board = run(body, services(), v=seen_parts())
    assert (status, board["r"], board["why"]) == (Status.FAILURE, "FAILURE", "no part in the tray")


def test_the_bell_and_pictures_are_asked_for_once() -> None:
    to = services()
    assert alone(Beep("b"), services=to).execute() is Status.SUCCESS
    assert alone(Beep("b"), services=to).execute() is Status.SUCCESS
    assert to.now.display.beeps == 2
    node = alone(TakeSnapshot("s"), services=to, label="before")
    assert node.execute() is Status.RUNNING
    see(to, 0.1)
    assert node.execute() is Status.SUCCESS
    assert isinstance(to.tools.journal, ListJournal)
    assert to.tools.journal.notes[-1] == (
        "snapshot",
        {"camera": "overhead", "sequence": 0, "taken_s": 0.1, "label": "before"},
    )


def test_holes_are_read_from_a_view_that_is_newer_than_the_question() -> None:
    to = services()
    see(to, 1.0, holes={"p1": HoleView("o1", 1.0, 1.0)})
    body = """<Sequence><ReadHole position="p1" part="{seen}" upright="{up}"/>
      <GoalPart goal="g0" position="p1" part="{wanted}"/></Sequence>"""
    assert run(body, to, ticks=3)[0] is Status.RUNNING
    see(to, 2.0, holes={"p1": HoleView("o2", 1.0, 0.5, upright=False)})
    file = load_tree(Path("tree.xml"), node_registry(PRODUCT))
    file.setup(to, ManualClock())
    assert file.tick() is Status.RUNNING
    see(to, 2.1, holes={"p1": HoleView("o2", 1.0, 2.1, upright=False)})
    assert file.tick() is Status.SUCCESS
    values = file.blackboard.values()
    assert (values["seen"], values["up"], values["wanted"]) == ("o2", False, "o1")


def test_a_goal_is_taught_only_as_it_is_seen() -> None:
    taught: list[tuple[str, tuple[str, ...]]] = []

    def teach(name: str, parts: tuple[str, ...]) -> str:
        taught.append((name, parts))
        return name

    shown = dict(zip(PRODUCT.positions, ("o3", "o2", "o1", "o1", "o2", "o1"), strict=True))
    state = AssemblyState(shown)
    to = services(teach=teach)
    holes = {position: HoleView(part, 1.0, 1.0) for position, part in shown.items()}
    see(to, 1.0, holes=holes | {"p2": HoleView("o1", 1.0, 1.0)})
    node = alone(TeachGoal("t"), services=to, name_given="new", state=state)
    assert node.execute() is Status.FAILURE
    assert node.feedback_message == "p2 is not sure: o2 is believed there"
    see(to, 2.0, holes=holes)
    assert node.execute() is Status.SUCCESS
    assert taught == [("new", tuple(shown.values()))]
    to.tools = replace(to.tools, teach=None)
    assert node.execute() is Status.FAILURE


@pytest.mark.parametrize(
    ("node", "told"),
    [
        ('<OpenGripper opening_m="0.5"/>', "opening_m is 0.5; the gripper takes 0 to 0.085"),
        ('<CloseGripper force_n="5"/>', "force_n is 5; the gripper takes 20 to 235"),
        ('<SetGripForce force_n="50"/>', "the gripper holds nothing"),
        ('<MoveToJoints joints_deg="0;0"/>', "the arm has 6 joints, not 2"),
        ('<MoveUntilContact by="world: 0 0 -0.1" speed_m_s="0.5"/>', "more than 0 and at most 0.05"),
        ('<PutDown part="o1" spot="p2: 0 0 0"/>', "PlacePart puts parts there, behind its guard"),
        ('<PutDown part="o1" spot="bracket: 0 0 0"/>', "PlacePart puts parts there, behind its guard"),
    ],
)
def test_what_devices_cannot_do_is_a_failure_with_its_reason(node: str, told: str) -> None:
    to = services()
    file = Path("tree.xml")
    file.write_text(f'<root BTCPP_format="4"><BehaviorTree ID="Main">{node}</BehaviorTree></root>')
    tree = load_tree(file, node_registry(PRODUCT))
    tree.setup(to, ManualClock())
    assert tree.tick() is Status.FAILURE
    assert told in tree.root.feedback_message


def test_nothing_is_let_go_over_the_bracket(monkeypatch: pytest.MonkeyPatch) -> None:
    to = services()
    to.now.observation = replace(to.now.observation, gripper=HOLDING)
    monkeypatch.setattr("bracket_cell.trees.nodes.arm.tool_pose", lambda to: to.tools.bench.bracket.pose)
    status, _ = run("<OpenGripper/>", to)
    assert status is Status.FAILURE


def test_an_operator_may_answer_in_words_of_their_own() -> None:
    to = services()
    file = Path("tree.xml")
    body = '<AskOperator text="which batch?" answers="" wait_s="0" answer="{a}"/>'
    file.write_text(f'<root BTCPP_format="4"><BehaviorTree ID="Main">{body}</BehaviorTree></root>')
    tree = load_tree(file, node_registry(PRODUCT))
    tree.setup(to, ManualClock())
    assert tree.tick() is Status.RUNNING
    (question,) = to.now.display.questions
    assert (question.kind, question.answers) == ("text", ())
    said = OperatorOrder("answer", "Batch 7b", question.number)
    to.now.observation = replace(to.now.observation, operator=OperatorState(said=(said,)))
    assert tree.tick() is Status.SUCCESS
    assert tree.blackboard.values()["a"] == "Batch 7b"


def test_an_operator_is_asked_and_answered_or_not_in_time() -> None:
    to = services()
    body = '<AskOperator text="ready?" answers="yes;no" wait_s="5" answer="{a}"/>'
    file = Path("tree.xml")
    file.write_text(f'<root BTCPP_format="4"><BehaviorTree ID="Main">{body}</BehaviorTree></root>')
    tree = load_tree(file, node_registry(PRODUCT))
    tree.setup(to, ManualClock())
    assert tree.tick() is Status.RUNNING
    (question,) = to.now.display.questions
    assert ([answer.value for answer in question.answers], to.now.display.help_request) == (["yes", "no"], "ready?")
    said = OperatorOrder("answer", "no", question.number)
    to.now.observation = replace(to.now.observation, operator=OperatorState(said=(said,)))
    assert tree.tick() is Status.SUCCESS
    assert tree.blackboard.values()["a"] == "no"
    assert (to.now.display.questions, to.now.display.help_request) == ((), None)
    assert tree.tick() is Status.RUNNING  # a new question, which the old answer does not answer
    see(to, 6.0)
    assert tree.tick() is Status.FAILURE
    assert tree.root.feedback_message == "nobody answered within 5 s"
    assert tree.tick() is Status.RUNNING
    tree.halt()
    assert to.now.display.questions == ()
