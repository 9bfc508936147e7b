"""What is switched on and off holds in simulation: a cup and a magnet lift a plate, a magnet only one of steel."""

from __future__ import annotations

import numpy as np
import pytest

from bracket_cell.configuration import load_configuration, load_product
from bracket_cell.skills.motion.kinematics import Kinematics
from bracket_ground.interfaces.gripper import load_gripper
from bracket_ground.interfaces.observation import ObjectStatus
from bracket_ground.interfaces.pose import Pose
from bracket_ground.interfaces.product import PartType
from bracket_ground.interfaces.solid import Solid
from bracket_sim.devices.simulated_gripper import Nothing, Suction
from bracket_sim.scene.parts import ScenePart
from bracket_sim.scene.world import World, build_world

DT_S, PLACE_M, TOP_M = 0.008, (0.82, -0.30), 0.02
DOWN = (0.0, 1.0, 0.0, 0.0)
SHAPE = (Solid(solid="box", size_m=(0.06, 0.05, TOP_M), centre_m=(0.0, 0.0, TOP_M / 2)),)
PLATE = PartType(title="plate", size_m=(0.06, 0.05, TOP_M), colour_rgb=(0.5, 0.5, 0.5), mass_kg=0.1, shape=SHAPE)


def over_a_plate(name: str, *, magnetic: bool) -> World:
    """An arm whose gripper presses on a plate by half of its travel."""
    configuration = load_configuration()
    robot = configuration.robot.model_copy(update={"gripper": load_gripper(name)})
    product = load_product(configuration)
    kinds = {**product.parts, "o1": PLATE.model_copy(update={"magnetic": magnetic})}
    product = product.model_copy(update={"parts": kinds})
    plate = ScenePart("o1", Pose((*PLACE_M, 0.0)))
    world = build_world(product, configuration.bench, (plate,), robot=robot)
    kinematics = Kinematics(configuration.motion.of(robot))
    joints = kinematics.inverse(Pose((*PLACE_M, TOP_M - 0.001), DOWN))
    assert joints is not None
    world.set_arm(joints)
    return world


def lifted_m(world: World, jaw: Suction) -> float:
    """How far the plate comes up with the tool by 5 cm."""
    jaw.go(0.0, 0.1, 60.0)
    for _ in range(60):
        jaw.update(DT_S)
        world.step_period()
    low, joints = float(world.data.xpos[world.bodies[0].body][2]), world.data.qpos[world.arm_qpos].copy()
    configuration = load_configuration()
    kinematics = Kinematics(configuration.motion.of(world.robot))
    for height_m in np.linspace(0.0, 0.05, 60):
        found = kinematics.follow(Pose((*PLACE_M, TOP_M - 0.001 + height_m), DOWN), joints)
        assert found is not None
        joints = found
        world.data.ctrl[world.arm_ctrl] = joints
        jaw.update(DT_S)
        world.step_period()
    return float(world.data.xpos[world.bodies[0].body][2]) - low


def told(jaw: Suction) -> ObjectStatus:
    """Its status now."""
    return jaw.status


@pytest.mark.parametrize(("name", "magnetic"), [("cup", False), ("magnet", True)])
def test_a_plate_is_held_and_let_go(name: str, magnetic: bool) -> None:
    world = over_a_plate(name, magnetic=magnetic)
    jaw = Suction(world)
    assert lifted_m(world, jaw) > 0.035
    assert told(jaw) is ObjectStatus.CONTACT_CLOSING
    jaw.go(world.robot.gripper.stroke_m, 0.1, 60.0)
    for _ in range(60):
        jaw.update(DT_S)
        world.step_period()
    assert told(jaw) is ObjectStatus.AT_POSITION
    assert world.data.xpos[world.bodies[0].body][2] < 0.01


def test_a_magnet_tells_that_it_holds_no_brass() -> None:
    jaw = Suction(world := over_a_plate("magnet", magnetic=False))
    lifted_m(world, jaw)
    assert jaw.status is ObjectStatus.AT_POSITION


def test_nothing_is_where_it_was_told_to_be() -> None:
    jaw = Nothing()
    jaw.go(0.01, 0.1, 60.0)
    jaw.update(DT_S)
    assert (jaw.opening_m, jaw.status) == (0.01, ObjectStatus.AT_POSITION)
