"""Parts that lie on others are lifted off them, however high they lie, and what carries them is seen as it lies."""

from __future__ import annotations

from typing import cast

import numpy as np
import pytest

from bracket_cell.skills.grasping.contact import tool_height_m
from bracket_cell.skills.grasping.take_lower import STEP_M, TakeLower
from bracket_cell.skills.lying import boxes_around, lifted_m, raised, take_lying, ways_to_lift
from bracket_cell.skills.motion.planner import MotionPlanner
from bracket_ground.interfaces.bench import Bench
from bracket_ground.interfaces.perception import PartDetection
from bracket_ground.interfaces.pose import Pose
from bracket_ground.interfaces.product import Product
from bracket_ground.interfaces.resting_pose import rest_on
from bracket_ground.interfaces.skill import Skill, SkillStatus
from tests.skills.ideal_robot import IdealRobot

BOX, CARRIER = (10, 10, 20, 20), (5, 5, 25, 25)


def lying(product: Product, bench: Bench, part: str, above_m: float, **told: object) -> PartDetection:
    """One that lies in the middle of the tray, so far above its floor."""
    rest = rest_on(product.parts[part], "+y")
    assert rest is not None
    x, y, z = bench.tray.centre_m
    lies, size = Pose((x, y, z + above_m)) @ rest, (0.09, 0.06, above_m + 0.05)
    return PartDetection(part, 0.9, Pose((x, y, z)), size, BOX, upright=False, lies=lies, **told)  # type: ignore[arg-type]


@pytest.mark.parametrize("height_m", [-1.0, 0.0, 0.02])
def test_a_tool_that_rises_never_goes_down(planner: MotionPlanner, bench: Bench, height_m: float) -> None:
    start = np.array(bench.arm_look_rad)
    now_m = planner.kinematics.forward(start).position_m[2]
    way = planner.rise(start, now_m + height_m, 0.05)
    assert not isinstance(way, str)
    heights = [planner.kinematics.forward(joints).position_m[2] for joints in way.positions_rad]
    assert min(heights) > now_m - 1e-4
    assert heights[-1] == pytest.approx(now_m + max(height_m, 0.0), abs=1e-4)


@pytest.mark.parametrize("above_m", [0.0, 0.08, 0.16])
def test_a_part_is_lifted_off_what_it_lies_on_however_high_that_is(
    planner: MotionPlanner, product: Product, bench: Bench, above_m: float
) -> None:
    part = lying(product, bench, "o2", above_m)
    for chosen in ways_to_lift(planner, part, (), np.array(bench.arm_look_rad)):
        if not isinstance(take_lying(planner, part, (), chosen), str):
            assert lifted_m(planner, part, chosen[1]) >= chosen[1].position_m[2] + product.parts["o2"].peg_length_m
            return
    pytest.fail("no way to lift it")


class AboveIt(IdealRobot):
    """A robot that has a part between its fingers only below some height of the tool."""

    def __init__(self, planner: MotionPlanner, bench: Bench, below_m: float) -> None:
        super().__init__(bench.arm_look_rad, part_m=0.034)
        self._planner, self._below_m = planner, below_m

    def tool_m(self) -> float:
        return tool_height_m(self._planner, self.observe())

    def _close(self, goal_m: float) -> None:
        self.part_m = 0.034 if self.tool_m() < self._below_m else None
        super()._close(goal_m)


@pytest.mark.parametrize(("below_m", "lowers"), [(0.01, 0), (-0.01, 1), (-0.03, 2), (-0.05, None)])
def test_fingers_that_close_on_nothing_reach_lower(
    planner: MotionPlanner, bench: Bench, below_m: float, lowers: int | None
) -> None:
    now_m = planner.kinematics.forward(np.array(bench.arm_look_rad)).position_m[2]
    robot = AboveIt(planner, bench, now_m + below_m)
    progress = robot.run(cast(Skill, TakeLower("o2", planner, 0.05, now_m - 0.1, 2)))
    assert progress.status is (SkillStatus.FAILURE if lowers is None else SkillStatus.SUCCESS)
    assert robot.tool_m() == pytest.approx(now_m - STEP_M * (2 if lowers is None else lowers), abs=1e-3)
    assert robot.observe().gripper.holding == (lowers is not None)


def test_fingers_that_reach_lower_stay_above_the_floor(planner: MotionPlanner, bench: Bench) -> None:
    now_m = planner.kinematics.forward(np.array(bench.arm_look_rad)).position_m[2]
    robot = AboveIt(planner, bench, 0.0)
    assert robot.run(cast(Skill, TakeLower("o2", planner, 0.05, now_m - 0.01, 2))).status is SkillStatus.FAILURE
    assert robot.tool_m() == pytest.approx(now_m - 0.01, abs=1e-3)


def test_what_lies_too_high_for_the_floor_lies_on_others_though_they_are_hidden(
    planner: MotionPlanner, product: Product, bench: Bench
) -> None:
    assert not raised(planner, lying(product, bench, "o3", 0.0))
    assert raised(planner, lying(product, bench, "o3", 0.04))
    assert raised(planner, lying(product, bench, "o3", 0.0, lies_on=(CARRIER,)))


def test_what_carries_a_part_is_in_the_way_as_it_lies(planner: MotionPlanner, product: Product, bench: Bench) -> None:
    above = lying(product, bench, "o1", 0.05, lies_on=(CARRIER,))
    x, y, z = bench.tray.centre_m
    rest = rest_on(product.parts["o3"], "+y")
    assert rest is not None
    known = PartDetection(
        "o3", 0.9, Pose((x, y, z)), (0.1, 0.1, 0.09), CARRIER, upright=False, lies=Pose((x, y, z)) @ rest
    )
    rough = PartDetection("o3", 0.9, Pose((x, y, z)), (0.1, 0.1, 0.09), CARRIER, upright=False)
    assert len(boxes_around(planner, above, (known,))) == len(product.parts["o3"].whole)
    assert len(boxes_around(planner, above, (rough,))) == 1
