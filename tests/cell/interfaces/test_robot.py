"""One robot model: kinematics, simulator, checked arm and supervisor read the same figures."""

from __future__ import annotations

import shutil
from pathlib import Path

import mujoco
import numpy as np
import pytest

from bracket_cell.configuration import load_configuration, load_product
from bracket_cell.runs.heading import robot_files
from bracket_cell.skills.motion.kinematics import Kinematics
from bracket_cell.skills.motion.settings import MotionSettings
from bracket_ground.errors import InputError
from bracket_ground.interfaces.pose import Array
from bracket_ground.interfaces.robot import FOLDER, Calibration, default_robot, load_robot, shipped_robots
from bracket_sim.scene.world import build_world
from tests.cell.conftest import changed_configuration

CONFIGURATION = load_configuration()
PARK = np.array(CONFIGURATION.bench.arm_park_rad)
UR10E_DH = {"a": (0.0, -0.6127, -0.57155, 0.0, 0.0, 0.0), "d": (0.1807, 0.0, 0.0, 0.17415, 0.11985, 0.11655)}
UR10_DH = {"a": (0.0, -0.612, -0.5723, 0.0, 0.0, 0.0), "d": (0.1273, 0.0, 0.0, 0.163941, 0.1157, 0.0922)}
TWISTS_RAD = (np.pi / 2, 0.0, 0.0, np.pi / 2, -np.pi / 2, 0.0)


def by_denavit_hartenberg(joints_rad: Array) -> Array:
    """Flange (4, 4) of a UR10e as its maker's table has it; that base is turned by half a turn against the URDF's."""
    pose = np.diag([-1.0, -1.0, 1.0, 1.0])
    for angle, a, d, twist in zip(joints_rad, UR10E_DH["a"], UR10E_DH["d"], TWISTS_RAD, strict=True):
        c, s, ct, st = np.cos(angle), np.sin(angle), np.cos(twist), np.sin(twist)
        pose = pose @ np.array([[c, -s * ct, s * st, a * c], [s, c * ct, -c * st, a * s], [0, st, ct, d], [0, 0, 0, 1]])
    return pose


def kinematics(name: str) -> Kinematics:
    return Kinematics(MotionSettings().of(load_robot(name)))


@pytest.mark.parametrize("seed", range(5))
def test_the_ur10e_stands_where_its_makers_table_says(seed: int) -> None:
    joints = np.random.default_rng(seed).uniform(-3, 3, 6)
    arm = kinematics("ur10e")
    flange = arm.forward(joints).matrix[:3, 3] - 0.156 * arm.forward(joints).matrix[:3, 2]
    np.testing.assert_allclose(flange, by_denavit_hartenberg(joints)[:3, 3], atol=1e-6)


@pytest.mark.parametrize("name", ["ur10", "ur10e"])
@pytest.mark.parametrize("cancels_m", [0.0, 20.0])
def test_an_arm_with_its_own_calibration_stands_where_its_rows_say(name: str, cancels_m: float) -> None:
    """Rows of the parallel joints may tell of metres that cancel; the links stay where they are all the same."""
    rng, nominal = np.random.default_rng(3), UR10_DH if name == "ur10" else UR10E_DH
    a_m, d_m, theta = np.array(nominal["a"]) + rng.normal(0, 4e-4, 6), np.array(nominal["d"]), rng.normal(0, 1e-3, 6)
    d_m = d_m + rng.normal(0, 4e-4, 6) + np.array([0, cancels_m, -0.4 * cancels_m, -0.6 * cancels_m, 0, 0])
    alpha = np.array(TWISTS_RAD) + rng.normal(0, 1e-3, 6) * (cancels_m == 0)
    rows = dict(zip(("theta_rad", "a_m", "d_m", "alpha_rad"), (theta, a_m, d_m, alpha), strict=True))
    calibration = Calibration.model_validate({key: values.tolist() for key, values in rows.items()})
    robot = load_robot(name).model_copy(update={"calibration": calibration})
    arm, joints = Kinematics(MotionSettings().of(robot)), rng.uniform(-3, 3, 6)
    tool = arm.forward(joints).matrix
    pose = np.diag([-1.0, -1.0, 1.0, 1.0])
    for angle, a, d, twist in zip(joints + theta, a_m, d_m, alpha, strict=True):
        c, s, ct, st = np.cos(angle), np.sin(angle), np.cos(twist), np.sin(twist)
        pose = pose @ np.array([[c, -s * ct, s * st, a * c], [s, c * ct, -c * st, a * s], [0, st, ct, d], [0, 0, 0, 1]])
    np.testing.assert_allclose(tool[:3, 3], pose[:3, 3] + 0.156 * pose[:3, 2], atol=1e-9)
    np.testing.assert_allclose(tool[:3, :3], pose[:3, :3], atol=1e-9)
    for own, makers in zip(arm.model.jointPlacements, kinematics(name).model.jointPlacements, strict=True):
        assert np.linalg.norm(own.translation - makers.translation) < 0.01


def test_the_calibration_of_another_kind_of_arm_is_refused() -> None:
    rows = {"theta_rad": [0.0] * 6, "a_m": [0.0] * 6, "d_m": [0.1] * 6, "alpha_rad": [0.5] * 6}
    robot = load_robot("ur10").model_copy(update={"calibration": Calibration.model_validate(rows)})
    with pytest.raises(ValueError, match="not one of such an arm"):
        assert robot.urdf_text


def test_another_robot_of_the_same_joints_stands_elsewhere() -> None:
    ur10, ur10e = (kinematics(name).position_m(PARK) for name in ("ur10", "ur10e"))
    assert 0.02 < np.linalg.norm(ur10 - ur10e) < 0.05


@pytest.mark.parametrize("name", shipped_robots())
def test_simulator_and_planner_have_the_same_arm(name: str) -> None:
    world = build_world(load_product(CONFIGURATION), CONFIGURATION.bench, (), robot=load_robot(name))
    world.data.qpos[:6] = PARK
    mujoco.mj_forward(world.model, world.data)
    np.testing.assert_allclose(world.tool_pose().position_m, kinematics(name).position_m(PARK), atol=1e-6)


def test_motions_are_planned_as_fast_as_the_data_sheet_allows() -> None:
    assert MotionSettings().speed_limits_rad_s == (2.09, 2.09, 3.14, 3.14, 3.14, 3.14)
    assert MotionSettings().robot == default_robot()


def test_a_robot_file_is_relative_to_the_configuration(tmp_path: Path) -> None:
    path = changed_configuration(tmp_path, "robot: ur10 #", "robot: own.yaml #")
    shipped = (path.parent / "robots" / "ur10.yaml").read_text()
    (tmp_path / "own.yaml").write_text(shipped.replace("name: ur10", "name: slow").replace("[5.0,", "[1.5,"))
    loaded = load_configuration(path)
    assert loaded.motion.robot == loaded.robot
    assert (loaded.robot.name, loaded.motion.acceleration_limits_rad_s2[0]) == ("slow", 1.5)


def own_robot(folder: Path, mesh: str) -> Path:
    """A robot whose forearm is a mesh of its own, under this name."""
    urdf = (FOLDER / "ur10" / "ur10.urdf").read_text().replace("package://ur10/collision/forearm.stl", mesh)
    (folder / "own.urdf").write_text(urdf)
    robot = (FOLDER / "ur10.yaml").read_text().replace("package://ur10/ur10.urdf", "own.urdf")
    (folder / "own.yaml").write_text(robot)
    return folder


@pytest.mark.parametrize("mesh", ["meshes/own.stl", "package://mine/meshes/own.stl"])
def test_meshes_lie_beside_the_urdf_or_in_its_package_and_are_kept_in_the_log(tmp_path: Path, mesh: str) -> None:
    folder = tmp_path / "mine"
    (folder / "meshes").mkdir(parents=True)
    shutil.copy(FOLDER / "ur10" / "collision" / "forearm.stl", folder / "meshes" / "own.stl")
    robot = load_robot("own.yaml", own_robot(folder, mesh))
    assert str(folder / "meshes" / "own.stl") in robot.urdf_text
    for name, (_, content) in robot_files(robot).items():
        (tmp_path / "log" / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / "log" / name).write_bytes(content)
    shutil.rmtree(folder)
    logged = load_robot("robot.yaml", tmp_path / "log")
    assert str(tmp_path / "log" / "robot") in logged.urdf_text
    assert logged.model_dump(exclude={"urdf"}) == robot.model_dump(exclude={"urdf"})


def test_a_mesh_that_is_nowhere_is_told(tmp_path: Path) -> None:
    [remark] = load_robot("own.yaml", own_robot(tmp_path, "none.stl")).remarks
    assert remark.startswith("forearm_link: there is no mesh none.stl")


@pytest.mark.parametrize(
    ("robot", "file", "words"),
    [
        ("ur11", "", r"cell.yaml:3:8: robot: unknown robot; legal: ur10, ur10e, or a robot file, not 'ur11'"),
        ("own.yaml", "name: own\n", "own.yaml:1:1: key 'urdf' is missing"),
        ("own.yaml", "origins_m: {knee: [0, 0, 0]}\n", "robot: the URDF has no joint 'knee'"),
    ],
)
def test_a_robot_that_is_none_is_told_with_its_line(tmp_path: Path, robot: str, file: str, words: str) -> None:
    path = changed_configuration(tmp_path, "robot: ur10 #", f"robot: {robot} #")
    text = (path.parent / "robots" / "ur10.yaml").read_text()
    (tmp_path / "own.yaml").write_text(file if file.startswith("name") else text + file)
    with pytest.raises(InputError) as error:
        load_configuration(path)
    assert words in str(error.value)


def test_a_pose_beyond_the_robots_range_is_told(tmp_path: Path) -> None:
    path = changed_configuration(tmp_path, "-1.5998, 1.8490,", "-1.5998, 3.5,")
    with pytest.raises(InputError, match=r"arm_park_rad: elbow has 3.5, ur10 turns from -3.142 to 3.142"):
        load_configuration(path)
