"""Laws of how parts lie: on the floor, where their mass keeps them, whichever side is up."""

from __future__ import annotations

import math

import numpy as np
import pytest

from bracket_cell.configuration import load_configuration, load_product
from bracket_ground.interfaces.pose import Pose
from bracket_ground.interfaces.product import PartType
from bracket_ground.interfaces.resting_pose import SIDES, UPRIGHT, axis_of, rest_on, side_up

PRODUCT = load_product(load_configuration())


@pytest.mark.parametrize("up", [UPRIGHT, *SIDES])
@pytest.mark.parametrize("part", PRODUCT.parts)
def test_a_part_at_rest_touches_the_floor_and_nothing_of_it_is_below(part: str, up: str) -> None:
    kind = PRODUCT.parts[part]
    rest = rest_on(kind, up)
    assert rest is not None
    heights = rest.transform(np.concatenate([solid.points() for solid in kind.whole]))[:, 2]
    assert abs(heights.min()) < 1e-9
    assert (heights < 1e-4).sum() >= 3
    assert side_up(rest) == up
    assert side_up(Pose.from_yaw((0.3, 0.1, 0.0), 1.2) @ rest) == up


def test_what_is_round_on_one_side_leans_until_a_second_thing_touches() -> None:
    rest = rest_on(PRODUCT.parts["o2"], "+y")
    assert rest is not None
    assert math.degrees(math.acos(rest.rotation[2] @ axis_of("+y"))) == pytest.approx(11.3, abs=0.5)


def test_a_part_that_tips_over_does_not_rest_on_that_side() -> None:
    pin = PartType(
        title="pin", quantity=1, size_m=(0.02, 0.02, 0.01), peg_diameter_m=0.004, peg_length_m=0.06,
        colour_rgb=(0.5, 0.5, 0.5), mass_kg=0.1,
    )  # fmt: skip
    assert rest_on(pin, UPRIGHT) is not None
    leaning = rest_on(pin, "+y")
    assert leaning is not None
    assert leaning.rotation[2] @ axis_of("+y") < math.cos(math.radians(5))
    assert rest_on(pin, "-z") is not None
