"""An arm that is too near to a hand may leave it, slowly; it may not come nearer, nor move if too little is known."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from bracket_cell.skills.motion.known_bench import EDGES
from bracket_cell.skills.motion.person_space import Person
from bracket_cell.skills.motion.planner import Load
from bracket_cell.skills.motion.separation import Following, Separation
from bracket_cell.skills.motion.trajectory import joined, joint_move
from bracket_ground.interfaces.command import JointTrajectory
from bracket_ground.interfaces.perception import HandSample
from bracket_ground.interfaces.pose import Array
from tests.integration.cell_rig import BENCH, motion_planner
from tests.skills.test_separation import persons

PLANNER = motion_planner()
MONITOR = PLANNER.separation
S = MONITOR.settings
AGE_S = 0.15
MARGIN_M = S.hand_error_m + MONITOR.arm_error_m
PARK = np.array(BENCH.arm_park_rad)
OVER_P2_RAD = np.array([0.131, -1.315, 1.9, -2.155, -1.571, 0.131])  # over the bracket, lowering into the hole p2


def judge(joints: Array, hand: HandSample, age_s: float, holding: bool, ahead: Following | None = None) -> Separation:
    person = Person(MONITOR.persons.wall(hand), age_s, S.hand_speed_m_s, hand.velocity_m_s)
    return MONITOR.judge(joints, [person], holding, ahead)


def line(by_m: float) -> JointTrajectory:
    """The tool over the bracket towards the person, or back."""
    start = PLANNER.kinematics.forward(OVER_P2_RAD)
    x, y, z = start.position_m
    plan = PLANNER.straight_move(OVER_P2_RAD, replace(start, position_m=(x + by_m, y, z)), Load(0.05, close=True))
    assert not isinstance(plan, str)
    return plan


def to_park(start_rad: Array) -> JointTrajectory:
    return joint_move(start_rad, PARK, PLANNER.settings)


TOWARDS, STRAIGHT_BACK = line(0.06), line(-0.2)
AWAY = joined([STRAIGHT_BACK, to_park(STRAIGHT_BACK.positions_rad[-1])])
SWEEPING = to_park(OVER_P2_RAD)  # turned about the arm's base, the tool comes nearer to the person first


def hand(x_m: float, y_m: float, velocity: tuple[float, float] | None = (0.0, 0.0)) -> HandSample:
    return HandSample(0.0, (100, 100, 200, 200), (x_m, y_m), (x_m + 0.1, y_m), velocity_m_s=velocity, height_m=0.15)


def beside(room_m: float, velocity: tuple[float, float] | None = (0.0, 0.0)) -> HandSample:
    """A hand so far towards the person from the arm over the bracket."""
    tool = PLANNER.kinematics.forward(OVER_P2_RAD).position_m
    far, near = 1.2, tool[0]
    for _ in range(40):
        middle = (far + near) / 2
        room = judge(OVER_P2_RAD, hand(middle, tool[1], velocity), AGE_S, False).distance_m
        far, near = (middle, near) if room > room_m else (far, middle)
    return hand(far, tool[1], velocity)


def judged(hand: HandSample, path: JointTrajectory | None, joints: Array = OVER_P2_RAD) -> Separation:
    return judge(joints, hand, AGE_S, False, None if path is None else (path, 0.0))


def test_a_near_hand_lets_the_arm_go_away_and_nowhere_else() -> None:
    near = beside(0.045)
    assert judged(near, None).distance_m < judged(near, None).least_m
    assert judged(near, AWAY).retreat_scale > 0
    assert judged(near, None).retreat_scale == 0
    assert judged(near, TOWARDS).retreat_scale == 0
    assert judged(near, SWEEPING).retreat_scale == 0
    returns = joint_move(PARK, OVER_P2_RAD, PLANNER.settings)
    assert judged(near, joined([AWAY, returns])).retreat_scale == 0


def test_a_path_that_leads_away_only_in_the_end_is_refused() -> None:
    """All of the way counts, not where it ends."""
    assert judged(beside(0.06), joined([TOWARDS, to_park(TOWARDS.positions_rad[-1])])).retreat_scale == 0


def test_a_path_that_stays_where_it_is_leads_nowhere() -> None:
    stays = JointTrajectory(np.array([0.0, 1.0]), np.array([OVER_P2_RAD, OVER_P2_RAD]))
    assert judged(beside(0.045), stays).retreat_scale == 0


def test_what_touches_or_may_touch_already_does_not_move() -> None:
    """Within the margin by which positions may be off, nobody knows which way is away."""
    assert judged(beside(MARGIN_M + 0.005), AWAY).retreat_scale > 0
    assert judged(beside(MARGIN_M - 0.002), AWAY).retreat_scale == 0
    tool = PLANNER.kinematics.forward(OVER_P2_RAD).position_m
    assert judged(hand(tool[0], tool[1]), AWAY).retreat_scale == 0


@given(st.floats(0.0, 1.6), st.floats(0.0, 6.28), st.floats(0.0, 0.5))
@settings(max_examples=30, deadline=None)
def test_a_hand_that_could_be_there_meanwhile_holds_the_arm(speed: float, heading: float, age_s: float) -> None:
    near = beside(0.05, (speed * float(np.cos(heading)), speed * float(np.sin(heading))))
    found = judge(OVER_P2_RAD, near, age_s, False, (AWAY, 0.0))
    if found.distance_m < MARGIN_M + speed * (age_s + S.reaction_s) and found.distance_m < found.least_m:
        assert found.retreat_scale == 0


def test_unknown_is_never_good() -> None:
    """A hand whose speed is not known yet, and a hand that left the view."""
    assert judged(beside(0.045, None), AWAY).retreat_scale == 0
    for edge in EDGES:
        gone = MONITOR.persons.behind(edge, AGE_S, left=edge != MONITOR.persons.edge)
        found = MONITOR.judge(OVER_P2_RAD, [gone], False, (AWAY, 0.0))
        assert found.retreat_scale == (found.distance_m >= found.least_m + S.hysteresis_m), edge


def test_of_several_hands_the_one_that_forbids_it_counts() -> None:
    tool = PLANNER.kinematics.forward(OVER_P2_RAD).position_m
    behind = hand(tool[0] - 0.10, tool[1] - 0.20)  # on the way to the parking place
    near, far, behind_it = (persons([one], (), AGE_S)[0] for one in (beside(0.045), hand(1.25, -0.6), behind))

    def leaving(*persons: Person) -> float:
        return MONITOR.judge(OVER_P2_RAD, persons, False, (AWAY, 0.0)).retreat_scale

    assert leaving(near, far) == leaving(near) > 0
    assert leaving(behind_it) == leaving(near, far, behind_it) == 0


@pytest.mark.parametrize("path_s", [0.0, 0.2, 0.4])
def test_it_is_slow_for_as_long_as_the_hand_is_near(path_s: float) -> None:
    """At the share that is allowed no point of the arm is faster than the setting, while a tick and a reaction pass."""
    joints = AWAY.at(path_s)
    tool = PLANNER.kinematics.forward(OVER_P2_RAD).position_m
    for x_m in np.arange(tool[0], 1.2, 0.02):
        found = judge(joints, hand(float(x_m), tool[1]), AGE_S, False, (AWAY, path_s))
        if not 0 < found.retreat_scale < 1:
            continue
        times_s = path_s + np.arange(0.0, 0.12, 0.01)
        corners = MONITOR.outline.corners_m(MONITOR.outline.placed(np.array([AWAY.at(float(one)) for one in times_s])))
        fastest = np.linalg.norm(np.diff(corners, axis=0), axis=3).max() / 0.01 * found.retreat_scale
        assert fastest <= S.leaving_m_s * 1.25


def test_it_can_be_turned_off() -> None:
    off = S.model_copy(update={"leaving_m_s": 0.0})
    planner = type(PLANNER)(PLANNER.product, BENCH, PLANNER.settings.model_copy(update={"separation": off}))
    near = Person(MONITOR.persons.wall(beside(0.045)), AGE_S, S.hand_speed_m_s, (0.0, 0.0))
    assert MONITOR.judge(OVER_P2_RAD, [near], False, (AWAY, 0.0)).retreat_scale > 0
    assert planner.separation.judge(OVER_P2_RAD, [near], False, (AWAY, 0.0)).retreat_scale == 0
