"""Ways around what stands on the bench: found, free, within the limits, the same again; or why there is none."""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from bracket_cell.skills.motion.arm_outline import Rooms
from bracket_cell.skills.motion.beside_person import BesidePerson
from bracket_cell.skills.motion.collision import Box
from bracket_cell.skills.motion.grasp_pose import hole_pose
from bracket_cell.skills.motion.planner import Load, MotionPlanner, settled
from bracket_cell.skills.motion.search import Room
from bracket_cell.skills.motion.trajectory import joint_speeds, limit_ratios
from bracket_cell.skills.pick_and_place import Pick, Place
from bracket_ground.interfaces.bench import Bench, Obstacle
from bracket_ground.interfaces.command import JointTrajectory
from bracket_ground.interfaces.perception import Action, BenchView, HandSample
from bracket_ground.interfaces.pose import Array, Pose
from bracket_ground.interfaces.product import Product
from bracket_ground.interfaces.skill import SkillStatus
from tests.skills.ideal_robot import IdealRobot
from tests.skills.test_skills import seen

DOWN = (0.0, 1.0, 0.0, 0.0)
LOAD = Load(0.04)


def post(height_m: float) -> Obstacle:
    """Between tray and bracket."""
    return Obstacle(name="the camera post", position_m=(0.62, -0.10, height_m / 2), box_m=(0.06, 0.06, height_m))


def with_obstacles(product: Product, bench: Bench, *obstacles: Obstacle) -> MotionPlanner:
    return MotionPlanner(product, bench.model_copy(update={"obstacles": obstacles}))


@pytest.fixture(scope="module")
def behind_a_post(product: Product, bench: Bench) -> MotionPlanner:
    return with_obstacles(product, bench, post(0.50))


def ways(planner: MotionPlanner) -> Iterator[tuple[Array, Array]]:
    """From nine places over the tray to six over holes."""
    near = np.array(planner.bench.arm_look_rad)
    for x in (0.46, 0.56, 0.66):
        for y in (-0.48, -0.38, -0.28):
            start = planner.reach([Pose((x, y, 0.18), DOWN)], near, LOAD)
            assert not isinstance(start, str)
            for hole in planner.product.bracket.holes_m:
                a, b, c = hole_pose(planner.product, planner.bench, hole).position_m
                goal = planner.reach([Pose((a, b, c + 0.16), DOWN)], start[1], LOAD)
                assert not isinstance(goal, str), goal
                yield start[1], goal[1]


def pieces(planner: MotionPlanner, start: Array, goal: Array, load: Load = LOAD) -> tuple[JointTrajectory | str, int]:
    """What is found, and after how many ticks."""
    found = planner.free_way(start, goal, load)
    if isinstance(found, JointTrajectory | str):
        return found, 1
    told = list(found)
    assert told[-1] is not None
    return settled(iter(told)), len(told)


@pytest.mark.long
def test_a_post_between_tray_and_bracket_is_gone_around(behind_a_post: MotionPlanner) -> None:
    planner, asked = behind_a_post, 0
    scene, settings = planner.scene(Load(LOAD.opening_m, close=True)), planner.settings
    for start, goal in ways(planner):
        way, asked = planner.free_move(start, goal, LOAD), asked + 1
        assert isinstance(way, JointTrajectory), way
        assert np.allclose(way.positions_rad[[0, -1]], [start, goal], atol=1e-9)
        assert scene.first_contact(way.positions_rad) is None
        assert limit_ratios(way.times_s, way.positions_rad, settings).max() <= 1.01
        assert np.allclose(joint_speeds(way.times_s, way.positions_rad)[[0, -1]], 0.0, atol=0.02)
        assert way.duration_s < 4.0
    assert asked == 54


def test_the_same_question_has_the_same_answer_however_it_is_cut(behind_a_post: MotionPlanner) -> None:
    for start, goal in list(ways(behind_a_post))[::18]:
        first, second = (pieces(behind_a_post, start, goal) for _ in range(2))
        assert isinstance(first[0], JointTrajectory)
        assert isinstance(second[0], JointTrajectory)
        assert first[1] == second[1]
        assert np.array_equal(first[0].positions_rad, second[0].positions_rad)
        assert np.array_equal(first[0].times_s, second[0].times_s)


def test_a_held_part_is_hardly_tilted_on_a_way_around(behind_a_post: MotionPlanner) -> None:
    held = Load(0.04, held=(Box("o2", Pose((0.0, 0.0, 0.0)), (0.04, 0.034, 0.04)),))
    for start, goal in list(ways(behind_a_post))[::10]:
        way = behind_a_post.free_move(start, goal, held)
        assert isinstance(way, JointTrajectory)
        tilts = [behind_a_post.kinematics.forward(joints).rotation[2, 2] for joints in way.positions_rad[::10]]
        assert max(tilts) < -np.cos(0.75)


def test_a_way_that_is_not_found_says_which_two_things_are_in_the_way(
    behind_a_post: MotionPlanner, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("bracket_cell.skills.motion.search.ways_around", lambda *_, **__: iter(()))
    answers = (pieces(behind_a_post, start, goal)[0] for start, goal in ways(behind_a_post))
    told = next(answer for answer in answers if isinstance(answer, str))
    assert re.fullmatch(r"no free way: [\w ]+ would touch the camera post", told)


def test_an_end_that_is_blocked_is_told_without_a_search(product: Product, bench: Bench) -> None:
    planner = with_obstacles(product, bench, post(0.5))
    goal = planner.kinematics.inverse(Pose((0.62, -0.10, 0.4), DOWN))
    assert goal is not None
    found, ticks = pieces(planner, np.array(bench.arm_look_rad), goal)
    assert isinstance(found, str)
    assert found.endswith("would touch the camera post at the end of the way")
    assert ticks < 6


def test_a_lift_is_tried_before_a_search(product: Product, bench: Bench) -> None:
    low = Obstacle(name="a ledge", position_m=(0.62, -0.10, 0.0875), box_m=(0.2, 0.06, 0.175))
    planner = with_obstacles(product, bench, low)
    start, goal = next(ways(planner))
    found, ticks = pieces(planner, start, goal)
    assert isinstance(found, JointTrajectory)
    assert ticks <= 2


def test_the_arm_waits_while_a_way_is_looked_for(product: Product, bench: Bench) -> None:
    """Some ticks without an order; then the part is placed as ever."""
    planner = with_obstacles(product, bench, post(0.5))
    robot = IdealRobot(bench.arm_look_rad, part_m=0.034)
    assert robot.run(Pick(planner, seen(product, "o2", 0.55, -0.4))).status is SkillStatus.SUCCESS
    assert robot.run(Place(planner, "p4", "o2")).status is SkillStatus.SUCCESS
    scene = planner.scene(Load(0.0, close=True))  # with the part in its hole, which the fingers brought there
    touched = {str(scene.first_contact(way.positions_rad)) for way in robot.trajectories}
    assert touched <= {"None", "finger left would touch o2 in its hole", "finger right would touch o2 in its hole"}


def test_a_search_knows_the_range_of_the_joint_that_follows_from_the_others(behind_a_post: MotionPlanner) -> None:
    """OMPL takes nothing but a bool."""
    look, scene = np.array(behind_a_post.bench.arm_look_rad), behind_a_post.scene(LOAD)
    ends = np.array([look, look + 0.1 * (np.arange(6) == 0)])
    for range_rad, free in ((6.28, True), (1.5, False)):
        room = Room(scene, ends, np.outer([-1, 1], [6.28, 6.28, 3.14, range_rad, 6.28, 6.28]), level=True)
        assert room.is_free(dict(enumerate(room.ends[0].tolist()))) is free


def test_from_low_over_a_hole_the_tool_goes_up_first_whatever_is_known_to_stand_there(planner: MotionPlanner) -> None:
    a, b, c = hole_pose(planner.product, planner.bench, "p4").position_m
    low = planner.reach([Pose((a, b, c + 0.03), DOWN)], np.array(planner.bench.arm_park_rad), Load(0.05, close=True))
    assert not isinstance(low, str), low
    way = planner.free_move(low[1], np.array(planner.bench.arm_park_rad), Load(0.05))
    assert isinstance(way, JointTrajectory), way
    for joints in way.positions_rad:
        x, y, z = planner.kinematics.forward(joints).position_m
        assert z > c + 0.05 or np.hypot(x - a, y - b) < 0.005


@pytest.mark.parametrize("hang_m", [0.0, 0.043])
def test_from_a_low_part_the_way_passes_over_the_highest_that_may_stand_in_the_next_hole(
    planner: MotionPlanner, hang_m: float
) -> None:
    """By the fingers, or by what hangs between them."""
    held = (Box("held", Pose((0.0, 0.0, hang_m / 2)), (0.02, 0.02, hang_m)),) if hang_m else ()
    load, bracket = Load(0.05, (), held), planner.product.bracket.holes_m
    holes = {name: hole_pose(planner.product, planner.bench, name).position_m for name in bracket}
    tallest_m, park = (
        max(part.size_m[2] for part in planner.product.parts.values()),
        np.array(planner.bench.arm_park_rad),
    )
    for name, (a, b, c) in holes.items():
        low = planner.reach([Pose((a, b, c + 0.012 + hang_m), DOWN)], park, Load(0.05, close=True))
        assert not isinstance(low, str), low
        for goal_rad in (park, np.array(planner.bench.arm_look_rad)):
            way = planner.free_move(low[1], goal_rad, load)
            assert isinstance(way, JointTrajectory), way
            for joints in way.positions_rad:
                x, y, z = planner.kinematics.position_m(joints)
                beside = min(np.hypot(x - d, y - e) for other, (d, e, _) in holes.items() if other != name)
                assert z - hang_m > c + tallest_m or beside > 0.045, (name, x, y, z)


def test_beside_a_person_ways_lead_back_first_and_are_sooner_for_that(planner: MotionPlanner) -> None:
    park = np.array(planner.bench.arm_park_rad)
    beside = BesidePerson(planner.separation, planner.kinematics, planner.settings.speed_limits_rad_s)
    for hole in ("p1", "p4"):
        a, b, c = hole_pose(planner.product, planner.bench, hole).position_m
        over = planner.reach([Pose((a, b, c + 0.16), DOWN)], park, LOAD)
        assert not isinstance(over, str), over
        ways = beside.soonest(over[1], park)
        direct = beside.takes_s(np.array([over[1], park]))[0]
        assert len(ways[0]) > 2
        assert beside.takes_s(ways[0])[0] < 0.9 * direct
        back_m = planner.kinematics.forward(ways[0][1]).position_m
        assert back_m[0] < a - 0.1
        assert back_m[1:] == pytest.approx((b, c + 0.16), abs=1e-3)
    far = planner.reach([Pose((0.35, -0.45, 0.3), DOWN)], park, LOAD)
    assert not isinstance(far, str), far
    assert [len(way) for way in beside.soonest(park, far[1])] == [2]


def test_how_long_a_way_takes_needs_few_distances(planner: MotionPlanner, monkeypatch: pytest.MonkeyPatch) -> None:
    """Of a link that nobody could reach in time a bound says enough; the answer is the same as from all distances."""
    beside, rng = planner.beside, np.random.default_rng(4)
    park, look = np.array(planner.bench.arm_park_rad), np.array(planner.bench.arm_look_rad)
    ways = [np.array([park, look + rng.normal(0, 0.3, 6), look + rng.normal(0, 0.6, 6)]) for _ in range(20)]
    measure, measured = Rooms.measure, {}

    def measures(everything: bool) -> tuple[list[tuple[float, float]], int]:
        def counting(rooms: Rooms, wanted: NDArray[np.bool_]) -> None:
            measure(rooms, wanted | everything)
            measured[id(rooms)] = rooms

        measured.clear()
        monkeypatch.setattr(Rooms, "measure", counting)
        takes_s = [beside.takes_s(way) for way in ways]
        return takes_s, sum(int(np.isfinite(rooms.distances_m).sum()) for rooms in measured.values())

    (few_s, few), (all_s, all_of_them) = measures(False), measures(True)
    assert few_s == all_s
    assert len(set(few_s)) == len(ways)
    assert 0 < few < 0.7 * all_of_them


def test_a_hand_that_works_beside_the_way_is_gone_round_and_one_that_passes_is_not(planner: MotionPlanner) -> None:
    beside, park = planner.beside, np.array(planner.bench.arm_park_rad)
    a, b, c = hole_pose(planner.product, planner.bench, "p1").position_m
    start = planner.reach([Pose((0.54, -0.31, 0.15), DOWN)], park, LOAD)
    goal = planner.reach([Pose((a - 0.22, b, c + 0.2), DOWN)], park, LOAD)
    assert not isinstance(start, str)
    assert not isinstance(goal, str)

    def nearest_m(speed_m_s: float) -> float:
        x, y = a + 0.01, b - 0.32  # it screws at p5
        hand = HandSample(0.0, (300, 200, 360, 260), (x, y), (x + 0.12, y + 0.04), height_m=0.1)
        view = BenchView(0, 0.0, replace(hand, velocity_m_s=(0.0, speed_m_s)), {}, Action("screw", 1.0))
        stands = IdealRobot(tuple(start[1])).observe()
        beside.see(replace(stands, time_s=0.1, bench=view))
        way = planner.free_move(start[1], goal[1], LOAD)
        beside.see(stands)
        assert isinstance(way, JointTrajectory), way
        passed_m = [planner.kinematics.position_m(joints)[:2] for joints in way.positions_rad]
        return float(np.linalg.norm(np.array(passed_m) - (x, y), axis=1).min())

    assert nearest_m(0.1) > nearest_m(1.2) + 0.08
