"""Whatever detectors and devices answer: nothing that cannot be makes the arm freer than what can."""

from __future__ import annotations

import math
from dataclasses import fields, replace
from typing import Any

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from bracket_cell.running.device_reader import RobotPoseHistory
from bracket_cell.running.fault_checks import FaultReport
from bracket_cell.running.supervisor import Supervisor, make_supervisor
from bracket_cell.skills.motion.near_hand import separation_of, way_out
from bracket_cell.skills.motion.planner import Load, settled
from bracket_cell.skills.motion.separation import UNKNOWN
from bracket_cell.skills.motion.trajectory import joint_move
from bracket_ground.interfaces.command import Command
from bracket_ground.interfaces.faults import Action, Fault, SafetyDecision
from bracket_ground.interfaces.observation import ArmState, JointSamples, Observation
from bracket_ground.interfaces.operator import OperatorState
from bracket_ground.interfaces.perception import HandSample, HoleView
from bracket_ground.interfaces.pose import Pose
from tests.cell.running.test_supervisor import (
    FOREARM_M,
    GRIPPER,
    SPOILS,
    TABLE,
    TICK_S,
    begun,
    hand_at,
    sound,
    view,
)
from tests.integration.cell_rig import BENCH, motion_planner

PLANNER = motion_planner()
MONITOR = PLANNER.separation
RANGES = MONITOR.persons.view_range.ranges
FAR = hand_at(1.2, 0.4)
ODD_FLOATS = (math.nan, math.inf, -math.inf, 1e308, -1e308, 1e9, -1e9)
NO_NUMBERS: tuple[Any, ...] = ("", "near", b"\0", (), (0.5,), {}, object(), 10**400, np.array([]), np.full(2, np.nan))


def full(hand: HandSample) -> HandSample:
    """The same with every field told."""
    tips = hand.fingertips_m
    more: dict[str, Any] = {
        "thumb_m": tips,
        "index_m": tips,
        "held_m": tips,
        "forearm_rad": 0.0,
        "acceleration_m_s2": (0.0, 0.0),
    }
    return replace(hand, **more, height_m=0.1, fingertips_height_m=0.1)


@st.composite
def hands_that_cannot_be(draw: st.DrawFn) -> tuple[str, Any]:
    """A field of a sample, and an illegal value of it."""
    name = draw(st.sampled_from([*RANGES, "time_s"]))
    if draw(st.integers(0, 4)) == 0:
        return name, draw(st.sampled_from(NO_NUMBERS))
    legal = getattr(full(FAR), name)
    count = len(legal) if isinstance(legal, tuple) else 1
    place = draw(st.integers(0, count - 1))
    low, high = (-5.0, 0.05) if name == "time_s" else (float(bound.flat[place]) for bound in RANGES[name])
    illegal = st.sampled_from(ODD_FLOATS) | st.floats().filter(lambda value: not low - 0.5 <= value <= high + 0.5)
    value = draw(illegal)
    return name, (*legal[:place], value, *legal[place + 1 :]) if isinstance(legal, tuple) else value


@given(hands_that_cannot_be(), st.booleans(), st.booleans())
@settings(max_examples=400, deadline=None)
def test_no_hand_that_cannot_be_lets_the_arm_move(odd: tuple[str, Any], near: bool, other: bool) -> None:
    hand = full(hand_at(*FOREARM_M) if near else FAR)
    wrong = replace(hand, **{"time_s": 2 * TICK_S, **dict([odd])})
    seen = sound(2)
    assert seen.bench is not None
    bench = replace(seen.bench, other_hands=(wrong,)) if other else replace(seen.bench, hand=wrong)
    judgement = begun().judge(replace(seen, bench=bench))
    assert judgement.action is Action.HOLD
    assert "hand_not_plausible" in judgement.holding_faults
    assert judgement.speed_scale == 0
    assert not judgement.new_path


numbers = st.floats() | st.sampled_from(ODD_FLOATS)
near_numbers = st.floats(-0.5, 1.5) | numbers
points = st.tuples(near_numbers, near_numbers)
some = st.builds(
    HandSample,
    time_s=st.floats(-1.0, 1.0) | numbers,
    box_px=st.tuples(*[st.integers(-50, 500)] * 4),
    fingertips_m=points,
    palm_m=points,
    velocity_m_s=st.none() | points,
    acceleration_m_s2=st.none() | points,
    height_m=st.none() | near_numbers,
    fingertips_height_m=st.none() | near_numbers,
    confidence=near_numbers,
)


@given(st.lists(some, max_size=3))
@settings(max_examples=300, deadline=None)
def test_hands_hold_the_arm_unless_separation_knows_the_room_that_they_leave(hands: list[HandSample]) -> None:
    seen = sound(2)
    assert seen.bench is not None
    seen = replace(seen, bench=replace(seen.bench, other_hands=tuple(hands)))
    judgement = begun().judge(seen)
    found = separation_of(MONITOR, seen, None)
    assert found is not None
    if found is UNKNOWN or not found.distance_m >= found.least_m:
        assert judgement.speed_scale == 0
    else:
        assert math.isfinite(found.distance_m) or not hands
        assert MONITOR.persons.view_range.doubt(seen.bench, seen.time_s) == ""  # type: ignore[arg-type]


@pytest.mark.parametrize("back_s", [5.0, 0.41])
def test_a_hand_that_is_older_than_its_view_is_not_fresh(back_s: float) -> None:
    seen = sound(50)
    assert seen.bench is not None
    old = replace(seen, bench=replace(seen.bench, hand=replace(FAR, time_s=seen.time_s - back_s)))
    judgement = begun().judge(old)
    assert judgement.holding_faults[0] == "hand_not_plausible"
    assert f"{back_s:.1f} s ago" in judgement.words


def test_a_hand_of_an_earlier_frame_is_as_old_as_it_says() -> None:
    seen = sound(50)
    assert seen.bench is not None
    least_m = []
    for back_s in (0.0, 0.1, 0.3):
        hand = replace(FAR, time_s=seen.time_s - back_s, velocity_m_s=(-0.5, 0.0))
        found = separation_of(MONITOR, replace(seen, bench=replace(seen.bench, hand=hand)), None)
        assert found is not None
        least_m.append(found.least_m)
    assert least_m[0] < least_m[1] < least_m[2]


VIEWS: dict[str, Any] = {
    "time_s": ODD_FLOATS,
    "left_by": [("lefft",), ("",), (None,), (math.nan,)],
    "other_hands": [(None,), ({},), ("hand",)],
    "holes": [{"p1": HoleView("o1", 1.0, value)} for value in (math.nan, math.inf, -math.inf)],
    **{name: [None, math.nan, 0, b""] for name in ("health", "unseen", "unexplained", "hand_unknown")},
}


@pytest.mark.parametrize("name", VIEWS)
def test_no_view_that_cannot_be_lets_the_arm_move(name: str) -> None:
    for value in VIEWS[name]:
        seen = sound(2)
        assert seen.bench is not None
        bench = replace(seen.bench, **{name: value})
        assert begun().judge(replace(seen, bench=bench)).action is Action.HOLD, value


PATH = joint_move(np.array(BENCH.arm_park_rad), np.array(BENCH.arm_look_rad), PLANNER.settings)
BEGUN_S = 0.4  # along it


def on_path(tick: int, path_s: float) -> Observation:
    """An arm that follows the path, and a hand for which it is slow."""
    rows = PATH.along(np.array([path_s - 1e-3, path_s, path_s + 1e-3]))
    seen = view(hand=hand_at(0.9, -0.35))(sound(tick))
    speeds = tuple(((rows[2] - rows[0]) / 2e-3).tolist())
    arm = ArmState(seen.time_s, tuple(rows[1].tolist()), speeds, True, path_s=path_s)
    return replace(seen, arm=arm, gripper=replace(GRIPPER, time_s=seen.time_s))


def followed() -> Supervisor:
    """A supervisor that has seen the arm follow the path for two ticks."""
    supervisor = make_supervisor(TABLE, PLANNER)
    for tick, path_s in ((0, BEGUN_S - 2 * TICK_S), (1, BEGUN_S - TICK_S)):
        supervisor.judge(on_path(tick, path_s))
        supervisor.judge_command(on_path(tick, path_s), Command(follow=PATH))
    return supervisor


SOUND = followed().judge(on_path(2, BEGUN_S))


@st.composite
def arms_that_cannot_be(draw: st.DrawFn) -> tuple[str, Any]:
    """A field of the arm's state, and an illegal value of it."""
    six = on_path(2, BEGUN_S).arm
    name = draw(st.sampled_from(["positions_rad", "velocities_rad_s", "time_s", "path_s", "mode", "moving"]))
    legal = getattr(six, name)
    if name in ("mode", "moving"):
        return name, draw(st.text()) if name == "mode" else False
    if name in ("time_s", "path_s"):
        return name, draw(st.sampled_from(ODD_FLOATS) | st.floats(allow_nan=True).filter(lambda v: not 0 <= v < 9))
    if draw(st.booleans()):
        return name, legal[: draw(st.integers(0, 5))]
    place = draw(st.integers(0, 5))
    value = draw(st.sampled_from(ODD_FLOATS) | st.floats().filter(lambda value: not abs(value) < 7))
    return name, (*legal[:place], value, *legal[place + 1 :])


@pytest.mark.long
@given(arms_that_cannot_be())
@settings(max_examples=300, deadline=None)
@example(("moving", False))
@example(("path_s", 1e9))
def test_no_arm_that_cannot_be_is_freer(odd: tuple[str, Any]) -> None:
    assert 0 < SOUND.speed_scale < 1
    seen = on_path(2, BEGUN_S)
    judgement = followed().judge(replace(seen, arm=replace(seen.arm, **dict([odd]))))
    assert judgement.speed_scale <= SOUND.speed_scale
    name, value = odd
    later = name == "moving" or (name == "path_s" and 0 <= value < math.inf)  # seen to be off its path a tick later
    assert later or judgement.action >= Action.HOLD


@given(numbers, numbers, numbers, st.sampled_from(["slow", "hold"]))
@settings(max_examples=300, deadline=None)
def test_no_share_that_cannot_be_is_a_speed(share: float, leaving: float, wanted: float, action: str) -> None:
    row = Fault(signal="hand_near", action=action, clear="itself", share=0.5)  # type: ignore[arg-type]
    supervisor = Supervisor((row,), {"hand_near": lambda *_: FaultReport("near", share, leaving)})
    judgement: SafetyDecision = supervisor.judge(replace(sound(0), operator=OperatorState(speed=wanted)))
    assert 0 <= judgement.speed_scale <= 1
    legal = [share, wanted] if action == "slow" else [leaving, wanted]
    assert judgement.speed_scale == 0 or judgement.speed_scale <= min(0.5 if action == "slow" else 1.0, *legal)


def test_a_path_of_no_numbers_leaves_no_share() -> None:
    broken = replace(PATH, positions_rad=np.full_like(PATH.positions_rad, np.nan))
    seen = on_path(2, BEGUN_S)
    found = separation_of(MONITOR, seen, (broken, BEGUN_S))
    assert found is not None
    assert not found.speed_scale > 0
    assert not MONITOR.slow_share(broken) > 0
    assert separation_of(MONITOR, seen, (PATH, math.nan)) is UNKNOWN


def test_nobody_is_given_way_to_where_it_is_not_known_where_the_hand_is() -> None:
    seen = view(hand=replace(FAR, palm_m=(math.nan, 0.0)))(on_path(2, BEGUN_S))
    joints = np.array(seen.arm.positions_rad)
    assert isinstance(settled(way_out(PLANNER, seen, joints, PATH.positions_rad[-1], Load(0.05))), str)


@pytest.mark.long
@given(st.lists(st.tuples(numbers, st.lists(numbers, min_size=6, max_size=6)), max_size=4), numbers)
@settings(max_examples=200, deadline=None)
def test_the_robots_own_body_is_where_it_was_measured_or_unknown(states: list[Any], asked_s: float) -> None:
    history = RobotPoseHistory(MONITOR.outline, PLANNER.kinematics.forward)
    for time_s, joints in states:
        history.keep(ArmState(time_s, tuple(joints), (0.0,) * 6, False), GRIPPER)
        history.sampled(JointSamples(np.array([time_s]), np.array([joints]), np.zeros((1, 6)), np.zeros((1, 6))))
    points, tool = history.at(asked_s), history.tool_at(asked_s)
    assert points is None or np.isfinite(points).all()
    assert tool is None or (isinstance(tool, Pose) and np.isfinite(tool.matrix).all())


def test_each_field_of_a_hand_that_is_a_number_has_its_range() -> None:
    others = {"time_s", "held_part", "side"}
    assert {field.name for field in fields(HandSample)} == {*RANGES, *others}
    assert "hand_not_plausible" in SPOILS
