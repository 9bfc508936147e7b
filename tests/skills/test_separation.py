"""Separation: each term counts as it should; nearer, later known or faster never lets the arm be faster."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import coal
import numpy as np
import pinocchio
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from bracket_cell.learned.classical.track_health import motion_of
from bracket_cell.skills.motion import arm_outline
from bracket_cell.skills.motion.arm_outline import OUTLINE
from bracket_cell.skills.motion.collision import CollisionChecker
from bracket_cell.skills.motion.known_bench import EDGES, KnownBench
from bracket_cell.skills.motion.person_space import Person, PersonSpace
from bracket_cell.skills.motion.planner import MotionPlanner
from bracket_cell.skills.motion.separation import Following, Separation, SeparationMonitor, arrival_s
from bracket_cell.skills.motion.trajectory import joint_move
from bracket_ground.interfaces.bench import Obstacle
from bracket_ground.interfaces.command import JointTrajectory
from bracket_ground.interfaces.perception import WITHIN, Action, BenchView, Edge, HandSample
from bracket_ground.interfaces.pose import Pose
from tests.integration.cell_rig import BENCH, PRODUCT, motion_planner, robot_alone

MONITOR = motion_planner().separation
S = MONITOR.settings
PARK, LOOK = np.array(BENCH.arm_park_rad), np.array(BENCH.arm_look_rad)
LOWERING_RAD = np.array([0.131, -1.315, 1.9, -2.155, -1.571, 0.131])  # into the hole p2
SECONDS = st.floats(0.0, 0.6)
SPEEDS = st.floats(0.0, 1.6)
PLACES = st.floats(0.5, 1.2)
PATHS = st.floats(0.1, 1.6)
ACROSS = joint_move(PARK, LOWERING_RAD, motion_planner().settings)


def hand(x_m: float, y_m: float, velocity: tuple[float, float] | None = (0.0, 0.0)) -> HandSample:
    return HandSample(0.0, (0, 0, 9, 9), (x_m, y_m), (x_m + 0.1, y_m), velocity_m_s=velocity)


def judge(
    joints: np.ndarray, hand: HandSample, age_s: float, holding: bool, ahead: Following | None = None
) -> Separation:
    person = persons([hand], (), age_s)[0]
    return MONITOR.judge(joints, [person], holding, ahead)


def persons(hands: Sequence[HandSample], left_by: Sequence[Edge], age_s: float) -> list[Person]:
    view = BenchView(0, 0.0, None, {}, Action("idle", 1.0), other_hands=tuple(hands), left_by=tuple(left_by))
    return MONITOR.persons.of(KnownBench(MONITOR.persons.view_range, view, age_s))


def judge_beyond(edge: Edge, ahead: Following) -> Separation:
    return MONITOR.judge(PARK, [MONITOR.persons.behind(edge, 0.15, left=edge != MONITOR.persons.edge)], False, ahead)


def speed_towards_person(speed_m_s: float) -> tuple[float, float]:
    return (-speed_m_s, 0.0)


@given(SECONDS, SECONDS, SPEEDS, SPEEDS, PLACES, PATHS)
@settings(max_examples=40, deadline=None)
def test_later_known_or_faster_is_never_faster_for_the_arm(
    t1: float, t2: float, v1: float, v2: float, x: float, path_s: float
) -> None:
    ahead = (ACROSS, path_s)
    joints = ACROSS.at(path_s)
    best = judge(joints, hand(x, 0.1, speed_towards_person(min(v1, v2))), min(t1, t2), False, ahead)
    worst = judge(joints, hand(x, 0.1, speed_towards_person(max(v1, v2))), max(t1, t2), False, ahead)
    assert worst.speed_scale <= best.speed_scale
    assert worst.distance_m - worst.least_m <= best.distance_m - best.least_m  # of the link that has the least room
    assert worst.speed_scale > 0


def with_settings(**changes: object) -> SeparationMonitor:
    settings, planner = motion_planner().settings, motion_planner()
    changed = settings.model_copy(update={"separation": S.model_copy(update=changes)})
    return type(planner)(planner.product, BENCH, changed).separation


@pytest.mark.parametrize("hand_m_s", [1.6, 2.0])
@pytest.mark.parametrize("age_s", [0.0, 0.1, 0.24])
def test_the_protective_distance_is_that_of_the_technical_specification(hand_m_s: float, age_s: float) -> None:
    """ISO/TS 15066, 5.5.4.2.3, Eq. 1 with Eq. 3 (v_h constant), Eq. 5 (v_r constant) and a braking that is even."""
    reacts_s = age_s + S.reaction_s  # T_r, from the exposure for the hand, from the answer for the arm
    stops_s = S.slow_m_s / S.braking_m_s2  # T_s
    s_h = hand_m_s * (reacts_s + stops_s)
    s_r, s_s = S.slow_m_s * S.reaction_s, S.slow_m_s**2 / (2 * S.braking_m_s2)
    z_d, z_r = S.hand_error_m, MONITOR.arm_error_m
    assert MONITOR.protective_m(hand_m_s, age_s) == pytest.approx(s_h + s_r + s_s + z_d + z_r)


@given(st.floats(0.0, 12.0), st.floats(0.0, 0.3))
@settings(max_examples=40, deadline=None)
def test_a_hand_that_speeds_up_evenly_is_where_the_protective_distance_has_it(haste: float, age_s: float) -> None:
    """From rest at the first of the frames that its speed is measured over; never faster than hands are."""
    window_s = 3 / BENCH.overhead.rate_hz
    takes_s = age_s + S.reaction_s + S.slow_m_s / S.braking_m_s2
    times_s = np.linspace(0.0, takes_s, 4001)
    speeds = np.minimum(haste * (window_s + times_s), S.hand_speed_m_s)
    way_m = np.trapezoid(speeds, times_s)
    coming = hand(0.9, -0.5, speed_towards_person(haste * window_s / 2))
    tool = BENCH.arm_park_rad
    found_m = judge(np.array(tool), coming, age_s, False).least_m - MONITOR.protective_m(0.0, age_s)
    assert found_m >= way_m - 1e-3
    if speeds[-1] < S.hand_speed_m_s or speeds[0] == S.hand_speed_m_s:
        assert found_m == pytest.approx(way_m, rel=0.1), "the way to the arm is not quite that of the hand"


@given(st.floats(0.0, 1.0), st.floats(0.0, 12.0), st.floats(0.0, 0.3))
@settings(max_examples=40, deadline=None)
def test_a_hand_goes_on_as_its_last_frames_have_it(start_m_s: float, haste: float, age_s: float) -> None:
    """Where its acceleration is told; a hand of even speed keeps it, and one that begins to move is not even."""
    window_s = 3 / BENCH.overhead.rate_hz
    takes_s = age_s + S.reaction_s + S.slow_m_s / S.braking_m_s2
    ways = np.array([[-1.0, 0.0, 0.0]])
    coming = Person(MONITOR.persons.wall(hand(0.9, 0.0)), age_s, 1.6, (-start_m_s, 0.0), (-haste, 0.0))
    now_m_s = start_m_s + haste * window_s / 2
    expected = min(now_m_s + haste * takes_s / 2, max(S.hand_speed_m_s, start_m_s))
    assert float(coming.coming_m_s(ways, takes_s, window_s)[0]) == pytest.approx(expected)
    slows = replace(coming, acceleration_m_s2=(haste, 0.0))
    assert float(slows.coming_m_s(ways, takes_s, window_s)[0]) == pytest.approx(start_m_s)


def test_a_hand_that_turns_in_its_place_needs_no_more_room_than_one_that_goes_so_fast() -> None:
    """A screwdriver's handle goes to and fro by 8 cm twice a second; its tip stays."""
    step_s, tips = 1 / BENCH.overhead.rate_hz, (0.75, 0.34)
    palms = [(0.87, 0.34 + 0.04 * float(np.sin(4 * np.pi * number * step_s))) for number in range(30)]
    for first in range(26):
        velocity, acceleration = motion_of([(k * step_s, np.array([palms[k], tips])) for k in range(first, first + 4)])
        turning = replace(hand(*tips, velocity), palm_m=palms[first + 3], acceleration_m_s2=acceleration)
        found = judge(PARK, turning, 0.16, False)
        assert found.distance_m - found.least_m > S.hysteresis_m


def test_a_hand_that_begins_to_come_counts_more_than_its_mean_speed_says() -> None:
    """It stood for two frames and went 2 cm in the third."""
    step_s, moved_m = 1 / BENCH.overhead.rate_hz, 0.02
    still = [(number * step_s, np.array([[0.9, -0.5], [0.8, -0.5]])) for number in range(3)]
    velocity, acceleration = motion_of([*still, (3 * step_s, np.array([[0.9, -0.5], [0.8, -0.5]]) - [moved_m, 0.0])])
    begins = replace(hand(0.9, -0.5, velocity), acceleration_m_s2=acceleration)
    steady = replace(begins, acceleration_m_s2=(0.0, 0.0))
    least_m = {
        sample: judge(PARK, sample, 0.13, False).least_m for sample in (begins, steady, hand(0.9, -0.5, velocity))
    }
    assert least_m[begins] > 1.5 * least_m[hand(0.9, -0.5, velocity)] > 1.5 * least_m[steady]


@pytest.mark.parametrize(
    ("changes", "more_m"),
    [
        ({"reaction_s": S.reaction_s + 0.1}, 0.1 * (1.6 + S.slow_m_s)),  # S_h and S_r
        ({"slow_m_s": 0.1}, -1.6 * 0.148 / 1.6 - 0.148 * S.reaction_s - (0.248**2 - 0.1**2) / 3.2),  # S_h, S_r, S_s
        ({"hand_error_m": S.hand_error_m + 0.02}, 0.02),  # Z_d
        ({"intrusion_m": S.intrusion_m + 0.05}, 0.0),  # C is in the places beyond the edges
    ],
)
def test_each_term_counts_once(changes: dict[str, float], more_m: float) -> None:
    assert with_settings(**changes).protective_m(1.6, 0.1) == pytest.approx(MONITOR.protective_m(1.6, 0.1) + more_m)


@pytest.mark.parametrize(("deviation_m", "more_m"), [(0.001, 0.0), (0.02, 0.02 * WITHIN - S.hand_error_m)])
def test_a_hand_that_its_tracker_doubts_is_kept_farther_off(deviation_m: float, more_m: float) -> None:
    """Z_d: 95 % of its errors where they are more than the settings say, and never less than those."""
    sure = hand(0.9, -0.5)
    doubted = replace(sure, deviation_m=(deviation_m, deviation_m / 2, 0.1))
    tool = np.array(BENCH.arm_park_rad)
    found, usual = judge(tool, doubted, 0.1, False), judge(tool, sure, 0.1, False)
    assert found.distance_m == usual.distance_m
    assert found.least_m == pytest.approx(usual.least_m + more_m)
    ahead = joint_move(PARK, LOWERING_RAD, motion_planner().settings), 0.0
    shares = [judge(PARK, sample, 0.1, False, ahead).speed_scale for sample in (doubted, sure)]
    assert shares[0] <= shares[1]


def test_the_arm_may_be_off_by_the_tolerance_of_its_joints_at_full_reach() -> None:
    """Z_r: the UR10 reaches 1.3 m from its shoulder, and the tool is beyond."""
    tolerance_rad = motion_planner().settings.arrival_tolerance_rad
    assert 1.3 < MONITOR.arm_error_m / tolerance_rad < 2.2


def test_a_hand_may_be_over_an_edge_by_the_intrusion_distance_before_it_is_found() -> None:
    """C: so much nearer is what may be beyond the edge."""
    deeper = with_settings(intrusion_m=S.intrusion_m + 0.05)
    for edge in ("left", "right", "bottom"):
        rooms = [
            monitor.outline.distances(LOWERING_RAD, monitor.persons.beyond[edge], False)[0].min()
            for monitor in (MONITOR, deeper)
        ]
        assert 0.02 < rooms[0] - rooms[1] < 0.0501


@given(st.floats(0.0, 1.5), st.floats(0.0, 2.5))
@settings(max_examples=40, deadline=None)
def test_a_hand_comes_as_soon_as_even_acceleration_to_its_full_speed_lets_it(room_m: float, speed_m_s: float) -> None:
    """Against the integral of its speed, S_h of Eq. 2."""
    found_s = float(arrival_s(np.array([room_m]), np.array([speed_m_s]), S)[0])
    start, top = speed_m_s + S.speed_error_m_s, max(S.hand_speed_m_s, speed_m_s)
    times_s = np.linspace(0.0, found_s, 2001)
    speeds = np.minimum(start + S.hand_acceleration_m_s2 * times_s, top)
    assert np.trapezoid(speeds, times_s) == pytest.approx(room_m, abs=2e-3)


def test_the_share_is_the_largest_from_which_a_standing_hand_is_kept() -> None:
    """A path along which only the base turns evenly: the time to be slow is reaction and braking of that joint."""
    joints_rad_s, acceleration = 1.0, motion_planner().settings.acceleration_limits_rad_s2[0]
    turned = [LOOK + np.array([joints_rad_s * time_s, 0, 0, 0, 0, 0]) for time_s in (0.0, 2.0)]
    path = JointTrajectory(np.array([0.0, 2.0]), np.array(turned))
    fastest_m_s = MONITOR.settings.slow_m_s / MONITOR.slow_share(path)
    brakes_s = S.reaction_s + (fastest_m_s - S.slow_m_s) / fastest_m_s * joints_rad_s / acceleration
    tool = motion_planner().kinematics.forward(path.at(0.5)).position_m
    hands = (hand(tool[0] + number / 100, tool[1]) for number in range(5, 150))
    found = (judge(path.at(0.5), sample, 0.1, False, (path, 0.5)) for sample in hands)
    least = next(separation for separation in found if separation.speed_scale == 1)
    margin_m = S.hand_error_m + MONITOR.arm_error_m
    comes_s = float(arrival_s(np.array([least.distance_m - margin_m]), np.zeros(1), S)[0]) - 0.1
    assert comes_s == pytest.approx(brakes_s, abs=0.06), "links turn a little towards the hand or away meanwhile"


def test_what_is_far_away_lets_the_arm_go_on_and_what_is_near_does_not() -> None:
    ahead = (ACROSS, 0.5)
    beyond = Person(MONITOR.persons.wall(hand(3.0, 2.0)), 0.15, S.hand_speed_m_s, (0.0, 0.0))
    far = MONITOR.judge(PARK, [beyond], False, ahead)
    near = judge(PARK, hand(0.48, -0.50, (-0.2, 0.0)), 0.15, False, ahead)
    assert far.speed_scale >= 1.0
    assert near.speed_scale < 0.5
    assert near.distance_m < near.least_m < far.distance_m


def test_every_link_counts_not_only_the_tool() -> None:
    elbow = hand(0.35, -0.25)
    tool = motion_planner().kinematics.forward(PARK).position_m
    assert np.hypot(tool[0] - 0.35, tool[1] + 0.25) > 0.2
    above = judge(PARK, elbow, 0.15, False)
    assert above.distance_m < 0.35


def test_the_person_stands_behind_the_lower_edge_wherever_the_hand_rests() -> None:
    """x points towards the person, and down in the image, also where the resting hand is nearer to another edge."""
    beside = BENCH.model_copy(update={"hand_rest_m": (1.0, 0.55, 0.1)})
    assert PersonSpace(BENCH, S).edge == PersonSpace(beside, S).edge == "bottom"


@pytest.mark.parametrize("further_m", [0.0, 0.08])
def test_a_resting_hand_lets_the_arm_lower_a_part_into_the_nearest_holes(further_m: float) -> None:
    """The forearm leaves the view towards the person; no finger is out of it. As the small tracker told it."""
    kinematics = motion_planner().kinematics
    over_p2 = kinematics.forward(LOWERING_RAD)
    x, y, z = over_p2.position_m
    joints_rad = kinematics.inverse(replace(over_p2, position_m=(x, y + further_m, z)), LOWERING_RAD)
    assert joints_rad is not None
    resting = HandSample(
        0.0, (405, 253, 470, 356), (1.017, 0.439), (1.123, 0.475), velocity_m_s=(0.001, 0.001), height_m=0.156
    )
    found = judge(joints_rad, resting, 0.24, True)
    assert found.distance_m > found.least_m + S.hysteresis_m


def test_a_hand_is_as_high_as_it_is_told_to_be_also_far_above_the_bench() -> None:
    """Beside the tool at the look, 0.38 m over the bench; fingertips may be higher than the palm."""
    x, y, z = motion_planner().kinematics.forward(LOOK).position_m
    beside = hand(x + 0.05, y)
    for heights in ((z, z - 0.05), (0.1, z)):
        high = replace(beside, height_m=heights[0], fingertips_height_m=heights[1])
        assert judge(LOOK, high, 0.1, False).distance_m < 0.02
    assert judge(LOOK, replace(beside, height_m=0.05, fingertips_height_m=0.05), 0.1, False).distance_m > 0.1


def test_a_held_part_counts() -> None:
    beside = hand(0.56, -0.5)
    assert judge(PARK, beside, 0.1, True).distance_m <= judge(PARK, beside, 0.1, False).distance_m


@pytest.mark.parametrize(("velocity", "coming"), [((-1.0, 0.0), True), ((1.0, 0.0), False)])
def test_a_hand_that_comes_needs_more_room_than_one_that_leaves(velocity: tuple[float, float], coming: bool) -> None:
    still = judge(PARK, hand(0.9, -0.5, (0.0, 0.0)), 0.15, False)
    moving = judge(PARK, hand(0.9, -0.5, velocity), 0.15, False)
    assert moving.least_m > still.least_m
    assert (moving.least_m - still.least_m > 0.2) == coming


def test_a_hand_of_unknown_speed_counts_as_the_fastest() -> None:
    unknown = judge(PARK, hand(0.9, -0.5, None), 0.15, False)
    assert unknown.least_m == pytest.approx(MONITOR.protective_m(S.hand_speed_m_s, 0.15))


def test_the_whole_tray_is_in_view_and_what_lies_beyond_it_is_known_to_be_out_of_it() -> None:
    motion = motion_planner()
    seen = {}
    for y in (-0.75, -0.55, -0.45, 0.10):
        pose = motion.kinematics.forward(LOOK)
        joints = motion.kinematics.inverse(Pose((0.56, y, 0.15), pose.quaternion_wxyz), LOOK)
        assert joints is not None
        seen[y] = not MONITOR.out_of_view(joints)
    assert seen == {-0.75: False, -0.55: True, -0.45: True, 0.10: True}


def test_behind_an_obstacle_a_hand_beside_the_tool_is_not_seen() -> None:
    wall = Obstacle(name="a wall", position_m=(0.62, -0.10, 0.25), box_m=(0.3, 0.02, 0.5))
    bench, joints = BENCH.model_copy(update={"obstacles": (wall,)}), np.array(BENCH.arm_look_rad)
    monitor = MotionPlanner(PRODUCT, bench).separation
    for y, hidden in ((-0.16, True), (-0.40, False)):
        at = motion_planner().kinematics.inverse(Pose((0.56, y, 0.15), (0.0, 1.0, 0.0, 0.0)), joints)
        assert at is not None
        assert not MONITOR.out_of_view(at)
        assert monitor.out_of_view(at) == hidden


def test_a_hand_that_left_by_an_edge_may_be_anywhere_beyond_it() -> None:
    """Where the person stands, the arm is slow; beyond any other edge a hand may come at once, and the arm waits."""
    ahead = (joint_move(PARK, LOOK, motion_planner().settings), 0.5)
    beyond = {edge: judge_beyond(edge, ahead) for edge in EDGES}
    assert beyond["left"].distance_m < beyond["left"].least_m
    assert beyond[PersonSpace(BENCH, S).edge].distance_m == np.inf
    both = MONITOR.judge(PARK, persons((), EDGES, 0.15), False, ahead)
    assert both.speed_scale == min(separation.speed_scale for separation in beyond.values())


def test_a_hand_that_is_not_seen_may_come_over_the_persons_edge_whatever_else_is_seen() -> None:
    space, one, other = MONITOR.persons, hand(1.2, 0.4), hand(1.2, 0.3)
    for seen in ((), (one,), (one, one)):  # a hand that is told twice is one
        assert space.beyond[space.edge] in [person.body for person in persons(seen, (), 0.1)]
    assert len(persons((one, other), (), 0.1)) == 2, "both hands are seen"


@given(st.floats(0.0, S.hand_height_m), st.floats(-0.3, 0.5), st.floats(0.5, 1.1))
@settings(max_examples=50, deadline=None)
def test_a_hand_of_any_height_is_within_the_wall_that_its_image_makes(height: float, y: float, x: float) -> None:
    """The tracker takes every hand to be at one height; the wall is where it may be at all of them."""
    eye = np.array(BENCH.overhead.mount.position_m)
    scale = (eye[2] - S.assumed_height_m) / (eye[2] - height)
    true = np.array([[x, y], [x + 0.1, y]])
    told = eye[:2] + (true - eye[:2]) * scale
    wall = PersonSpace(BENCH, S).wall(HandSample(0.0, (100, 100, 200, 200), tuple(told[0]), tuple(told[1])))
    request, result = coal.DistanceRequest(), coal.DistanceResult()
    dot = coal.Transform3s(np.eye(3), np.array([*true.mean(axis=0), height]))
    assert coal.distance(coal.Sphere(0.001), dot, wall, coal.Transform3s(), request, result) <= 1e-6


def apart_m(body: coal.Convex, x: float, y: float, z: float) -> float:
    at, request, result = (
        coal.Transform3s(np.eye(3), np.array([x, y, z])),
        coal.DistanceRequest(),
        coal.DistanceResult(),
    )
    return float(coal.distance(coal.Sphere(0.001), at, body, coal.Transform3s(), request, result))


def test_an_elbow_may_be_as_high_as_a_forearm_that_rises_by_45_degrees() -> None:
    told = replace(hand(0.7, 0.1), height_m=0.05)
    bodies = [person.body for person in persons([told], (), 0.1) if person.velocity_m_s is not None]
    for back_m in (0.0, 0.1, 0.25):
        assert min(apart_m(body, 0.8 + back_m, 0.1, 0.05 + back_m) for body in bodies) <= 0.0
    assert min(apart_m(body, 0.7, 0.1, 0.05 + 0.3) for body in bodies) > 0.05, "over fingertips there is no elbow"


@pytest.mark.parametrize(("told_deg", "wide"), [(0, False), (25, False), (-25, False), (40, True), (-110, True)])
@pytest.mark.parametrize("height_m", [None, 0.05])
@pytest.mark.parametrize("side", [1, -1])
def test_a_forearm_that_no_wrist_bends_to_may_be_to_either_side(
    told_deg: float, wide: bool, height_m: float | None, side: int
) -> None:
    """It is hidden, and guessed: it was told up to 160 degrees off, where the fingers told it within 29."""
    told = replace(hand(0.9, 0.1), forearm_rad=math.radians(told_deg), height_m=height_m)
    assert told.forearm_guessed == wide
    bodies = [person.body for person in persons([told], (), 0.1) if person.velocity_m_s is not None]
    off_m = min(apart_m(body, 1.0 + 0.35 * math.cos(0.5), 0.1 + side * 0.35 * math.sin(0.5), 0.05) for body in bodies)
    assert (off_m <= 1e-6) == wide


@pytest.mark.parametrize(("palm_x_m", "leans"), [(1.1, False), (0.98, False), (0.9, True), (0.7, True)])
def test_who_reaches_far_over_the_bench_leans_in_with_the_head(palm_x_m: float, leans: bool) -> None:
    """A small person's palm is .35 m before the chest; the view ends at 1.31 m."""
    reaching = hand(palm_x_m - 0.1, 0.1)
    resting = hand(1.1, 0.4)
    heads = [one.body for one in persons([reaching, resting], (), 0.1) if apart_m(one.body, 1.35, 0.1, 0.8) <= 0.0]
    assert len(heads) == leans
    for head in heads:
        face_m = palm_x_m + 0.35 - 0.10
        assert apart_m(head, face_m + 0.02, 0.1, 0.8) <= 0.0
        assert apart_m(head, face_m - 0.1, 0.1, 0.8) > 0.05


def test_who_reaches_in_from_another_side_has_no_head_over_the_bench() -> None:
    away = replace(hand(0.7, 0.1), palm_m=(0.6, 0.1))
    assert not [one for one in persons([away], (), 0.1) if apart_m(one.body, 1.0, 0.1, 0.8) <= 0.0]


@given(PLACES, st.floats(-0.2, 0.4), st.floats(0.0, 0.3), SPEEDS, PATHS)
@settings(max_examples=25, deadline=None)
def test_heads_and_elbows_never_free_the_arm(x: float, y: float, z: float, hand_m_s: float, path_s: float) -> None:
    """Beside the wall of the same hand alone, and whoever may come over the edge."""
    told = replace(hand(x, y, speed_towards_person(hand_m_s)), height_m=z)
    all_of_it = persons([told], (), 0.15)
    plain = [person for person in all_of_it if person.body is all_of_it[0].body or person.velocity_m_s is None]
    ahead = ACROSS, path_s
    whole, less = (MONITOR.judge(ACROSS.at(path_s), people, False, ahead) for people in (all_of_it, plain))
    assert whole.speed_scale <= less.speed_scale
    assert whole.spare_m <= less.spare_m + 1e-6


@pytest.mark.long
@pytest.mark.parametrize("gone", [0.2, 0.45, 0.65, 0.85])
@pytest.mark.parametrize("goal", [LOOK, LOWERING_RAD], ids=["look", "over the bracket"])
@pytest.mark.parametrize("x_m", [0.75, 0.95, 1.15])
def test_the_simulated_arm_is_slow_wherever_a_hand_that_comes_at_once_could_be(
    gone: float, goal: np.ndarray, x_m: float
) -> None:
    """At the share that is allowed, from anywhere on its way; nobody has told of the hand for the longest time."""
    age_s, person = 0.24, hand(x_m, 0.10)
    trajectory = joint_move(PARK, goal, motion_planner().settings)
    path_s = gone * trajectory.duration_s
    share = judge(trajectory.at(path_s), person, age_s, True, (trajectory, path_s)).speed_scale
    joints = np.array(arm_that_brakes(trajectory, path_s, share))
    wall, outline = PersonSpace(BENCH, S).wall(person), MONITOR.outline
    corners = outline.corners_m(outline.placed(joints))
    speeds = np.linalg.norm(np.diff(corners, axis=0), axis=3).max(axis=2) / PERIOD_S
    for step, row in enumerate(joints[1:]):
        rooms_m, _ = outline.distances(row, wall, True)
        arrives_s = arrival_s(rooms_m, np.zeros(len(rooms_m)), S) - age_s
        assert (arrives_s[speeds[step] > S.slow_m_s + 0.01] > (step + 1) * PERIOD_S).all()


PERIOD_S = 0.008
ARRIVED_S = 20.0  # no path is as long as this, at any share


def arm_that_brakes(trajectory: JointTrajectory, path_s: float, share: float) -> list[np.ndarray]:
    """Joints in every control period from a place of the path on; the order to brake comes a reaction later."""
    found = []
    with robot_alone([], seed=1) as cell:
        arm, clock = cell.arm, cell.devices.clock
        arm.pace(share)
        arm.follow(trajectory)
        while clock.now_s() < ARRIVED_S and (arm.state().path_s or 0.0) < path_s:
            arm.pace(share)
            clock.sleep_until(clock.now_s() + PERIOD_S)
        began_s = clock.now_s()
        while clock.now_s() < began_s + 1.2:
            found.append(np.array(arm.state().positions_rad))
            arm.pace(share if clock.now_s() < began_s + S.reaction_s else 0.0)
            clock.sleep_until(clock.now_s() + PERIOD_S)
    return found


@given(PLACES, st.floats(-0.4, 0.4), SPEEDS, PATHS, st.booleans())
@settings(max_examples=25, deadline=None)
def test_what_is_not_measured_would_change_nothing(
    x_m: float, y_m: float, speed_m_s: float, path_s: float, holding: bool
) -> None:
    seen, ahead = hand(x_m, y_m, speed_towards_person(speed_m_s)), (ACROSS, path_s)
    known = persons([seen], (), 0.1)
    found = MONITOR.judge(ACROSS.at(path_s), known, holding, ahead)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(arm_outline, "bounds_m", lambda corners_m, _: np.full(corners_m.shape[2:], -9.0))
        assert MONITOR.judge(ACROSS.at(path_s), known, holding, ahead) == found


def test_no_distance_is_below_its_bound() -> None:
    rng = np.random.default_rng(5)
    placed = MONITOR.outline.placed(rng.uniform(-2.0, 2.0, (30, 6)))
    for person in persons([hand(0.6, 0.1), hand(0.9, -0.2)], EDGES, 0.1):
        rooms = MONITOR.outline.rooms(placed, person.body, True)
        assert (rooms.distances_m >= rooms.least_m).all()


def test_links_are_placed_as_pinocchio_places_them() -> None:
    outline, rng = MONITOR.outline, np.random.default_rng(3)
    planner = motion_planner()
    checker = CollisionChecker(planner.kinematics, planner.product, planner.bench, planner.settings)
    geometry = checker.arm_with_part(OUTLINE.held_radius_m)
    data, at = checker.model.createData(), geometry.createData()
    paths = rng.uniform(-3.0, 3.0, (20, 6))
    placed = outline.placed(paths)
    for joints, found in zip(paths, placed, strict=True):
        pinocchio.updateGeometryPlacements(checker.model, data, geometry, at, joints)
        wanted = {item.name: at.oMg[number].homogeneous for number, item in enumerate(geometry.geometryObjects)}
        for name, one in zip(outline.names, found, strict=True):
            np.testing.assert_allclose(one, wanted[name], atol=1e-12)


def test_over_an_edge_that_is_open_somebody_else_may_come_at_any_time() -> None:
    """The arm is slow before that; it does not wait there, as nobody was seen to leave."""
    both = [hand(0.9, 0.4), hand(0.9, -0.4)]
    assert len(persons(both, (), 0.1)) == 2
    space = with_settings(open_edges=("top",)).persons
    view = BenchView(0, 0.0, None, {}, Action("idle", 1.0), other_hands=tuple(both))
    *seen, other = space.of(KnownBench(space.view_range, view, 0.1))
    assert (len(seen), other.waited_for) == (2, False)
    left = replace(view, left_by=("top",))
    assert space.of(KnownBench(space.view_range, left, 0.1))[-1].waited_for
