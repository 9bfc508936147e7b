"""An arm of another maker: what its URDF says counts, and what the program cannot move is said in words."""

from __future__ import annotations

import re
import shutil
from pathlib import Path

import numpy as np
import pytest

from bracket_cell.configuration import load_configuration, load_product
from bracket_cell.skills.motion.grasp_pose import tool_down
from bracket_cell.skills.motion.kinematics import Kinematics
from bracket_cell.skills.motion.settings import MotionSettings
from bracket_ground.errors import CellError
from bracket_ground.interfaces.robot import FOLDER, RobotModel, load_robot
from bracket_sim.scene.world import build_world
from tests import ROOT

CONFIGURATION = load_configuration()
URDF = (FOLDER / "ur10/ur10.urdf").read_text()


def robot(folder: Path, urdf: str = URDF, range_rad: str | None = None) -> RobotModel:
    (folder / "arm.urdf").write_text(urdf)
    text = (FOLDER / "ur10.yaml").read_text().replace("package://ur10/ur10.urdf", "arm.urdf")
    text = re.sub(r"range_rad: .*\n", f"range_rad: {range_rad}\n" if range_rad else "", text)
    (folder / "arm.yaml").write_text(text)
    return load_robot("arm.yaml", folder)


def test_limits_come_from_the_urdf_where_none_are_given(tmp_path: Path) -> None:
    one_sided = URDF.replace('lower="-3.14159265359" upper="3.14159265359"', 'lower="-3.9" upper="1.5"')
    assert robot(tmp_path, one_sided).limits_rad[:, 2].tolist() == [-3.9, 1.5]


def test_what_is_wrong_is_told_of_the_file_that_says_it(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match=r"^[^:]*/arm.yaml: shoulder_pan: no value is within its limits, 3 to 2 rad$"):
        robot(tmp_path, range_rad="[[3.0, 2.0], 3.0, 3.0, 6.0, 6.0, 6.0]")
    with pytest.raises(ValueError, match=r"^[^:]*/arm.urdf: elbow: no value is within its limits, 4 to 3.1"):
        robot(tmp_path, URDF.replace('lower="-3.14159265359"', 'lower="4"', 1))


def test_an_edited_urdf_is_read_again_and_an_arm_that_was_loaded_stays(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "other").mkdir()
    lower = 'lower="-3.14159265359" upper="3.14159265359"'
    before, after = robot(Path()), robot(Path(), URDF.replace(lower, 'lower="-1" upper="1"'))
    assert (before.limits_rad[1, 2], after.limits_rad[1, 2]) == (pytest.approx(np.pi), 1.0)
    robot(tmp_path / "other")
    monkeypatch.chdir(tmp_path / "other")
    assert load_robot("arm.yaml").limits_rad[1, 2] == pytest.approx(np.pi)


def test_narrower_limits_of_the_file_count_for_each_side(tmp_path: Path) -> None:
    limits = robot(tmp_path, range_rad="[[-1.0, 2.0], 3.0, [-9, 1.5], 6.0, 6.0, 6.0]").limits_rad
    assert limits[:, 0].tolist() == [-1.0, 2.0]
    assert limits[:, 1].tolist() == [-3.0, 3.0]
    np.testing.assert_allclose(limits[:, 2], [-np.pi, 1.5])


@pytest.mark.long
@pytest.mark.parametrize("seed", range(3))
def test_no_answer_of_the_inverse_is_beyond_a_limit(seed: int, tmp_path: Path) -> None:
    rng = np.random.default_rng(seed)
    least, most = rng.uniform(-4, -0.5, 6), rng.uniform(0.5, 4, 6)
    given = [[float(a), float(b)] for a, b in zip(least, most, strict=True)]
    arm = Kinematics(MotionSettings().of(robot(tmp_path, range_rad=str(given))))
    answers = [
        arm.inverse(tool_down((x, y, 0.2), yaw), near_rad=rng.uniform(least, most))
        for x, y, yaw in rng.uniform((0.2, -0.7, -3), (0.9, 0.7, 3), (100, 3))
    ]
    found = [answer for answer in answers if answer is not None]
    assert all(arm.within_limits(one) for one in found)
    assert all(
        ((one >= np.maximum(least, [-9, -9, -np.pi, -9, -9, -9]) - 1e-6) & (one <= most + 1e-6)).all() for one in found
    )


def with_type(joint: str, kind: str) -> str:
    return re.sub(rf'name="{joint}" type="\w+"', f'name="{joint}" type="{kind}"', URDF)


ELBOW = 'lower="-3.14159265359" upper="3.14159265359"'
RING = """<robot name="a"><link name="tool0"/><link name="b"/>
<joint name="1" type="fixed"><parent link="tool0"/><child link="b"/></joint>
<joint name="2" type="fixed"><parent link="b"/><child link="tool0"/></joint></robot>"""
BESIDE = RING.replace("</robot>", '<link name="base"/></robot>')
BROKEN = {
    "floats": (with_type("elbow_joint", "floating"), "elbow_joint is floating, must be revolute"),
    "no axis": (URDF.replace('<axis xyz="0 0 1"', '<axis xyz="0 0 0"'), "shoulder_pan_joint has no axis"),
    "two of a name": (URDF.replace('"elbow_joint"', '"wrist_1_joint"'), "two joints are named 'wrist_1_joint'"),
    "5 joints": (with_type("elbow_joint", "fixed"), "5 joints up to the flange 'tool0', must be 6 or more"),
    "no flange": (URDF.replace("tool0", "flange"), "no link is the flange 'tool0' .*links: .*base_link"),
    "no limit": (re.sub(r"<limit[^>]*54[^>]*/>", "", URDF), "wrist_1_joint has no <limit>"),
    "no room": (URDF.replace(ELBOW, ""), "elbow: no value is within its limits"),
    "not XML": (URDF[:900], "not well-formed XML"),
    "another format": ("<mujoco/>", "its root is <mujoco>"),
    "empty": ("<robot name='a'/>", "has no <link>"),
    "bad number": (URDF.replace('lower="-3.14159265359"', 'lower="a lot"'), "elbow_joint: <limit> has lower='a lot'"),
    "infinite": (URDF.replace('xyz="0.0 -0.1719 0.612"', 'xyz="0 0 inf"'), "elbow_joint: <origin> has xyz='0 0 inf'"),
    "ring": (RING, "make a ring"),
    "ring beside the base": (BESIDE, "joints of b, tool0 make a ring"),
    "ring beside the arm": (
        URDF.replace("</robot>", RING[RING.index("<link") :].replace("tool0", "c")),
        "joints of b, c make a ring",
    ),
    "two bases": (URDF.replace("</robot>", '<link name="b"/></robot>'), "must have one base, has .*b"),
    "no such link": (URDF.replace('<child link="forearm_link"', '<child link="fore"'), "child 'fore' is no link"),
}


@pytest.mark.parametrize("why", BROKEN)
def test_what_the_program_cannot_move_is_said_in_words(why: str, tmp_path: Path) -> None:
    urdf, words = BROKEN[why]
    with pytest.raises((ValueError, CellError), match=words):
        robot(tmp_path, urdf)


def test_a_missing_mesh_is_a_thick_line_and_said(tmp_path: Path) -> None:
    arm = robot(tmp_path, URDF.replace("forearm.stl", "missing.stl"))
    assert arm.remarks == ("forearm_link: there is no mesh package://ur10/collision/missing.stl; a line 100 mm thick "
                           "stands for it",)  # fmt: skip
    build_world(load_product(CONFIGURATION), CONFIGURATION.bench, (), robot=arm)


def test_a_real_arm_needs_the_shapes_of_its_links(tmp_path: Path) -> None:
    folder = Path(shutil.copytree(ROOT / "config", tmp_path / "config"))
    robot(folder, URDF.replace("forearm.stl", "missing.stl"))
    file = folder / "cell.yaml"
    file.write_text(file.read_text().replace("robot: ur10 ", "robot: arm.yaml "))
    assert load_configuration(file).robot.unshaped == ("forearm_link",)
    file.write_text(file.read_text().replace("arm: {kind: simulated}", "arm: {kind: ur, host: 192.0.2.1}"))
    with pytest.raises(CellError, match=r"cell.yaml:3:8: meshes of forearm_link are missing"):
        load_configuration(file)


def test_what_hangs_on_the_flange_gives_way_and_what_moves_beside_the_arm_stands(tmp_path: Path) -> None:
    hand = """<link name="hand"/><joint name="finger" type="prismatic"><parent link="tool0"/><child link="hand"/>
    <limit lower="0" upper="1"/></joint><link name="head"/><joint name="neck" type="continuous">
    <parent link="base_link"/><child link="head"/></joint></robot>"""
    arm = robot(tmp_path, URDF.replace("</robot>", hand))
    assert arm.joints == load_robot("ur10").joints
    assert arm.remarks == ("neck: held at 0, as nothing moves them",)
    assert '"hand"' not in arm.urdf_text


def test_values_of_another_count_than_the_joints_are_said(tmp_path: Path) -> None:
    robot(tmp_path)
    text = (tmp_path / "arm.yaml").read_text().replace("speed_rad_s: [2.09, ", "speed_rad_s: [")
    (tmp_path / "arm.yaml").write_text(text)
    with pytest.raises(ValueError, match="speed_rad_s has 5 values, the arm has 6 joints: shoulder_pan, "):
        load_robot("arm.yaml", tmp_path)


def test_names_of_joints_and_flange_are_the_makers_own(tmp_path: Path) -> None:
    """Joints count by their places on the chain."""
    other = (
        URDF.replace("shoulder_pan_joint", "joint_1").replace("wrist_3_joint", "joint_6").replace('"ee_link"', '"x"')
    )
    other = (
        other.replace("base_link", "link_0").replace("forearm_link", "link_3").replace('"tool0"', '"mounting_plate"')
    )
    (tmp_path / "arm.urdf").write_text(other)
    text = (FOLDER / "ur10.yaml").read_text().replace("package://ur10/ur10.urdf", "arm.urdf\nflange: mounting_plate")
    (tmp_path / "arm.yaml").write_text(text)
    foreign = MotionSettings().of(load_robot("arm.yaml", tmp_path))
    joints = np.random.default_rng(1).uniform(-2, 2, 6)
    expected = Kinematics(MotionSettings().of(load_robot("ur10"))).forward(joints)
    np.testing.assert_allclose(Kinematics(foreign).forward(joints).matrix, expected.matrix, atol=1e-9)
    build_world(load_product(CONFIGURATION), CONFIGURATION.bench, (), robot=foreign.robot)
