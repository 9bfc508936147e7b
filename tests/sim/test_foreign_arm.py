"""Arms whose descriptions have names of the scene: in the simulator they stand where the controller believes."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from bracket_cell.configuration import load_configuration, load_product
from bracket_cell.skills.motion.kinematics import Kinematics
from bracket_cell.skills.motion.settings import MotionSettings
from bracket_ground.errors import SettingError
from bracket_ground.interfaces.command import JointTrajectory
from bracket_ground.interfaces.pose import Array
from bracket_ground.interfaces.robot import RobotModel, load_robot
from bracket_sim.devices.arm import SimArm
from bracket_sim.scene.robot import arm_spec
from bracket_sim.scene.world import World, build_world
from tests.arms import ONE_SIDED, robot_file

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


def world_of(robot: RobotModel) -> World:
    configuration = load_configuration()
    return build_world(load_product(configuration), configuration.bench, (), robot=robot)


@pytest.mark.parametrize("names", [{}, WORLD, NAMES])
@pytest.mark.parametrize("mount", ["", MOUNT])
def test_the_tool_is_where_the_controller_believes(tmp_path: Path, names: dict[str, str], mount: str) -> None:
    file = robot_file(tmp_path, "one_sided", mount)
    urdf = file.with_suffix(".urdf")
    text = urdf.read_text()
    for old, new in names.items():
        text = text.replace(f'"{old}"', f'"{new}"')
    urdf.write_text(text)
    robot = load_robot(file.name, tmp_path)
    world = world_of(robot)
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


@pytest.mark.parametrize("radius_m", [0.05, 0.2])
@pytest.mark.parametrize(("effort_nm", "wrist"), [(0, ""), (2000, ""), (2000, 'velocity="9" effort="9"')])
def test_an_arm_follows_however_heavy_or_quick_it_is(
    effort_nm: int, wrist: str, radius_m: float, tmp_path: Path
) -> None:
    file = robot_file(tmp_path, "one_sided")
    text = replace(ONE_SIDED, radius_m=radius_m).urdf().replace('effort="120"', f'effort="{effort_nm}"')
    before, usual, after = text.rpartition(f'velocity="2.2" effort="{effort_nm}"')
    file.with_suffix(".urdf").write_text(before + (wrist or usual) + after)
    robot = load_robot(file.name, tmp_path)
    world = world_of(robot)
    arm, period_s = SimArm(world), world.physics.control_period_s
    start = Kinematics(MotionSettings().of(robot)).usual_rad
    arm.stand_at(start)
    world.step_period()
    times: Array = np.linspace(0.0, 1.0, round(1 / period_s) + 1)  # faster, then slower
    ways = np.where(times < 0.5, times**2 / 2, 0.25 - (1 - times) ** 2 / 2)
    arm.follow(
        JointTrajectory(times, start - np.outer(ways, robot.acceleration_rad_s2 * np.array([1, 1, 0, 1, 0, -1])))
    )
    off = []
    for time_s in times:
        arm.pace(1.0)
        arm.update(float(time_s), period_s)
        world.step_period()
        off.append(arm.tracking_error_rad)
    assert arm.state().mode == "normal", arm.state()
    assert max(off) < 0.02


@pytest.mark.parametrize(("name", "unit"), [("one_sided", "N m"), ("on_axis", "N")])
def test_an_arm_that_is_too_weak_for_its_own_mass_is_refused(name: str, unit: str, tmp_path: Path) -> None:
    torques = [1, *[200] * 5, *[200] * (name == "on_axis")]
    file = robot_file(tmp_path, name, f"torque_nm: {torques}\n")
    with pytest.raises(SettingError, match=rf"robot: too weak .*: ax0 has 1 {unit} and needs .* torque_nm, or less"):
        arm_spec(load_robot(file.name, tmp_path))
