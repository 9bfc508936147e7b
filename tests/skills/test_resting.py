"""Where an arm rests whose bench file does not say: aside, and where the overhead camera still sees the bench."""

from __future__ import annotations

import itertools

import numpy as np

from bracket_cell.configuration import load_configuration, load_product
from bracket_cell.learned.classical.bench_evidence import leaves_in_view
from bracket_cell.skills.motion.resting import with_resting_poses
from bracket_ground.interfaces.pose import Array

CONFIGURATION = load_configuration()
PRODUCT = load_product(CONFIGURATION)
BENCH = CONFIGURATION.bench.model_copy(update={"arm_park_rad": ()})


def test_a_pose_that_hides_the_bench_is_passed_over_while_there_are_others() -> None:
    asked: list[Array] = []

    def third(robot_m: Array) -> bool:
        asked.append(robot_m)
        return len(asked) == 3

    first = with_resting_poses(BENCH, PRODUCT, CONFIGURATION.motion, lambda _: True)
    later = with_resting_poses(BENCH, PRODUCT, CONFIGURATION.motion, third)
    hidden = with_resting_poses(BENCH, PRODUCT, CONFIGURATION.motion, lambda _: False)
    assert len(asked) == 3
    assert later.arm_park_rad != first.arm_park_rad == hidden.arm_park_rad


def test_a_robot_over_half_of_the_tray_leaves_too_little_to_be_seen() -> None:
    leaves, (x, y, z) = leaves_in_view(BENCH, PRODUCT), BENCH.tray.centre_m
    width_m, depth_m = BENCH.tray.size_m

    def block(around_y_m: float) -> Array:
        halves = np.array(list(itertools.product((-width_m, width_m), (-depth_m / 4, depth_m / 4), (0.1, 0.3))))
        block_m: Array = halves[np.newaxis] + np.array((x, around_y_m, z))
        return block_m

    assert leaves(block(y + 5.0))
    assert not leaves(block(y))
