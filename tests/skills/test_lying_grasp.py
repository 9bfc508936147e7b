"""Laws of holding parts that lie: every shipped part can be turned onto its peg, and the fingers fit."""

from __future__ import annotations

import math

import numpy as np
import pytest

from bracket_cell.configuration import load_configuration, load_product
from bracket_cell.skills.lying import better
from bracket_cell.skills.motion.lying_grasp import LyingHold, held_box, laid_out, lying_holds, turns_left
from bracket_cell.skills.motion.settings import MotionSettings
from bracket_ground.interfaces.product import PartType
from bracket_ground.interfaces.resting_pose import SIDES, UPRIGHT, axis_of, rest_on

PRODUCT = load_product(load_configuration())
SETTINGS = MotionSettings()
WAYS = [(part, up) for part in PRODUCT.parts for up in SIDES]


def holds(part: str, up: str) -> list[LyingHold]:
    return list(lying_holds(PRODUCT.parts[part], up, SETTINGS))


@pytest.mark.parametrize(("part", "up"), WAYS)
def test_a_part_on_its_head_needs_two_quarter_turns_any_other_one(part: str, up: str) -> None:
    assert turns_left(PRODUCT.parts[part], up, SETTINGS) == (2 if up == "-z" else 1)
    assert UPRIGHT in better(PRODUCT.parts[part], up, SETTINGS)
    assert turns_left(PRODUCT.parts[part], UPRIGHT, SETTINGS) == 0


@pytest.mark.parametrize(("part", "up"), WAYS)
def test_the_fingers_close_along_the_axis_of_the_turn_and_lean_both_before_and_after(part: str, up: str) -> None:
    for hold in holds(part, up):
        tool = hold.part_from_tool.rotation
        assert abs(tool[hold.turn.axis, 0]) == pytest.approx(1.0)
        before, after = hold.lean_rad(up), hold.lean_rad(hold.turn.then)
        assert before + after == pytest.approx(math.pi / 2)
        assert 0 < hold.held_m <= SETTINGS.gripper.stroke_m - 2 * SETTINGS.least_finger_clearance_m


@pytest.mark.parametrize(("part", "up"), WAYS)
def test_the_tool_is_above_the_floor_before_and_after_the_turn(part: str, up: str) -> None:
    kind = PRODUCT.parts[part]
    points = np.concatenate([solid.points() for solid in kind.whole])
    for hold in holds(part, up):
        for side in (up, hold.turn.then):
            place = np.array(hold.part_from_tool.position_m) @ axis_of(side)
            assert place - (points @ axis_of(side)).min() >= 0.0179


@pytest.mark.parametrize(("part", "up"), WAYS)
def test_a_part_that_was_put_down_lies_in_the_middle_of_its_room(part: str, up: str) -> None:
    kind = PRODUCT.parts[part]
    found = laid_out(kind, up)
    assert found is not None
    spot_from_part, room = found
    points = spot_from_part.transform(np.concatenate([solid.points() for solid in kind.whole]))
    np.testing.assert_allclose(points.min(axis=0), (-room[0] / 2, -room[1] / 2, 0.0), atol=1e-9)
    np.testing.assert_allclose(points.max(axis=0), (room[0] / 2, room[1] / 2, room[2]), atol=1e-9)


def test_the_held_part_is_around_what_the_fingers_hold() -> None:
    kind, hold = PRODUCT.parts["o2"], holds("o2", "+y")[0]
    box = held_box("o2", kind, hold)
    rest = rest_on(kind, "+y")
    assert rest is not None
    tool = rest @ hold.part_from_tool
    centre = np.array((tool @ box.pose).position_m)
    np.testing.assert_allclose(centre, rest.transform(np.array([0.0, 0.0, 0.0165])), atol=1e-9)
    assert box.size_m == pytest.approx((0.065, 0.034, 0.057))


def test_a_part_wider_than_the_stroke_on_every_side_cannot_be_turned() -> None:
    kind = PartType.model_validate({**PRODUCT.parts["o3"].model_dump(), "size_m": (0.12, 0.11, 0.10), "shape": ()})
    assert turns_left(kind, "+y", SETTINGS) is None
    assert better(kind, "+y", SETTINGS) == ()
