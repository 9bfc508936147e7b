"""Where the tool is, whether it is at a pose, and straight moves from there; every shipped leaf is run somewhere."""

from __future__ import annotations

import re
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from bracket_cell.skills.motion.planner import MotionPlanner
from bracket_cell.trees.node_library import node_registry
from bracket_cell.trees.nodes.poses import FramedPose
from bracket_cell.trees.nodes.services import Services
from bracket_ground.interfaces.command import Command
from bracket_ground.interfaces.operator import OperatorOrder, OperatorState
from btxml.engine.node import Node
from btxml.engine.status import Status
from btxml.testing import alone
from tests.trees.nodes.rig import BENCH, CONFIGURATION, PRODUCT, ROOT, services

REGISTRY = node_registry()
NODES = REGISTRY.classes


def test_every_shipped_leaf_is_run_by_a_test_or_a_shipped_tree() -> None:
    own = {name for name, node in NODES.items() if node.__module__.startswith("bracket_cell.")}
    files = [*(ROOT / "tests").rglob("*.py"), *(ROOT / "tests").rglob("*.xml"), *(ROOT / "trees").rglob("*.xml")]
    words = set(re.findall(r"\w+", "".join(file.read_text() for file in files)))
    assert own - words == set()


@pytest.fixture(scope="module")
def planner() -> MotionPlanner:
    return MotionPlanner(PRODUCT, BENCH, CONFIGURATION.motion)


@pytest.fixture
def parked(planner: MotionPlanner) -> Services:
    to = services(motion=planner)
    arm = replace(to.now.observation.arm, positions_rad=tuple(BENCH.arm_park_rad))
    to.now.observation = replace(to.now.observation, arm=arm)
    return to


def leaf(name: str, to: Services, **ports: Any) -> Node:
    return alone(NODES[name]("leaf"), to, **ports)  # type: ignore[arg-type]


def refused(node: Node) -> str:
    """Why a leaf fails at once."""
    assert node.execute() is Status.FAILURE
    return node.feedback_message


def test_the_tool_is_where_it_was_said_to_be(parked: Services) -> None:
    node: Any = leaf("GetToolPose", parked)
    assert node.execute() is Status.SUCCESS
    here: FramedPose = node.pose.entry.value
    assert leaf("ToolIsAt", parked, pose=here).execute() is Status.SUCCESS
    beside = FramedPose(here.frame, replace(here.pose, position_m=tuple(np.add(here.pose.position_m, (0, 0.008, 0)))))
    off = leaf("ToolIsAt", parked, pose=beside)
    assert off.execute() is Status.FAILURE
    assert off.feedback_message == "8.0 mm and 0.0 degrees off"
    assert leaf("ToolIsAt", parked, pose=beside, within_m=0.01).execute() is Status.SUCCESS
    assert "always at a pose of its own frame" in refused(
        leaf("ToolIsAt", parked, pose=FramedPose.from_text("tool: 0 0 0"))
    )


@pytest.mark.parametrize("by", ["world: 0 0 0.05", "tool: 0 0 0.05"])
def test_a_straight_move_ends_where_it_says(parked: Services, by: str) -> None:
    kinematics = parked.tools.motion.kinematics
    before = np.array(kinematics.position_m(np.array(BENCH.arm_park_rad)))
    assert leaf("MoveBy", parked, by=FramedPose.from_text(by)).execute() is Status.RUNNING
    path = parked.now.command.follow
    assert path is not None
    ways = np.array([kinematics.position_m(joints) for joints in path.positions_rad]) - before
    assert ways[-1] == pytest.approx((0, 0, 0.05), abs=1e-3)
    assert np.abs(ways[:, :2]).max() < 1e-3, "a straight line"


@pytest.mark.parametrize("speed_m_s", [0.0, 9.0])
def test_a_speed_beyond_the_limit_is_refused(parked: Services, speed_m_s: float) -> None:
    node = leaf("MoveBy", parked, by=FramedPose.from_text("world: 0 0 0.05"), speed_m_s=speed_m_s)
    assert f"speed_m_s is {speed_m_s:g}; more than 0 and at most" in refused(node)


def test_an_approved_plan_is_followed(parked: Services) -> None:
    node: Any = leaf("PlanToPose", parked, pose=FramedPose.from_text("tray: 0 0 0.3"))
    assert node.execute() is Status.SUCCESS, node.feedback_message
    plan = node.solution.entry.value
    parked.now.command = Command()
    assert leaf("ExecuteTrajectory", parked, solution=plan).execute() is Status.RUNNING
    assert parked.now.command.follow is not None


@pytest.mark.parametrize(("said", "ends"), [("approve", Status.SUCCESS), ("reject", Status.FAILURE)])
def test_a_path_is_approved_or_not(parked: Services, said: str, ends: Status) -> None:
    path = [FramedPose.from_text(f"tray: 0 0 {z}") for z in (0.3, 0.2)]
    node = leaf("ApprovePath", parked, path=path)
    assert node.execute() is Status.RUNNING
    (question,) = parked.now.display.questions
    assert "2 poses, 0.10 m, lowest at 0.20 m" in question.reason
    answer = OperatorState(said=(OperatorOrder("answer", said, question.number),))
    parked.now.observation = replace(parked.now.observation, operator=answer)
    assert node.execute() is ends
    assert "the path has no pose" in refused(leaf("ApprovePath", parked, path=[]))
