"""Poses in tree files: what is written is what is meant, and what is no pose is told."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest

from bracket_cell.trees.node_library import node_registry
from bracket_cell.trees.nodes.poses import FramedPose
from btxml.engine.literals import LiteralError, converted, from_text
from btxml.files.check import findings
from tests.trees.nodes.rig import PRODUCT


def test_a_pose_is_a_frame_metres_and_degrees() -> None:
    pose = FramedPose.from_text("tray: 0.1 -0.2 0.05; 0 0 90")
    assert pose.frame == "tray"
    assert pose.pose.position_m == (0.1, -0.2, 0.05)
    assert math.degrees(pose.pose.yaw_rad) == pytest.approx(90.0)
    assert FramedPose.from_text("p3: 0 0 0").pose.quaternion_wxyz == (1.0, 0.0, 0.0, 0.0)


def test_turns_are_about_the_fixed_axes_x_then_y_then_z() -> None:
    x_axis, _, z_axis = FramedPose.from_text("world: 0 0 0; 90 0 90").pose.rotation.T
    np.testing.assert_allclose(x_axis, (0, 1, 0), atol=1e-12)
    np.testing.assert_allclose(z_axis, (1, 0, 0), atol=1e-12)


@pytest.mark.parametrize(
    "text", ["", "0 0 0", "tray:", "tray: 1 2", "tray: 1 2 x", "tray: 1 2 nan", "tray: 1 2 99", "tray: 0 0 0; 0 90"]
)
def test_what_is_no_pose_is_told_with_one_that_is(text: str) -> None:
    with pytest.raises(LiteralError) as caught:
        from_text(text, FramedPose)
    assert "like 'tray: 0.1 0.0 0.05; 0 0 90'" in caught.value.legal


def test_texts_of_scripts_and_tables_become_poses() -> None:
    assert converted("p1: 0 0 0", FramedPose) == FramedPose.from_text("p1: 0 0 0")


@pytest.mark.parametrize(
    ("node", "told"),
    [
        ('<MoveToPose pose="table: 0 0 0.2"/>', "the cell has no frame 'table'; one of world, tray, bracket, tool, p1"),
        ('<MoveToPose pose="tray 0 0 0.2"/>', "is not a valid FramedPose: the frame is missing"),
        ('<GoalPart goal="g9" position="p1"/>', "the product has no goal 'g9'; one of g0, g1, g2"),
    ],
)
def test_check_knows_frames_and_goals(tmp_path: Path, node: str, told: str) -> None:
    file = tmp_path / "tree.xml"
    file.write_text(f'<root BTCPP_format="4"><BehaviorTree ID="Main">{node}</BehaviorTree></root>')
    problems, _, _ = findings([file], node_registry(PRODUCT))
    assert [told in str(problem) for problem in problems] == [True], problems
