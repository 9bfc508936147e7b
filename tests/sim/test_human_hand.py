"""The human hand: human lengths, pads where the parts are pinched, mirrored and scaled as a whole."""

from __future__ import annotations

from functools import partial

import mujoco
import numpy as np
import pytest

from bracket_ground.interfaces.bench import Bench
from bracket_ground.interfaces.pose import Array
from bracket_ground.interfaces.product import Product
from bracket_sim.scene import human_hand as human
from bracket_sim.scene.hand import DIGITS, Hand, add_hand
from bracket_sim.scene.look import NOMINAL
from bracket_sim.scene.look_range import LookRange
from bracket_sim.scene.world import World, build_world

GAPS_M = (0.0, 0.008, 0.017, 0.03, 0.04)
THUMB_TIP, INDEX_TIP = 4, 8


def skeleton(grasp: human.Grasp, half_gap_m: float) -> human.Skeleton:
    weights = np.array([float(literal_type == grasp) for literal_type in human.GRASPS])
    return human.skeleton(human.posture(weights, half_gap_m, half_gap_m))


def world_with(product: Product, bench: Bench, **person: object) -> World:
    look = NOMINAL.model_copy(update={"person": NOMINAL.person.model_copy(update={"hand": "human", **person})})
    return build_world(product, bench, extend=partial(add_hand, bench=bench, person=look.person), look=look)


def joints_of(world: World, gap_m: float) -> Array:
    """Of the hand (21, 3), seen from its frame."""
    model, data = world.model, world.data
    for name in DIGITS:
        data.qpos[model.joint(name).qposadr[0]] = gap_m / 2
    mujoco.mj_kinematics(model, data)
    world.pose_hand()
    sites = [model.site(f"hand_joint_{number}").id for number in range(21)]
    seen: Array = data.site_xpos[sites] - data.body("hand").xpos
    return seen


@pytest.mark.parametrize("grasp", human.GRASPS)
@pytest.mark.parametrize("half_gap_m", GAPS_M)
def test_the_pads_are_as_far_apart_as_the_digits_that_grip(grasp: human.Grasp, half_gap_m: float) -> None:
    joints = skeleton(grasp, half_gap_m).joints_m
    thumb_m, index_m = joints[THUMB_TIP], joints[INDEX_TIP]
    assert abs(-thumb_m[1] - (half_gap_m + 0.0075)) < 0.004
    assert abs(index_m[1] - (half_gap_m + 0.0075)) < 0.004
    assert (np.abs(np.array([thumb_m, index_m])[:, [0, 2]]) < 0.015).all()


@pytest.mark.parametrize("grasp", human.GRASPS)
def test_bones_keep_their_lengths_and_no_finger_reaches_below_the_pads(grasp: human.Grasp) -> None:
    for half_gap_m in GAPS_M:
        joints = skeleton(grasp, half_gap_m).joints_m
        lengths = np.linalg.norm(np.diff(joints[5:].reshape(4, 4, 3), axis=1), axis=2)[:, :2]
        expected = np.array([bones[:2] for bones in human.FINGER_BONES]) * human.LENGTH_M
        np.testing.assert_allclose(lengths, expected, atol=1e-9)
        assert joints[:, 2].min() > -0.006


def test_the_thumb_is_as_long_as_a_persons() -> None:
    joints = skeleton("tripod", 0.012).joints_m
    along = np.linalg.norm(np.diff(joints[1:5], axis=0), axis=1).sum() + human.TIP_M
    assert 0.10 < along < 0.13


def test_what_is_seen_follows_the_digits_of_a_small_left_hand(product: Product, bench: Bench) -> None:
    size = 0.88
    world = world_with(product, bench, left_hand=True, hand_size=size)
    joints = joints_of(world, 0.03)
    expected = skeleton("tripod", 0.015 / size).joints_m * size * np.array([1.0, -1.0, 1.0])
    np.testing.assert_allclose(joints, expected, atol=1e-6)
    assert joints_of(world, 0.06)[INDEX_TIP, 1] < joints[INDEX_TIP, 1] - 0.01


def test_pieces_stay_on_their_bones(product: Product, bench: Bench) -> None:
    """A piece's middle keeps its distance from both joints of its bone, however wide the hand is open."""
    world = world_with(product, bench)
    names = [world.model.geom(index).name for index in range(world.model.ngeom)]
    index_bone = next(number for number, name in enumerate(names) if name.startswith("hand_bone_4_"))
    away = []
    for gap_m in (0.0, 0.05):
        joints = joints_of(world, gap_m)
        middle = world.data.geom_xpos[index_bone] - world.data.body("hand").xpos
        away.append(np.linalg.norm(joints[5:7] - middle, axis=1))
    np.testing.assert_allclose(away[0], away[1], atol=1e-6)


def test_the_hand_turns_to_the_grasp_that_is_commanded(product: Product, bench: Bench) -> None:
    world = world_with(product, bench)
    hand = Hand(world.model, world.data)
    for _ in range(120):
        hand.command(hand.position_m, 0.0, 0.03, grasp="lateral")
    mujoco.mj_kinematics(world.model, world.data)
    joints = joints_of(world, 0.03)
    assert np.abs(joints - skeleton("lateral", 0.015).joints_m).max() < 0.004


def test_a_range_of_hands_draws_both() -> None:
    look = LookRange.model_validate({"person": {"hand": ["drawn", "human"]}})
    assert {look.draw(seed).person.hand for seed in range(12)} == {"drawn", "human"}
