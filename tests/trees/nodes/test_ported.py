"""Nodes by the names and ports of Nav2 and MoveIt Pro."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from bracket_cell.skills.motion.planner import MotionPlanner
from bracket_cell.skills.move_to import FollowPlan
from bracket_cell.trees.bench import TreeBench
from bracket_cell.trees.loading import load_tree
from bracket_cell.trees.node_library import node_registry
from bracket_cell.trees.nodes.ported.moveit_pro import PlannedMove
from bracket_cell.trees.nodes.poses import FramedPose
from bracket_ground.errors import InputError
from bracket_ground.interfaces.clock import ManualClock
from bracket_ground.interfaces.command import Command, JointTrajectory
from bracket_ground.interfaces.operator import OperatorOrder, OperatorState
from bracket_ground.interfaces.pose import Pose
from btxml.engine.errors import NodeError
from btxml.engine.status import Status
from btxml.testing import alone, assert_ticks
from tests.trees.nodes.rig import BENCH, CONFIGURATION, PRODUCT, services

Write = Callable[[str], Path]
PERIOD_S = 0.04
NODES = node_registry().classes


@pytest.fixture
def write(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Write:
    """A tree file in the working folder; `a` to `c` stand for leaves of these names."""
    monkeypatch.chdir(tmp_path)

    def written(body: str) -> Path:
        for name in "abc":
            body = body.replace(f"<{name}/>", f'<TakeSnapshot name="{name}"/>')
        file = tmp_path / "tree.xml"
        file.write_text(f'<root BTCPP_format="4"><BehaviorTree ID="Main">{body}</BehaviorTree></root>')
        return file

    return written


def order(bench: TreeBench) -> str:
    """Which leaves were begun, and in capitals which were halted."""
    letters = {"start": str.lower, "halt": str.upper}
    told = (event.split() for event in bench.events)
    return "".join(letters[what](name) for what, name in told if what in letters)


@pytest.mark.parametrize(
    ("node", "answers", "ticks", "begun"),
    [
        ('<RecoveryNode number_of_retries="1"><a/><b/></RecoveryNode>', {"a": "FS"}, "S", "aba"),
        ("<RecoveryNode><a/><b/></RecoveryNode>", {"a": "RFRS", "b": "RS"}, "RRRS", "aba"),
        ("<RecoveryNode><a/><b/></RecoveryNode>", {"a": "F"}, "F", "aba"),
        ('<RecoveryNode number_of_retries="3"><a/><b/></RecoveryNode>', {"a": "F"}, "RRF", "abababa"),
        ("<RecoveryNode><a/><b/></RecoveryNode>", {"a": "F", "b": "F"}, "F", "ab"),
        ("<RecoveryNode><a/><b/></RecoveryNode>", {"a": "F", "b": "K"}, "F", "ab"),
        ("<RecoveryNode><a/><b/></RecoveryNode>", {"b": "R"}, "S", "a"),
        ("<RoundRobin><a/><b/><c/></RoundRobin>", {"a": "FR", "b": "S", "c": "S"}, "SSR", "abca"),
        ("<RoundRobin><a/><b/><c/></RoundRobin>", {"a": "F", "b": "F", "c": "F"}, "F", "abc"),
        ("<RoundRobin><a/><b/></RoundRobin>", {"a": "S", "b": "F"}, "SF", "ab"),
        ('<RoundRobin wrap_around="true"><a/><b/></RoundRobin>', {"a": "S", "b": "F"}, "SS", "aba"),
        ("<RoundRobin><a/><b/></RoundRobin>", {"a": "K", "b": "K"}, "K", "ab"),
        ("<PipelineSequence><a/><b/><c/></PipelineSequence>", {"b": "RRS", "c": "RS"}, "RRRS", "abaacab"),
        ("<PipelineSequence><a/><b/></PipelineSequence>", {"a": "SRR", "b": "RRS"}, "RRS", "abaA"),
        ("<PipelineSequence><a/><b/></PipelineSequence>", {"a": "SF", "b": "R"}, "RF", "abaB"),
        ("<PipelineSequence><a/><b/></PipelineSequence>", {"a": "K", "b": "K"}, "K", "ab"),
    ],
)
def test_nav2_controls(write: Write, node: str, answers: dict[str, str], ticks: str, begun: str) -> None:
    bench = TreeBench(write(node), answers)
    assert_ticks(bench, ticks)
    assert order(bench) == begun


def test_a_recovery_that_is_never_needed_is_told(write: Write) -> None:
    with pytest.raises(InputError, match="is never ticked"):
        TreeBench(write("<RecoveryNode><AlwaysSuccess/><Beep/></RecoveryNode>"))


def test_two_that_move_the_arm_in_a_pipeline_are_refused(write: Write) -> None:
    two = '<PipelineSequence><MoveTo pose="park"/><MoveTo pose="look"/></PipelineSequence>'
    with pytest.raises(InputError, match="commands the arm while MoveTo may"):
        load_tree(write(two), node_registry())


def test_a_rate_is_kept_between_ends_and_a_child_that_runs_is_always_ticked(write: Write) -> None:
    body = '<PipelineSequence><RateController hz="5"><a/></RateController><b/></PipelineSequence>'
    bench = TreeBench(write(body), {"a": "SRRS", "b": "R"})
    assert_ticks(bench, "R" * 16, PERIOD_S)
    ticked = [number for number in range(16) if "tick a" in ticks_of(bench)[number]]
    assert ticked == [0, 5, 6, 7, 12]


def ticks_of(bench: TreeBench) -> list[list[str]]:
    """Events by tick, each of which ends with that of `b`."""
    ticks: list[list[str]] = [[]]
    for event in bench.events:
        ticks[-1].append(event)
        if event == "tick b":
            ticks.append([])
    return ticks


@pytest.mark.parametrize(("speed_m_s", "pause_s"), [(0.0, 2.0), (0.25, 1.0), (0.5, 2 / 3), (3.0, 2 / 3)])
def test_the_faster_the_tool_the_higher_the_rate(write: Write, speed_m_s: float, pause_s: float) -> None:
    moving = services(motion=SimpleNamespace(kinematics=SimpleNamespace(position_m=lambda joints: joints[:3])))
    arm = replace(moving.now.observation.arm, velocities_rad_s=(speed_m_s, 0.0, 0.0, 0.0, 0.0, 0.0))
    moving.now.observation = replace(moving.now.observation, arm=arm)
    body = '<SpeedController min_rate="0.5" max_rate="1.5"><a/></SpeedController>'
    bench = TreeBench(write(f"<PipelineSequence>{body}<b/></PipelineSequence>"), {"b": "R"}, services=moving)
    for _ in range(200):
        bench.tick(PERIOD_S)
    begun = [number * PERIOD_S for number, events in enumerate(ticks_of(bench)) if "start a" in events]
    assert begun[1] - begun[0] == pytest.approx(2 / 3, abs=2 * PERIOD_S)
    assert begun[3] - begun[2] == pytest.approx(pause_s, abs=2 * PERIOD_S)
    assert begun[0] == 0


def test_poses_are_collected_and_gone_through(write: Write) -> None:
    body = """<Sequence><ResetPoseStampedVector vector="{v}"/>
      <AddPoseStampedToVector input="tray: 0 0 0.1; 0 0 90" vector="{v}"/>
      <OffsetPose input_pose="tray: 0 0 0.1; 0 0 90" translation_xyz="0.1;0;0" output_pose="{p}"/>
      <AddPoseStampedToVector input="{p}" vector="{v}"/>
      <ForEach vector_in="{v}" out="{q}" index="{i}"><CountUp count="{n}"/></ForEach></Sequence>"""
    tree = load_tree(write(body), node_registry())
    tree.setup(services(), ManualClock())
    while tree.tick() is Status.RUNNING:
        pass
    board = dict(tree.blackboard.values())
    assert (board["n"], board["i"], len(board["v"])) == (2, 1, 2)
    assert board["v"][1] == board["q"]
    assert (board["q"].frame, board["q"].pose.position_m) == ("tray", pytest.approx((0.0, 0.1, 0.1)))


def test_what_is_no_list_no_turn_and_no_offset_is_told() -> None:
    pose = FramedPose("tray", Pose((0.0, 0.0, 0.0)))
    each: Any = NODES["ForEach"]
    for values in ({"quaternion_xyzw": [0.0, 0.0, 0.0]}, {"quaternion_xyzw": [0.0] * 4}, {"translation_xyz": [1.0]}):
        node = alone(NODES["TransformPose"]("t"), services(), input_pose=pose, **values)  # type: ignore[arg-type]
        assert node.execute() is Status.FAILURE
        assert "numbers" in node.feedback_message or "norm" in node.feedback_message
    with pytest.raises(NodeError, match="is a str, not a list"):
        alone(each("e", [NODES["Beep"]("b")]), services(), vector_in="a;b").items()  # type: ignore[attr-defined]


def test_a_waypoint_is_saved_and_found_again(write: Write) -> None:
    write("<Beep/>")
    to = services()
    for name in ("home", "bin"):
        assert alone(NODES["SaveWaypoint"]("s"), to, waypoint_name=name).execute() is Status.SUCCESS  # type: ignore[arg-type]
    node: Any = alone(NODES["RetrieveWaypoint"]("r"), to, waypoint_name="home")  # type: ignore[arg-type]
    assert node.execute() is Status.SUCCESS
    assert node.waypoint_joint_state.entry.value == [0.0] * 6
    lost = alone(NODES["RetrieveWaypoint"]("r"), to, waypoint_name="hom")  # type: ignore[arg-type]
    assert lost.execute() is Status.FAILURE
    assert lost.feedback_message == "waypoints.json has no waypoint 'hom'; it has: home, bin"


@pytest.fixture(scope="module")
def planner() -> MotionPlanner:
    return MotionPlanner(PRODUCT, BENCH, CONFIGURATION.motion)


@pytest.mark.parametrize("said", ["approve", "reject", ""])
def test_a_plan_is_approved_or_not(said: str) -> None:
    kinematics = SimpleNamespace(position_m=lambda joints: joints[:3])
    to = services(motion=SimpleNamespace(kinematics=kinematics))
    path = JointTrajectory(np.array([0.0, 2.0]), np.array([[0.0] * 6, [0.5, 0.0, 0.2, 0.0, 0.0, 0.0]]))
    node = alone(NODES["WaitForUserTrajectoryApproval"]("w"), to, solution=PlannedMove(path, "the tray"))  # type: ignore[arg-type]
    assert node.execute() is Status.RUNNING
    (question,) = to.now.display.questions
    assert question.reason == "May the tool move to the tray? 0.54 m in 2.0 s, at most 0.27 m/s, lowest at 0.00 m"
    answers = (OperatorOrder("answer", said, question.number),) if said else ()
    to.now.observation = replace(to.now.observation, time_s=61.0, operator=OperatorState(said=answers))
    assert node.execute() is (Status.SUCCESS if said == "approve" else Status.FAILURE)
    assert to.now.display.questions == ()


def test_an_approved_plan_is_followed_and_no_other(planner: MotionPlanner) -> None:
    to = services(motion=planner)
    arm = replace(to.now.observation.arm, positions_rad=tuple(BENCH.arm_park_rad))
    to.now.observation = replace(to.now.observation, arm=arm)
    pose = FramedPose.from_text("tray: 0 0 0.3")
    node: Any = alone(NODES["PlanToPose"]("p"), to, pose=pose)  # type: ignore[arg-type]
    assert node.execute() is Status.SUCCESS, node.feedback_message
    plan = node.solution.entry.value.trajectory
    assert to.now.command.follow is None
    for start, moves in ((BENCH.arm_park_rad, True), (BENCH.arm_look_rad, False)):
        seen = replace(to.now.observation, arm=replace(arm, positions_rad=tuple(start)))
        command = Command()
        told = FollowPlan(planner, "there", approved=plan).poll(seen, command)
        assert (command.follow is not None) is moves, told.reason
        assert moves or "not the one that was planned" in told.reason
