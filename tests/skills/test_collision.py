"""What the collision checker must see, and what it must let pass."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from bracket_cell.skills.motion.collision import STEP_M, Box, CollisionChecker, body_box
from bracket_cell.skills.motion.grasp_pose import held_boxes, tool_down
from bracket_cell.skills.motion.kinematics import Kinematics
from bracket_cell.skills.motion.settings import MotionSettings
from bracket_ground.interfaces.bench import Bench, Obstacle
from bracket_ground.interfaces.grip import Grip, Hold
from bracket_ground.interfaces.pose import Array, Pose
from bracket_ground.interfaces.product import Product
from bracket_ground.interfaces.robot import FOLDER, load_robot

SETTINGS = MotionSettings()


@pytest.fixture(scope="module")
def checker(kinematics: Kinematics, product: Product, bench: Bench) -> CollisionChecker:
    return CollisionChecker(kinematics, product, bench)


def at(kinematics: Kinematics, x: float, y: float, z: float, yaw: float = 0.0) -> Array:
    joints = kinematics.inverse(tool_down((x, y, z), yaw))
    assert joints is not None
    return joints[None]


def test_named_poses_and_the_way_between_them_are_free(checker: CollisionChecker, bench: Bench) -> None:
    way = np.array([bench.arm_park_rad, bench.arm_look_rad])
    assert checker.first_contact(way, 0.085, margin_m=0.01) is None


@pytest.mark.parametrize(
    ("spot", "touched"),
    [
        ((0.30, 0.30, 0.005), "the table"),
        ((0.56, -0.38, 0.010), "the tray"),
        ((0.72, 0.14, 0.040), "the bracket"),
        ((0.56, -0.58, 0.018), "the tray's rim"),
    ],
)
def test_what_stands_on_the_bench_is_seen(
    checker: CollisionChecker, kinematics: Kinematics, spot: tuple[float, float, float], touched: str
) -> None:
    contact = checker.first_contact(at(kinematics, *spot), 0.04)
    assert contact is not None
    assert touched in contact


def test_fingers_pass_closely_over_what_they_must_not_touch(checker: CollisionChecker, kinematics: Kinematics) -> None:
    tip = SETTINGS.robot.gripper.fingertip_beyond_tcp_m
    assert checker.first_contact(at(kinematics, 0.72, 0.14, 0.036 + tip + 0.002), 0.05) is None
    assert checker.first_contact(at(kinematics, 0.72, 0.14, 0.036 + tip - 0.002), 0.05) is not None


def test_the_opening_decides_about_neighbours(checker: CollisionChecker, kinematics: Kinematics) -> None:
    wall = Box("a neighbour", Pose((0.55 + 0.045, -0.40, 0.03)), (0.01, 0.1, 0.05))
    joints = at(kinematics, 0.55, -0.40, 0.04)
    assert checker.first_contact(joints, 0.030, [wall]) is None
    assert checker.first_contact(joints, 0.080, [wall]) is not None
    turned = at(kinematics, 0.55, -0.40, 0.04, np.pi / 2)
    assert checker.first_contact(turned, 0.080, [wall]) is None


def test_the_margin_counts(checker: CollisionChecker, kinematics: Kinematics) -> None:
    box = Box("a box", Pose((0.55, -0.40, 0.05)), (0.05, 0.05, 0.05))
    above = at(kinematics, 0.55, -0.40, 0.075 + SETTINGS.robot.gripper.fingertip_beyond_tcp_m + 0.003)
    assert checker.first_contact(above, 0.01, [box], margin_m=0.001) is None
    assert checker.first_contact(above, 0.01, [box], margin_m=0.006) is not None


def test_a_held_part_is_carried_along(checker: CollisionChecker, kinematics: Kinematics, product: Product) -> None:
    kind = product.parts["o3"]
    standing = body_box("o2 at p3", Pose((0.72, 0.18, 0.036)), product.parts["o2"].size_m)
    bottom_m = 0.036 + product.parts["o2"].size_m[2] + kind.peg_length_m / 2
    joints = at(kinematics, 0.72, 0.18, bottom_m + kind.size_m[2] - SETTINGS.grasp_depth_m + 0.008)
    assert checker.first_contact(joints, 0.04, [standing]) is None
    body = held_boxes("o3", kind, SETTINGS, Hold(Grip.WIDTH), with_peg=False)
    assert checker.first_contact(joints, 0.04, [standing], body) is None
    with_peg = held_boxes("o3", kind, SETTINGS, Hold(Grip.WIDTH), with_peg=True)
    contact = checker.first_contact(joints, 0.04, [standing], with_peg)
    assert contact is not None
    assert "o3 in the gripper" in contact
    assert "o2 at p3" in contact


def test_an_obstacle_in_mid_path_is_not_stepped_over(checker: CollisionChecker, kinematics: Kinematics) -> None:
    path = np.vstack([at(kinematics, 0.6, -0.3, 0.2), at(kinematics, 0.6, 0.3, 0.2)])
    post = Box("a post", Pose((0.67, 0.02, 0.10)), (0.03, 0.03, 0.20))
    assert checker.first_contact(path, 0.0) is None
    assert checker.first_contact(path, 0.0, [post]) is not None
    assert checker.first_contact(path[::-1], 0.0, [post]) is not None


def test_the_arm_does_not_meet_itself_unnoticed(checker: CollisionChecker) -> None:
    folded: Array = np.array([[0.0, -1.0, 3.1, -1.5, 1.5, 0.0]])
    assert checker.first_contact(folded, 0.04) is not None


def test_no_point_of_the_arm_goes_farther_than_a_step_between_checks(
    checker: CollisionChecker, kinematics: Kinematics
) -> None:
    path: Array = np.array(
        [[0.0, -1.3, 1.9, -2.2, -1.5, 0.0], [0.5, -1.3, 1.9, -2.2, -1.5, 0], [0.5, -1, 2, -2.2, -1.5, 3]]
    )
    dense = checker.scene(0.085).resampled(path)
    assert np.allclose(dense[[0, -1]], path[[0, -1]])
    tool_m = np.array([kinematics.position_m(joints) for joints in dense])
    assert np.linalg.norm(np.diff(tool_m, axis=0), axis=1).max() <= STEP_M * 1.01
    turns = np.abs(np.diff(dense[:, 5]))
    assert turns.max() * 0.06 <= STEP_M * 1.01  # the camera, beside the axis of the last joint
    assert len(dense) < np.abs(np.diff(path, axis=0)).max(axis=1).sum() / 0.02  # far fewer than in steps of joints


def test_a_broad_phase_misses_nothing(checker: CollisionChecker, product: Product) -> None:
    """The same answers as of all pairs, one after the other."""
    held = held_boxes("o3", product.parts["o3"], SETTINGS, Hold(Grip.WIDTH), with_peg=True)
    posts = [Box(f"post {number}", Pose((0.5, 0.2 * number - 0.4, 0.1)), (0.05, 0.05, 0.2)) for number in range(5)]
    scene, rng = checker.scene(0.05, posts, held, 0.004), np.random.default_rng(5)
    low, high = np.array([-1.5, -2.2, 0.8, -3.0, -2.0, -3.0]), np.array([1.0, -0.6, 2.6, -0.5, -1.2, 3.0])
    postures = rng.uniform(low, high, (400, 6))
    every = [scene.touches_pair_by_pair(joints) for joints in postures]
    assert [scene.touches(joints) for joints in postures] == every
    assert 50 < sum(every) < 350


def obstacle(**shape: Any) -> Obstacle:
    return Obstacle(name="the camera post", position_m=(0.55, -0.40, 0.10), **shape)


def tetrahedron(path: Path) -> Path:
    """10 cm high and wide, on its base."""
    corners = [(-0.05, -0.05, -0.1), (0.05, -0.05, -0.1), (0.0, 0.05, -0.1), (0.0, 0.0, 0.0)]
    faces = ["f 1 2 3", "f 1 2 4", "f 2 3 4", "f 3 1 4"]
    path.write_text("\n".join([*(f"v {x} {y} {z}" for x, y, z in corners), *faces]) + "\n")
    return path


@pytest.mark.parametrize("shape", ["box", "cylinder", "mesh"])
def test_obstacles_of_the_bench_are_seen(
    kinematics: Kinematics, product: Product, bench: Bench, tmp_path: Path, shape: str
) -> None:
    made: dict[str, dict[str, Any]] = {
        "box": {"box_m": (0.1, 0.1, 0.2)},
        "cylinder": {"cylinder_m": (0.1, 0.2)},
        "mesh": {"mesh": tetrahedron(tmp_path / "lamp.obj")},
    }
    with_it = bench.model_copy(update={"obstacles": (obstacle(**made[shape]),)})
    checker = CollisionChecker(kinematics, product, with_it)
    top_m = {"box": 0.20, "cylinder": 0.20, "mesh": 0.10}[shape] + SETTINGS.robot.gripper.fingertip_beyond_tcp_m
    assert checker.first_contact(at(kinematics, 0.55, -0.40, top_m + 0.01), 0.0) is None
    contact = checker.first_contact(at(kinematics, 0.55, -0.40, top_m - 0.01), 0.0)
    assert contact is not None
    assert contact.endswith("would touch the camera post")


SHAPES = {
    "box": '<box size="1.0 1.0 0.5"/>',
    "cylinder": '<cylinder radius="0.5" length="0.5"/>',
    "sphere": '<sphere radius="0.4"/>',
    "mesh": '<mesh filename="package://ur10/collision/base.stl" scale="10 10 8"/>',
}


def carrying(tmp_path: Path, *shapes: str) -> MotionSettings:
    """A UR10 with more shapes on its forearm."""
    text = (FOLDER / "ur10/ur10.urdf").read_text()
    link = '<link name="forearm_link">'
    more = "".join(f'<collision><origin xyz="0 0 0.3"/><geometry>{shape}</geometry></collision>' for shape in shapes)
    head, tail = text.split(link)
    first, rest = tail.split("</collision>", 1)
    (tmp_path / "more.urdf").write_text(f"{head}{link}{first}</collision>{more}{rest}")
    robot = (FOLDER / "ur10.yaml").read_text().replace("package://ur10/ur10.urdf", "more.urdf")
    (tmp_path / "more.yaml").write_text(robot)
    return SETTINGS.of(load_robot("more.yaml", tmp_path))


@pytest.mark.parametrize("kind", SHAPES)
def test_every_shape_of_a_urdf_is_there(kind: str, tmp_path: Path, product: Product, bench: Bench) -> None:
    settings = carrying(tmp_path, SHAPES[kind])
    checker = CollisionChecker(Kinematics(settings), product, bench, settings)
    assert "forearm_link (1)" in {shape.name for shape in checker.shapes}
    contact = checker.first_contact(np.array([bench.arm_park_rad]), 0.085)
    assert contact is not None
    assert "forearm link (1)" in contact


def test_a_link_without_a_mesh_is_there(tmp_path: Path, product: Product, bench: Bench) -> None:
    settings = carrying(tmp_path)
    text = re.sub(
        r'<mesh filename="[^"]*forearm[^"]*"\s*/>', '<cylinder radius="0.05" length="0.5"/>', settings.robot.urdf_text
    )
    assert "forearm.stl" not in text
    (tmp_path / "more.urdf").write_text(text)
    settings = SETTINGS.of(load_robot("more.yaml", tmp_path))
    checker = CollisionChecker(Kinematics(settings), product, bench, settings)
    assert "forearm_link" in {shape.name for shape in checker.shapes}
    assert checker.first_contact(np.array([bench.arm_park_rad]), 0.085) is None


def test_the_arm_meets_itself_wherever_its_links_can(checker: CollisionChecker) -> None:
    folded = np.array([[0.0, -1.0, 3.0, 0.5, 0.0, 0.0]])
    contact = checker.first_contact(folded, 0.085)
    assert contact is not None
    assert "link" in contact
