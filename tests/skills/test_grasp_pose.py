"""Laws of grasp and place poses: across width or length, peg over the hole, room for the fingers."""

from __future__ import annotations

import math

import numpy as np
import pytest

from bracket_cell.skills.motion.grasp_pose import (
    fingers_clear,
    fingertips_m,
    footprint,
    gap_m,
    grasps,
    grip_of,
    held_boxes,
    holds,
    hole_pose,
    place_poses,
)
from bracket_cell.skills.motion.settings import MotionSettings
from bracket_ground.interfaces.bench import Bench
from bracket_ground.interfaces.grasping import OFF_MIDDLE_M, places_m
from bracket_ground.interfaces.grip import Grip, Hold
from bracket_ground.interfaces.perception import PartDetection
from bracket_ground.interfaces.pose import Pose
from bracket_ground.interfaces.product import PartType, Product

SETTINGS = MotionSettings()
TYPES = ("o1", "o2", "o3")
HOLDS = [Hold(grip, place) for grip in SETTINGS.gripper.known for place in places_m(grip.axis)]
GRIPS = [("o1", Grip.WIDTH), ("o2", Grip.WIDTH), ("o3", Grip.WIDTH), ("o1", Grip.LENGTH), ("o2", Grip.LENGTH)]


def seen(product: Product, part: str, x: float, y: float, yaw: float) -> PartDetection:
    kind = product.parts[part]
    pose = Pose.from_yaw((x, y, 0.004 + kind.peg_length_m), yaw)
    return PartDetection(part, 1.0, pose, kind.size_m, (0, 0, 0, 0))


def test_the_stroke_decides_across_which_sides_a_part_fits(product: Product) -> None:
    for part in TYPES:
        grips = SETTINGS.gripper.grips(product.parts[part], SETTINGS.least_finger_clearance_m)
        assert [(part, grip) for grip in grips] == [entry for entry in GRIPS if entry[0] == part]


@pytest.mark.parametrize(("part", "grip"), GRIPS)
def test_the_opening_tells_how_a_part_is_held(product: Product, part: str, grip: Grip) -> None:
    kind = product.parts[part]
    held_m = grip.held_m(kind, fingertips_m(kind, grip, SETTINGS))
    assert held_m <= grip.span_m(kind) + 1e-9
    assert all(grip_of(kind, held_m + error, SETTINGS) is grip for error in (-0.002, 0.0, 0.002))


def test_fingers_reach_down_to_what_is_between_them(product: Product) -> None:
    ends = [{"solid": "box", "size_m": (0.01, 0.03, 0.05), "centre_m": (x, 0.0, 0.025)} for x in (-0.035, 0.035)]
    web = {"solid": "box", "size_m": (0.06, 0.016, 0.02), "centre_m": (0.0, 0.0, 0.01)}
    yoke = {"size_m": (0.08, 0.03, 0.05), "shape": [*ends, web]}
    kind = PartType.model_validate(product.parts["o1"].model_dump() | yoke)
    plain = PartType.model_validate(product.parts["o1"].model_dump() | yoke | {"shape": "box"})
    assert Grip.WIDTH.top_m(kind) == pytest.approx(0.02)
    assert Grip.WIDTH.held_m(kind, fingertips_m(kind, Grip.WIDTH, SETTINGS)) == pytest.approx(0.016)
    assert Grip.WIDTH.top_m(plain) == pytest.approx(0.05)
    assert Grip.WIDTH.held_m(plain, fingertips_m(plain, Grip.WIDTH, SETTINGS)) == pytest.approx(0.03)


@pytest.mark.parametrize(("part", "grip"), GRIPS)
@pytest.mark.parametrize("yaw", [-3.0, -1.0, 0.0, 0.7, 2.5])
def test_fingers_close_across_the_chosen_sides_from_above(product: Product, part: str, grip: Grip, yaw: float) -> None:
    detection = seen(product, part, 0.5, -0.4, yaw)
    kind = product.parts[part]
    for grasp in (one for hold in holds(kind, grip, SETTINGS) for one in grasps(detection, kind, SETTINGS, hold)):
        tool = grasp.world_from_tool.rotation
        np.testing.assert_allclose(tool[:, 2], (0, 0, -1), atol=1e-9)
        across = tool[:, 0] @ detection.world_from_part.rotation[:, 1 if grip is Grip.WIDTH else 0]
        assert abs(across) == pytest.approx(1.0)
        assert grip.span_m(kind) + 2 * SETTINGS.least_finger_clearance_m <= grasp.opening_m <= SETTINGS.gripper.stroke_m
        fingertip_m = grasp.world_from_tool.position_m[2] - SETTINGS.robot.gripper.fingertip_beyond_tcp_m
        bottom_m = detection.world_from_part.position_m[2]
        assert bottom_m < fingertip_m < bottom_m + kind.size_m[2]


@pytest.mark.parametrize(("part", "grip"), GRIPS)
def test_the_two_grasps_are_half_a_turn_apart(product: Product, part: str, grip: Grip) -> None:
    half_turn = Pose((0.0, 0.0, 0.0), (0.0, 0.0, 0.0, 1.0))
    for place in places_m(grip.axis):
        detection = seen(product, part, 0.5, -0.4, 0.3)
        first, second = grasps(detection, product.parts[part], SETTINGS, Hold(grip, place))
        np.testing.assert_allclose((first.world_from_tool @ half_turn).matrix, second.world_from_tool.matrix, atol=1e-9)


@pytest.mark.parametrize(("part", "grip"), GRIPS)
@pytest.mark.parametrize("position", ["p1", "p4", "p6"])
def test_a_held_part_comes_to_rest_over_its_hole(
    product: Product, bench: Bench, part: str, grip: Grip, position: str
) -> None:
    kind = product.parts[part]
    target = hole_pose(product, bench, position)
    for hold, half in ((hold, half) for hold in HOLDS if hold.grip is grip for half in (0, 1)):
        tool = place_poses(target, kind, SETTINGS, hold)[half]
        body, peg = held_boxes(part, kind, SETTINGS, hold, with_peg=True)
        world_body, world_peg = tool @ body.pose, tool @ peg.pose
        np.testing.assert_allclose(world_peg.position_m[:2], target.position_m[:2], atol=1e-9)
        bottom_m = world_body.position_m[2] - kind.size_m[2] / 2
        assert bottom_m == pytest.approx(target.position_m[2] + SETTINGS.release_gap_m)
        # Its length lies across the row of holes, which runs along y.
        assert abs(world_body.rotation[0, 0]) == pytest.approx(1.0)


@pytest.mark.parametrize("half", [0, 1])
@pytest.mark.parametrize(
    ("part", "grip", "number"), [(*way, n) for way in GRIPS for n in range(len(places_m(way[1].axis)))]
)
def test_picking_then_placing_turns_a_part_as_the_tool_turns(
    product: Product, bench: Bench, part: str, grip: Grip, number: int, half: int
) -> None:
    kind = product.parts[part]
    detection = seen(product, part, 0.5, -0.4, 0.8)
    grasp = grasps(detection, kind, SETTINGS, Hold(grip, places_m(grip.axis)[number]))[half]
    half_turn = Pose.from_yaw((0.0, 0.0, 0.0), math.pi * half)
    tool_from_part = grasp.world_from_tool.inverse() @ detection.world_from_part @ half_turn
    target = hole_pose(product, bench, "p2")
    for turned, tool in enumerate(place_poses(target, kind, SETTINGS, grasp.hold)):
        placed = tool @ tool_from_part @ Pose.from_yaw((0.0, 0.0, 0.0), math.pi * turned)
        lifted = Pose((0.0, 0.0, SETTINGS.release_gap_m)) @ target
        np.testing.assert_allclose(placed.matrix, lifted.matrix, atol=1e-9)
    held = held_boxes(part, kind, SETTINGS, grasp.hold, with_peg=False)[0]
    middle = tool_from_part @ Pose((0.0, 0.0, kind.size_m[2] / 2))
    np.testing.assert_allclose(held.pose.matrix, middle.matrix, atol=1e-9)


@pytest.mark.parametrize("grip", Grip)
def test_boxes_of_a_part_that_may_be_held_anywhere_hold_all_that_it_may_fill(product: Product, grip: Grip) -> None:
    kind = product.parts["o2"]

    def corners(hold: Hold) -> list[tuple[float, float]]:
        boxes = held_boxes("o2", kind, SETTINGS, hold, with_peg=True)
        ends = [(box.pose.position_m[1], abs(box.pose.rotation[1]) @ np.array(box.size_m) / 2) for box in boxes]
        return [(middle - half, middle + half) for middle, half in ends]

    unsure = corners(Hold(grip, unsure_m=OFF_MIDDLE_M[grip.axis]))
    for place in places_m(grip.axis):
        for (low, high), (least, most) in zip(corners(Hold(grip, place)), unsure, strict=True):
            assert least - 1e-9 <= low < high <= most + 1e-9


def test_a_part_that_is_thin_in_its_middle_is_held_there_alone(product: Product) -> None:
    ends = [{"solid": "box", "size_m": (0.01, 0.03, 0.05), "centre_m": (x, 0.0, 0.025)} for x in (-0.02, 0.02)]
    web = {"solid": "box", "size_m": (0.03, 0.016, 0.05), "centre_m": (0.0, 0.0, 0.025)}
    spool = {"size_m": (0.05, 0.03, 0.05), "shape": [*ends, web]}
    kind = PartType.model_validate(product.parts["o1"].model_dump() | spool)
    assert holds(kind, Grip.WIDTH, SETTINGS) == (Hold(Grip.WIDTH),)
    for name, grip in GRIPS:
        assert [hold.place_m for hold in holds(product.parts[name], grip, SETTINGS)] == [*places_m(grip.axis)]


def test_neighbours_leave_room_or_do_not(product: Product) -> None:
    part = seen(product, "o1", 0.5, -0.4, 0.0)
    grasp = grasps(part, product.parts["o1"], SETTINGS, Hold(Grip.WIDTH))[0]

    def clear(*others: PartDetection) -> bool:
        return fingers_clear(grasp, others, SETTINGS)

    assert clear()
    assert not clear(seen(product, "o1", 0.5, -0.36, 0.0))
    assert clear(seen(product, "o1", 0.5, -0.34, 0.0))
    assert clear(seen(product, "o1", 0.55, -0.4, 0.0))
    assert not clear(seen(product, "o1", 0.5, -0.34, 0.0), seen(product, "o2", 0.5, -0.44, 0.5))


def test_fingers_pass_over_low_neighbours_of_a_tall_part(product: Product) -> None:
    tall = seen(product, "o3", 0.5, -0.4, 0.0)
    grasp = grasps(tall, product.parts["o3"], SETTINGS, Hold(Grip.WIDTH))[0]
    low = seen(product, "o1", 0.5, -0.36, 0.0)
    assert fingers_clear(grasp, [low], SETTINGS)
    assert not fingers_clear(grasp, [seen(product, "o3", 0.5, -0.355, 0.0)], SETTINGS)


def test_of_two_parts_side_by_side_each_has_room_across_its_length_alone(product: Product) -> None:
    first, second = seen(product, "o1", 0.5, -0.4, 0.0), seen(product, "o1", 0.5, -0.366, 0.0)
    for part, other in ((first, second), (second, first)):
        room = {}
        for grip in SETTINGS.gripper.known:
            grasp = grasps(part, product.parts[part.part], SETTINGS, Hold(grip))[0]
            room[grip] = fingers_clear(grasp, [other], SETTINGS)
        assert room == {Grip.WIDTH: False, Grip.LENGTH: True}


@pytest.mark.parametrize("seed", range(10))
def test_gap_is_symmetric_and_moves_with_the_parts(product: Product, seed: int) -> None:
    rng = np.random.default_rng(seed)
    first = seen(product, "o1", rng.uniform(0.4, 0.6), rng.uniform(0.4, 0.6), rng.uniform(-math.pi, math.pi))
    second = seen(product, "o3", rng.uniform(0.4, 0.6), rng.uniform(0.4, 0.6), rng.uniform(-math.pi, math.pi))
    gap = gap_m(footprint(first), footprint(second))
    assert gap_m(footprint(second), footprint(first)) == pytest.approx(gap)
    shift = np.array([0.1, -0.2])
    assert gap_m(footprint(first) + shift, footprint(second) + shift) == pytest.approx(gap)
    assert gap_m(footprint(first), footprint(first)) < 0
