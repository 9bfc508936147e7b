"""Arms whose descriptions have names of the scene: in the simulator they stand where the controller believes."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from bracket_cell.configuration import load_configuration, load_product
from bracket_cell.skills.motion.kinematics import Kinematics
from bracket_cell.skills.motion.settings import MotionSettings
from bracket_ground.interfaces.robot import load_robot
from bracket_sim.scene.world import build_world
from tests.arms import robot_file

MOUNT = "mount: {position_m: [0.2, -0.1, 0.05], quaternion_wxyz: [0.7071067811865476, 0, 0, 0.7071067811865476]}\n"
WORLD = {"foot": "world"}
NAMES = {"l0": "hand", "l1": "tray", "l2": "tool", "l3": "bracket"}


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
