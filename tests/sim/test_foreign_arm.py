"""Arms whose descriptions have names of the scene: in the simulator they stand where the controller believes."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from bracket_cell.configuration import load_configuration, load_product
from bracket_cell.skills.motion.kinematics import Kinematics
from bracket_cell.skills.motion.settings import MotionSettings
from bracket_ground.interfaces.robot import load_robot
from bracket_sim.scene.robot import arm_spec
from bracket_sim.scene.world import build_world
from tests.arms import robot_file

MOUNT = "mount: {position_m: [0.2, -0.1, 0.05], quaternion_wxyz: [0.7071067811865476, 0, 0, 0.7071067811865476]}\n"
WORLD = {"foot": "world"}
NAMES = {"l0": "hand", "l1": "tray", "l2": "tool", "l3": "bracket"}

PYRAMID = """ply
format ascii 1.0
element vertex 4
property float x
property float y
property float z
element face 4
property list uchar int vertex_indices
end_header
0 0 0
0.1 0 0
0 0.1 0
0 0 0.1
3 0 2 1
3 0 1 3
3 0 3 2
3 1 2 3
"""
NO_BODY = '<inertial><mass value="{}"/><inertia ixx="0" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial>'


@pytest.mark.parametrize("names", [{}, WORLD, NAMES])
@pytest.mark.parametrize("mount", ["", MOUNT])
def test_the_tool_is_where_the_controller_believes(tmp_path: Path, names: dict[str, str], mount: str) -> None:
    file = robot_file(tmp_path, "one_sided", mount)
    urdf = file.with_suffix(".urdf")
    text = urdf.read_text()
    for old, new in names.items():
        text = text.replace(f'"{old}"', f'"{new}"')
    urdf.write_text(text)
    robot, configuration = load_robot(file.name, tmp_path), load_configuration()
    world = build_world(load_product(configuration), configuration.bench, (), robot=robot)
    joints = np.array([0.4, -0.3, 0.5, 0.2, 0.6, -0.1])
    world.set_arm(joints)
    believed, true = Kinematics(MotionSettings().of(robot)).forward(joints), world.tool_pose()
    assert true.position_m == pytest.approx(believed.position_m, abs=1e-6)
    assert np.allclose(true.rotation, believed.rotation, atol=1e-6)


def test_a_mesh_of_a_format_that_the_simulator_lacks_is_simulated(tmp_path: Path) -> None:
    file = robot_file(tmp_path, "one_sided")
    (tmp_path / "pyramid.ply").write_text(PYRAMID)
    urdf = file.with_suffix(".urdf")
    shape = '<link name="l0"><collision><geometry><mesh filename="pyramid.ply" scale="2 2 2"/></geometry></collision>'
    urdf.write_text(urdf.read_text().replace('<link name="l0">', shape))
    model = arm_spec(load_robot(file.name, tmp_path)).compile()
    assert model.mesh_vertnum.tolist() == [4]
    assert np.ptp(model.mesh_vert, axis=0).max() >= 0.2


@pytest.mark.parametrize("mass", [0, 1])
def test_an_inertia_that_no_body_has_is_simulated(mass: int, tmp_path: Path) -> None:
    file = robot_file(tmp_path, "one_sided")
    urdf = file.with_suffix(".urdf")
    urdf.write_text(urdf.read_text().replace('<link name="l0">', f'<link name="l0">{NO_BODY.format(mass)}'))
    model = arm_spec(load_robot(file.name, tmp_path)).compile()
    assert model.body("arm l0").mass[0] >= mass
    assert (model.body_inertia[1:] >= 0).all()
    assert model.body("arm l0").inertia.min() > 0
