"""Shapes for drawing are closed, and move as kinematics say."""

from __future__ import annotations

from collections import Counter
from functools import reduce
from operator import matmul

import numpy as np
import pytest

from bracket_cell.skills.motion.outline import BASE, chain
from bracket_cell.skills.motion.planner import MotionPlanner


def test_the_chain_leads_from_base_to_wrist(planner: MotionPlanner) -> None:
    joints = chain(planner.kinematics.model)
    assert [joint.parent for joint in joints] == [BASE, *(joint.child for joint in joints[:-1])]
    wrist = reduce(matmul, (joint.parent_from_child for joint in joints))
    tool = planner.kinematics.forward(np.zeros(6))
    flange_m = np.linalg.norm(np.subtract(tool.position_m, wrist.position_m))
    assert flange_m == pytest.approx(0.0922 + planner.settings.robot.gripper.tcp_from_flange_m, abs=1e-4)


def test_hulls_are_closed_surfaces(planner: MotionPlanner) -> None:
    hulls = [shape for shape in planner.robot_shapes if shape.box_m is None]
    assert len(hulls) == 7
    for shape in hulls:
        edges = Counter(
            frozenset(pair)
            for triangle in shape.triangles.tolist()
            for pair in zip(triangle, [*triangle[1:], triangle[0]], strict=True)
        )
        assert set(edges.values()) == {2}, f"{shape.name} has a hole"


def test_every_shape_moves_with_a_link_of_the_chain(planner: MotionPlanner) -> None:
    links = {BASE, *(joint.child for joint in chain(planner.kinematics.model))}
    assert {shape.frame for shape in planner.robot_shapes} <= links
    assert {"palm", "finger_left", "finger_right", "camera"} <= {shape.name for shape in planner.robot_shapes}
