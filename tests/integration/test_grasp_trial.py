"""The judge of simulated grasps: what is clear is lifted, what stands in the way is noticed."""

from __future__ import annotations

import pytest

from bracket_ground.interfaces.grip import Grip, Hold
from tests.integration.grasp_trial import MOVED_M, Descent, try_grasp

DESCENT = Descent(clearance_m=0.004, depth_m=0.022)
SIDE_BY_SIDE = [("o1", (0.55, -0.40), 0.0), ("o1", (0.55, -0.366), 0.0)]


@pytest.mark.long
@pytest.mark.parametrize("target", [0, 1])
def test_of_two_parts_side_by_side_each_is_taken_by_its_ends_alone(target: int, request: pytest.FixtureRequest) -> None:
    across = try_grasp(SIDE_BY_SIDE, target, Hold(Grip.WIDTH), DESCENT, f"{request.node.name} width")
    assert not across.good
    assert across.touched
    assert across.moved_m > MOVED_M or "protective stop" in across.reason
    along = try_grasp(SIDE_BY_SIDE, target, Hold(Grip.LENGTH), DESCENT, f"{request.node.name} length")
    assert along.good, along


def test_a_part_that_stands_free_is_good_and_a_missing_one_is_not(request: pytest.FixtureRequest) -> None:
    free = [("o3", (0.55, -0.40), 1.0), ("o1", (0.55, -0.25), 0.0)]
    assert try_grasp(free, 0, Hold(Grip.WIDTH), DESCENT, request.node.name).good
    out_of_reach = [("o3", (1.6, 0.0), 1.0)]
    verdict = try_grasp(out_of_reach, 0, Hold(Grip.WIDTH), DESCENT, f"{request.node.name} far")
    assert (verdict.lifted, verdict.reason) == (False, "out of the arm's reach")
