"""The hand's fingers stay on the hand."""

from __future__ import annotations

import mujoco
import pytest

from bracket_ground.interfaces.bench import Bench
from bracket_ground.interfaces.product import Product
from bracket_sim.scene.hand import DIGIT_RANGE_M, DIGITS, PUSH_N, add_hand
from bracket_sim.scene.world import build_world

SLACK_M = 0.005


@pytest.mark.parametrize("digit", DIGITS)
def test_a_finger_that_is_caught_is_not_stretched(digit: str, product: Product, bench: Bench) -> None:
    """What holds it pulls as hard as the person's arm does."""
    world = build_world(product, bench, extend=lambda spec: add_hand(spec, bench))
    model, data = world.model, world.data
    outwards = 1 if digit == "hand_index" else -1
    for pull_n in (2 * PUSH_N, -2 * PUSH_N):
        data.xfrc_applied[model.body(digit).id, 1] = outwards * pull_n
        for _ in range(500):
            mujoco.mj_step(model, data)
        low_m, high_m = DIGIT_RANGE_M
        assert low_m - SLACK_M < float(data.joint(digit).qpos[0]) < high_m + SLACK_M
