"""The supervisor: one case a row of the table, and laws that hold for all of them together."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from bracket_cell.configuration import load_configuration, load_faults
from bracket_cell.running.device_writer import withhold
from bracket_cell.running.fault_checks import CHECKS as OWN
from bracket_cell.running.fault_checks import arm_checks, tick_checks
from bracket_cell.running.person_checks import person_checks
from bracket_cell.running.supervisor import OF_COMMANDS, Supervisor, make_supervisor
from bracket_ground.errors import InputError
from bracket_ground.files.yaml_file import load_yaml
from bracket_ground.interfaces.command import Command, JointTrajectory
from bracket_ground.interfaces.faults import SIGNALS, Action, Fault, FaultTable, SafetyDecision, weaker
from bracket_ground.interfaces.observation import ArmState, GripperState, ObjectStatus, Observation, Trouble
from bracket_ground.interfaces.perception import Action as SeenAction
from bracket_ground.interfaces.perception import BenchView, HandSample, PartsView
from tests.cell.fakes import arm_monitor
from tests.integration.cell_rig import motion_planner

CHECKS = {**OWN, **arm_checks(arm_monitor()), **tick_checks(0.04)}
TABLE = load_faults(load_configuration())
TICK_S = 0.04
FOREARM_M = (0.5, 0.2)  # the arm passes over it at these joints
ARM = ArmState(0.0, (0.1,) * 6, (0.0,) * 6, False)
GRIPPER = GripperState(0.0, True, ObjectStatus.AT_POSITION, 0.05, 0.0, 0)
VIEW = BenchView(0, 0.0, None, {}, SeenAction("idle", 1.0))
Spoil = Callable[[Observation], Observation]


def sound(tick: int) -> Observation:
    """Nothing is wrong."""
    time_s = tick * TICK_S
    return Observation(
        tick, time_s, replace(ARM, time_s=time_s), replace(GRIPPER, time_s=time_s), replace(VIEW, time_s=time_s)
    )


def arm(**changes: object) -> Spoil:
    return lambda seen: replace(seen, arm=replace(seen.arm, **changes))  # type: ignore[arg-type]


def gripper(**changes: object) -> Spoil:
    return lambda seen: replace(seen, gripper=replace(seen.gripper, **changes))  # type: ignore[arg-type]


def view(**changes: object) -> Spoil:
    def spoil(seen: Observation) -> Observation:
        assert seen.bench is not None
        bench = replace(seen.bench, **changes)  # type: ignore[arg-type]
        hand = bench.hand and replace(bench.hand, time_s=bench.time_s)
        return replace(seen, bench=replace(bench, hand=hand))

    return spoil


def trouble(device: str) -> Spoil:
    return lambda seen: replace(seen, troubles=(*seen.troubles, Trouble(device, f"{device} is broken")))


SPOILS: dict[str, Spoil] = {
    "arm_lost": trouble("arm"),
    "arm_lost_long": lambda seen: replace(seen, arm=replace(seen.arm, time_s=seen.time_s - 0.3)),
    "arm_not_plausible": arm(velocities_rad_s=(0.0, 0.0, math.nan, 0.0, 0.0, 0.0)),
    "arm_stale": lambda seen: replace(seen, arm=replace(seen.arm, time_s=seen.time_s - 0.13)),
    "arm_time_wrong": lambda seen: replace(seen, arm=replace(seen.arm, time_s=seen.time_s + 60)),
    "arm_off_path": arm(positions_rad=(0.14, 0.1, 0.1, 0.1, 0.1, 0.1)),
    "arm_off_path_long": arm(positions_rad=(0.14, 0.1, 0.1, 0.1, 0.1, 0.1)),
    "arm_path_unknown": arm(moving=True),
    "arm_protective_stop": arm(mode="protective_stop"),
    "arm_safeguard_stop": arm(mode="safeguard_stop"),
    "arm_emergency_stop": arm(mode="emergency_stop"),
    "arm_not_controlled": arm(mode="not_controlled"),
    "arm_fault": arm(mode="violation"),
    "arm_reduced": arm(mode="reduced"),
    "gripper_lost": trouble("gripper"),
    "gripper_lost_long": lambda seen: replace(seen, gripper=replace(seen.gripper, time_s=seen.time_s - 1.1)),
    "gripper_fault": trouble("gripper fault"),
    "gripper_two_nodes": gripper(two_nodes=True),
    "gripper_stale": lambda seen: replace(seen, gripper=replace(seen.gripper, time_s=seen.time_s - 0.15)),
    "gripper_not_plausible": gripper(opening_m=0.2),
    "gripper_refuses": gripper(fault=7),
    "gripper_restarted_empty": gripper(activated=False),
    "gripper_restarted_holding": gripper(activated=False),
    "gripper_other_master": gripper(other_master=True),
    "gripper_bus_errors": gripper(bus_errors="3 error frames"),
    "detector_lost": trouble("detector overhead"),
    "signals_lost": trouble("signals"),
    "camera_lost": trouble("camera overhead"),
    "bench_stale": lambda seen: replace(seen, bench=None),
    "bench_in_the_future": lambda seen: view(time_s=seen.time_s + 1000.0)(seen),
    "camera_unhealthy": view(health="dark"),
    "camera_moved": lambda seen: replace(seen, parts=PartsView(seen.tick, seen.time_s, (), calibration="14 mm off")),
    "bench_not_seen": view(unseen="the bench is not seen"),
    "hand_unknown": view(hand_unknown="it vanished"),
    "hand_cues_disagree": view(unexplained="something reaches into the view"),
    "hand_depth_missing": view(depth_missing="no depth under the hand"),
    "hand_not_plausible": view(hand=HandSample(0.0, (0, 0, 9, 9), (math.nan, 0.0), (1.2, 0.4))),
    "hand_too_near": lambda seen: view(hand=hand_at(*FOREARM_M))(seen),
    "tick_late": lambda seen: replace(seen, late_s=0.1),
    "tick_very_late": lambda seen: replace(seen, late_s=0.5),
}


OVER_TIME = ("arm_not_obeying", "arm_slower", "gripper_not_obeying")  # over time: see test_obeyed
OF_HANDS = ("hand_detector_blind",)  # see test_hand_checks


def hand_at(x_m: float, y_m: float) -> HandSample:
    return HandSample(0.0, (0, 0, 9, 9), (x_m, y_m), (x_m + 0.1, y_m), velocity_m_s=(0.0, 0.0))


STAY = JointTrajectory(np.array([0.0, 1.0]), np.full((2, 6), 0.1))


@pytest.mark.parametrize(("hands", "slower"), [(0, True), (1, True), (2, False)])
def test_the_arm_is_slow_where_the_camera_does_not_look_until_both_hands_are_seen(hands: int, slower: bool) -> None:
    planner = motion_planner()
    tool = planner.kinematics.forward(np.array(planner.bench.arm_look_rad))
    beyond = replace(tool, position_m=(0.56, -0.75, 0.15))
    joints = planner.kinematics.inverse(beyond, np.array(planner.bench.arm_look_rad))
    assert joints is not None
    one, *others = (*(hand_at(1.1, 0.4 + 0.1 * number) for number in range(hands)), None)
    seen = view(hand=one, other_hands=tuple(other for other in others if other is not None))(sound(0))
    seen = replace(seen, arm=replace(seen.arm, positions_rad=tuple(joints)))
    found = make_supervisor(TABLE, planner).judge(seen)
    assert ("blind_area" in [signal for signal, _ in found.reasons]) == slower


def begun(signal: str = "") -> Supervisor:
    """A supervisor that has seen two sound ticks, and a trajectory that stays where the arm is."""
    supervisor = make_supervisor(TABLE, motion_planner())
    for tick in (0, 1):
        seen = sound(tick)
        if signal == "gripper_restarted_holding":
            seen = gripper(object_status=ObjectStatus.CONTACT_CLOSING)(seen)
        assert supervisor.judge(seen).action is Action.RUN
        supervisor.judge_command(seen, Command(follow=STAY))
    return supervisor


def row(signal: str) -> Fault:
    return next(fault for fault in TABLE.faults if fault.signal == signal)


@pytest.mark.parametrize("signal", sorted(SPOILS))
def test_each_sign_is_answered_as_the_table_says_and_only_then(signal: str) -> None:
    fault, supervisor = row(signal), begun(signal)
    waits = math.ceil(round(fault.delay_s / TICK_S, 6))
    judged = [supervisor.judge(SPOILS[signal](sound(tick))) for tick in range(2, 3 + waits)]
    acts = [signal in dict(judgement.reasons) for judgement in judged]
    assert acts == [False] * waits + [True]
    assert judged[-1].action >= fault.does
    assert (judged[-1].speed_scale == 0) == (judged[-1].action >= Action.HOLD)


@pytest.mark.parametrize("signal", sorted(SPOILS))
def test_each_sign_clears_as_the_table_says(signal: str) -> None:
    fault, supervisor = row(signal), begun(signal)
    waits = math.ceil(round(fault.delay_s / TICK_S, 6))
    for tick in range(2, 3 + waits):
        supervisor.judge(replace(SPOILS[signal](sound(tick)), acknowledged=tick == 2 + waits))
    gone = math.ceil(round(fault.clear_s / TICK_S, 6))
    over = [replace(sound(tick), acknowledged=tick == 3 + waits) for tick in range(3 + waits, 3 + waits + gone + 2)]
    later = [supervisor.judge(seen) for seen in over]
    acts = [signal in dict(judgement.reasons) for judgement in later]
    if fault.clear == "never":
        assert all(acts)
    else:
        assert not acts[-1]
        assert all(acts[: max(0, gone - 1)])


def test_every_signal_has_a_check_and_a_test() -> None:
    assert set(CHECKS) | set(person_checks(motion_planner().separation)) == set(SIGNALS)
    assert set(SPOILS) | {*OF_COMMANDS, "hand_near", "blind_area", *OVER_TIME, *OF_HANDS} == set(SIGNALS)


def test_a_hold_that_lasts_becomes_a_stop_for_good() -> None:
    supervisor = begun()
    limit_s = row("gripper_refuses").stop_after_s
    assert limit_s is not None
    actions = [supervisor.judge(SPOILS["gripper_refuses"](sound(tick))).action for tick in range(2, 140)]
    assert actions[0] is Action.HOLD
    assert actions[-1] is Action.STOP
    assert actions.index(Action.STOP) == pytest.approx(limit_s / TICK_S, abs=1.5)
    assert supervisor.judge(sound(141)).action is Action.STOP


def test_a_person_must_acknowledge_where_the_table_says_so() -> None:
    fault = Fault(signal="camera_unhealthy", action="hold", clear="person")
    supervisor = Supervisor([fault], CHECKS)
    supervisor.judge(SPOILS["camera_unhealthy"](sound(0)))
    assert supervisor.judge(sound(1)).action is Action.HOLD
    assert supervisor.judge(replace(sound(2), acknowledged=True)).action is Action.RUN


def test_what_was_acknowledged_while_it_lasted_clears_when_it_is_gone_but_not_much_later() -> None:
    fault = Fault(signal="arm_protective_stop", action="hold", clear="person")
    for ends, acts in ((10, Action.RUN), (160, Action.HOLD)):
        supervisor = Supervisor([fault], CHECKS)
        for tick in range(ends):
            supervisor.judge(replace(SPOILS["arm_protective_stop"](sound(tick)), acknowledged=tick == 3))
        assert supervisor.judge(sound(ends)).action is acts


@pytest.mark.parametrize(("mode", "acts"), [("protective_stop", Action.HOLD), ("normal", Action.STOP)])
def test_what_shakes_an_arm_with_its_brakes_on_does_not_end_the_run(mode: str, acts: Action) -> None:
    shaken = arm(mode=mode, velocities_rad_s=(0.0, 0.0, 0.0, 3.8, -6.0, 0.1))
    assert begun().judge(shaken(sound(2))).action is acts


def test_a_gripper_that_restarted_is_held_until_it_is_active_again() -> None:
    supervisor = begun()
    actions = [supervisor.judge(gripper(activated=False)(sound(tick))).action for tick in range(2, 30)]
    assert set(actions) == {Action.HOLD}
    supervisor.judge(replace(gripper(activated=False)(sound(30)), acknowledged=True))
    later = [supervisor.judge(sound(tick)).action for tick in range(31, 60)]
    assert later[0] is Action.HOLD
    assert later[-1] is Action.RUN


def test_an_arm_that_still_moves_does_not_clear_at_standstill() -> None:
    supervisor = Supervisor([row("arm_off_path")], CHECKS)
    supervisor.judge_command(sound(0), Command(follow=STAY))
    for tick in (1, 2):
        supervisor.judge(SPOILS["arm_off_path"](sound(tick)))
    moving = arm(velocities_rad_s=(0.2,) * 6)
    assert [supervisor.judge(moving(sound(tick))).action for tick in range(3, 40)] == [Action.HOLD] * 37


def test_two_goals_for_one_arm_in_a_tick_stop_the_cell() -> None:
    supervisor, command = begun(), Command()
    command.follow = STAY
    command.follow = JointTrajectory(np.array([0.0]), np.zeros((1, 6)))
    supervisor.judge(sound(2))
    judgement = supervisor.judge_command(sound(2), command)
    assert judgement.action is Action.STOP
    assert judgement.words == "two nodes commanded the arm"


def test_an_arm_that_ignores_its_trajectory_is_found() -> None:
    supervisor = make_supervisor(TABLE, motion_planner())
    away = JointTrajectory(np.array([0.0, 1.0]), np.array([[0.1] * 6, [0.9] * 6]))
    supervisor.judge(sound(0))
    supervisor.judge_command(sound(0), Command(follow=away))
    limit_s = row("arm_off_path").stop_after_s
    assert limit_s is not None
    actions = [supervisor.judge(sound(tick)).action for tick in range(1, 10 + math.ceil(limit_s / TICK_S))]
    assert Action.HOLD in actions[:5]
    assert actions[-1] is Action.STOP, "a hold that does not clear ends the run"


def test_an_arm_that_is_soon_back_on_its_path_goes_on_by_itself() -> None:
    supervisor, off = begun(), SPOILS["arm_off_path"]
    held = [supervisor.judge(off(sound(tick))) for tick in range(2, 100)]
    assert held[-1].action is Action.HOLD
    assert not supervisor.unacknowledged
    assert [supervisor.judge(sound(tick)).action for tick in range(100, 115)][-1] is Action.RUN


@pytest.mark.parametrize("comes_back", [False, True])
def test_an_arm_that_is_held_off_its_path_waits_for_a_person_and_gives_its_path_up(comes_back: bool) -> None:
    supervisor, off = begun(), SPOILS["arm_off_path"]
    lasts_s = row("arm_off_path_long").delay_s
    ticks = 10 + math.ceil(lasts_s / TICK_S)
    held = [supervisor.judge(off(sound(tick))) for tick in range(2, ticks)]
    waiting = [supervisor.unacknowledged]
    assert held[-1].action is Action.HOLD
    seen = [sound(tick) if comes_back else off(sound(tick)) for tick in range(ticks, ticks + 50)]
    waits = [supervisor.judge(observation) for observation in seen]
    assert {judgement.action for judgement in waits} == {Action.HOLD}, "nothing moves before somebody said so"
    said = replace(off(sound(ticks + 50)), acknowledged=True)
    supervisor.judge(said)
    supervisor.judge_command(said, Command())
    assert [*waiting, supervisor.unacknowledged] == [True, False]
    later = [supervisor.judge(off(sound(tick))).action for tick in range(ticks + 51, ticks + 80)]
    assert later[-1] is Action.RUN, "it stands where it was pushed, and a new path begins there"


def test_where_the_table_only_warns_of_an_arm_off_its_path_an_acknowledgement_leaves_it_its_path() -> None:
    warns = Fault(signal="arm_off_path", action="warn", clear="itself")
    supervisor, off = Supervisor([warns], CHECKS), SPOILS["arm_off_path"]
    supervisor.judge(sound(0))
    supervisor.judge_command(sound(0), Command(follow=STAY))
    said = replace(off(sound(1)), acknowledged=True)
    assert supervisor.judge(said).action is Action.WARN
    assert not supervisor.judge_command(said, Command(follow=STAY)).gives_path_up(acknowledged=True)
    assert supervisor.judge(off(sound(2))).action is Action.WARN


AWAY = JointTrajectory(np.array([0.0, 1.0]), np.array([[0.1] * 6, [0.9] * 6]))


def acknowledged_off_path(supervisor: Supervisor, tick: int) -> tuple[int, SafetyDecision]:
    """The arm is told to go away and stays; somebody acknowledges it as soon as that is asked for.

    Returns:
        the tick after it has cleared, or after the run was stopped, and the last judgement.
    """
    supervisor.judge(sound(tick))
    judgement = supervisor.judge_command(sound(tick), Command(follow=AWAY))
    for now in range(tick + 1, tick + 400):
        seen = replace(sound(now), acknowledged=supervisor.unacknowledged)
        supervisor.judge(seen)
        judgement = supervisor.judge_command(seen, Command())
        if judgement.action is Action.STOP or (judgement.action is Action.RUN and now > tick + 5):
            return now + 1, judgement
    return tick + 400, judgement


def test_an_arm_that_ignores_its_trajectories_whatever_is_acknowledged_ends_the_run() -> None:
    supervisor, tick = make_supervisor(TABLE, motion_planner()), 0
    actions, judgement = [], SafetyDecision()
    for _ in range(4):
        tick, judgement = acknowledged_off_path(supervisor, tick)
        actions.append(judgement.action)
    assert actions == [Action.RUN] * 3 + [Action.STOP]
    assert judgement.words == "the arm does not follow its trajectory, although it was acknowledged 3 times in a row"
    assert not supervisor.unacknowledged, "nobody is asked any more"


@pytest.mark.parametrize(("goal_rad", "helps"), [(0.2, True), (0.103, False)])
def test_a_trajectory_that_came_to_its_end_forgets_what_was_acknowledged_before(goal_rad: float, helps: bool) -> None:
    supervisor, tick = make_supervisor(TABLE, motion_planner()), 0
    for _ in range(3):
        tick, _ = acknowledged_off_path(supervisor, tick)
    supervisor.judge(sound(tick))
    there = JointTrajectory(np.array([0.0, 1.0]), np.array([[0.1] * 6, [goal_rad] * 6]))
    supervisor.judge_command(sound(tick), Command(follow=there))
    arrived = arm(positions_rad=(goal_rad,) * 6)(sound(tick + 1))
    supervisor.judge(arrived)
    supervisor.judge_command(arrived, Command())
    _, judgement = acknowledged_off_path(supervisor, tick + 2)
    assert judgement.action is (Action.RUN if helps else Action.STOP), "who stays where it was has gone nowhere"


@pytest.mark.parametrize(("speed_rad_s", "at"), [(0.05, None), (0.15, 3), (0.3, 2)])
def test_the_more_told_speeds_are_off_the_sooner_it_is_noticed(speed_rad_s: float, at: int | None) -> None:
    supervisor, noticed = make_supervisor(TABLE, motion_planner()), list[int]()
    for tick in range(6):
        creeps = arm(positions_rad=(0.1 + speed_rad_s * 0.04 * tick,) * 6)(sound(tick))
        if "arm_not_plausible" in dict(supervisor.judge(creeps).reasons):
            noticed.append(tick)
    assert noticed[:1] == ([] if at is None else [at])


def test_who_acknowledges_twice_has_helped_once() -> None:
    supervisor = make_supervisor(TABLE, motion_planner())
    supervisor.judge(sound(0))
    supervisor.judge_command(sound(0), Command(follow=AWAY))
    for tick in range(1, 10):
        seen = replace(sound(tick), acknowledged=tick > 5)
        supervisor.judge(seen)
        supervisor.judge_command(seen, Command())
    _, judgement = acknowledged_off_path(supervisor, 30)
    assert judgement.action is Action.RUN


def test_an_arm_that_ignores_a_short_trajectory_is_found_too() -> None:
    supervisor = make_supervisor(TABLE, motion_planner())
    near = JointTrajectory(np.array([0.0, 1.0]), np.array([[0.1] * 6, [0.116] * 6]))
    supervisor.judge(sound(0))
    supervisor.judge_command(sound(0), Command(follow=near))
    assert Action.HOLD in [supervisor.judge(sound(tick)).action for tick in range(1, 4)]


# After a protective stop an arm is off its path without fault, so that sign alone hides another one.
ALL = sorted(set(SPOILS) - {"arm_protective_stop"})


@given(
    st.lists(
        st.tuples(st.sets(st.sampled_from(ALL), max_size=4), st.sets(st.sampled_from(ALL))),
        min_size=1,
        max_size=12,
    )
)
@example([({"camera_moved"}, {"bench_stale"})])
@settings(max_examples=150, deadline=None)
def test_more_trouble_never_gives_less_reaction(history: list[tuple[set[str], set[str]]]) -> None:
    less, more = begun(), begun()
    for tick, (some, others) in enumerate(history, start=2):
        few, many = judged(less, tick, some), judged(more, tick, some | others)
        assert many.action >= few.action
        assert many.speed_scale <= few.speed_scale


def judged(supervisor: Supervisor, tick: int, signals: set[str]) -> SafetyDecision:
    """What it says to all these signs together; an arm has one mode, so the gravest is spoiled last."""
    seen = sound(tick)
    for signal in sorted(SPOILS, key=lambda name: row(name).does):
        if signal in signals:
            seen = SPOILS[signal](seen) if seen.bench is not None or signal not in OF_VIEW else seen
    return supervisor.judge(seen)


OF_VIEW = (
    "hand_not_plausible",
    "hand_too_near",
    "bench_in_the_future",
    "camera_unhealthy",
    "bench_not_seen",
    "hand_unknown",
    "hand_cues_disagree",
)


def test_the_same_observations_give_the_same_judgements() -> None:
    one, other = begun(), begun()
    for tick in range(2, 60):
        seen = SPOILS[sorted(SPOILS)[tick % len(SPOILS)]](sound(tick))
        assert one.judge(seen) == other.judge(seen)


@pytest.mark.parametrize(
    ("line", "complaint"),
    [
        ("- {signal: arm_lost, action: stop, clear: never}", "no row for signal"),
        ("- {signal: arm_lost, action: halt, clear: never}", "action.*legal|action.*'run', 'warn'"),
        ("- {signal: arm_lost, action: stop, clear: never, delay_s: .inf}", "delay_s"),
        ("- {signal: arm_lots, action: stop, clear: never}", "signal"),
    ],
)
def test_a_table_that_is_wrong_is_refused_with_its_place(tmp_path, line: str, complaint: str) -> None:  # type: ignore[no-untyped-def]
    file = tmp_path / "faults.yaml"
    file.write_text(f"faults:\n  {line}\n")
    with pytest.raises(InputError, match=complaint) as caught:
        load_yaml(file, FaultTable)
    assert f"{file}:" in str(caught.value)


OWN_ROWS = "{signal: tick_late, action: hold, clear: person, clear_s: 1.0}"


def extended(folder: Path, rows: str, extends: str = "shipped") -> FaultTable:
    file = folder / "faults.yaml"
    file.write_text(f"extends: {extends}\nfaults:\n{rows}")
    return load_yaml(file, FaultTable)


def test_a_table_that_extends_the_shipped_one_names_only_what_differs(tmp_path: Path) -> None:
    table = extended(tmp_path, f"  - {OWN_ROWS}\n")
    own = {fault.signal: fault for fault in table.faults}
    shipped = {fault.signal: fault for fault in TABLE.faults}
    assert set(own) == set(SIGNALS)
    assert [name for name in own if own[name] != shipped[name]] == ["tick_late"]
    assert own["tick_late"].action == "hold"
    assert weaker(table, TABLE) == []
    assert extended(tmp_path, "  []\n").faults == TABLE.faults
    milder = extended(tmp_path, "  - {signal: arm_lost, action: warn, clear: itself}\n")
    assert weaker(milder, TABLE) == ["arm_lost: action warn is milder than hold"]


@pytest.mark.parametrize(
    ("extends", "rows", "place", "complaint"),
    [
        ("shiped", f"  - {OWN_ROWS}\n", ":1:", "extends"),
        ("shipped", "  - {signal: arm_lots, action: stop, clear: never}\n", ":3:", "signal"),
        ("shipped", f"  - {OWN_ROWS}\n  - {OWN_ROWS}\n", ":4:", "tick_late is in the table twice"),
        ("shipped", "  - {signal: tick_late, action: halt, clear: never}\n", ":3:", "action"),
        ("shipped", "  - 7\n", ":3:", "keys with values"),
        ("shipped", "  - {signal: [tick_late], action: hold, clear: never}\n", ":3:", "signal"),
        ("shipped", "  tick_late: {}\n", ":2:", "a list"),
    ],
)
def test_what_is_wrong_in_an_extended_table_has_its_place(
    tmp_path: Path, extends: str, rows: str, place: str, complaint: str
) -> None:
    with pytest.raises(InputError, match=complaint) as caught:
        extended(tmp_path, rows, extends)
    assert f"faults.yaml{place}" in str(caught.value)


def changed(signal: str, **values: object) -> FaultTable:
    return FaultTable(
        faults=tuple(fault.model_copy(update=values) if fault.signal == signal else fault for fault in TABLE.faults)
    )


@pytest.mark.parametrize(
    ("signal", "values", "told"),
    [
        ("arm_emergency_stop", {"action": "run"}, "action run is milder than hold"),
        ("hand_too_near", {"action": "slow"}, "action slow is milder than hold"),
        ("arm_protective_stop", {"clear": "itself"}, "clear itself is easier than person"),
        ("arm_lost", {"delay_s": 0.5}, "delay_s 0.5 is more than 0"),
        ("bench_stale", {"stop_after_s": None}, "stop_after_s without a limit is more than 20"),
        ("bench_stale", {"clear_s": 0.1}, "clear_s 0.1 is shorter than 0.5"),
        ("arm_reduced", {"share": 0.5}, "share 0.5 is more than 0.25"),
        ("arm_not_obeying", {"stop_m": 1.0}, "stop_m 1 is more than 0.6"),
        ("arm_safeguard_stop", {"clear": "itself"}, "clear itself is easier than person"),
        ("arm_safeguard_stop", {"clear": "itself", "because": "a scanner sees who is inside"}, ""),
        ("arm_reduced", {"action": "hold"}, ""),
        ("bench_stale", {"action": "stop", "clear": "never", "clear_s": 0.0, "stop_after_s": None}, ""),
    ],
)
def test_a_milder_row_is_weaker_and_a_graver_one_is_not(signal: str, values: dict[str, object], told: str) -> None:
    assert weaker(changed(signal, **values), TABLE) == ([f"{signal}: {told}"] if told else [])


def safeguarded(*, clear: str = "person", because: str | None = None) -> Supervisor:
    row = {"signal": "arm_safeguard_stop", "action": "hold", "clear": clear, "clear_s": 0.5, "because": because}
    return Supervisor([Fault.model_validate(row)], CHECKS)


def held_ticks(supervisor: Supervisor, modes: str, acknowledged: set[int]) -> str:
    """H where the arm is held, for each letter of modes: open, closed, normal."""
    names = {"o": "safeguard_stop", "c": "safeguard_closed", "n": "normal"}
    found = ""
    for tick, letter in enumerate(modes):
        seen = replace(arm(mode=names[letter])(sound(tick)), acknowledged=tick in acknowledged)
        found += "H" if supervisor.judge(seen).action is Action.HOLD else "-"
    return found


def test_a_safeguard_that_closed_waits_for_a_person_however_long() -> None:
    assert held_ticks(safeguarded(), "nnooooo" + "n" * 200, set()) == "--" + "H" * 205


@pytest.mark.parametrize("closed", ["", "ccccc"])
def test_a_safeguard_is_acknowledged_once_it_is_closed_and_not_before(closed: str) -> None:
    modes = "ooooo" + closed + "n" * 40
    early, later = set(range(5)), 4 + len(closed) or 5
    assert set(held_ticks(safeguarded(), modes, early)) == {"H"}
    assert held_ticks(safeguarded(), modes, {later + 1}).count("-") > 20


def test_a_safeguard_that_clears_itself_brings_the_arm_back_once_it_is_closed() -> None:
    supervisor = safeguarded(clear="itself", because="a scanner sees who is inside")
    brought = []
    for tick, mode in enumerate(["normal", "safeguard_stop", "safeguard_closed", "normal"]):
        brought.append(supervisor.judge(arm(mode=mode)(sound(tick))).brings_back)
    assert brought == [False, False, True, False]
    waits = safeguarded()
    assert not waits.judge(arm(mode="safeguard_closed")(sound(0))).brings_back


@pytest.mark.parametrize(
    ("row", "complaint"),
    [
        ("{signal: arm_lost, action: stop, clear: never, because: why}", "because belongs to arm_safeguard_stop"),
        ("{signal: arm_safeguard_stop, action: hold, clear: person, because: why}", "because belongs to"),
        ("{signal: arm_safeguard_stop, action: hold, clear: itself, because: '  '}", "because is empty"),
    ],
)
def test_because_is_said_of_a_safeguard_that_clears_itself_alone(tmp_path, row: str, complaint: str) -> None:  # type: ignore[no-untyped-def]
    file = tmp_path / "faults.yaml"
    file.write_text(f"faults:\n  - {row}\n")
    with pytest.raises(InputError, match=complaint) as caught:
        load_yaml(file, FaultTable)
    assert f"{file}:2" in str(caught.value)


OVER_RAD = (0.131, -1.315, 1.9, -2.155, -1.571, 0.131)  # over the bracket
BESIDE_M = (0.87, 0.26)  # a hand that rests right beside the tool there


def near_hand(tick: int, path_s: float | None = None, **changes: object) -> Observation:
    """An arm over the bracket, a hand beside it; so far along its path."""
    hand = replace(hand_at(*BESIDE_M), box_px=(99, 99, 200, 200), height_m=0.15)
    seen = view(hand=hand, **changes)(sound(tick))
    return arm(positions_rad=OVER_RAD, moving=path_s is not None, path_s=path_s)(seen)


def path_out() -> JointTrajectory:
    from bracket_cell.skills.motion.near_hand import way_out
    from bracket_cell.skills.motion.planner import Load, settled

    planner = motion_planner()
    park_rad = np.array(planner.bench.arm_park_rad)
    path = settled(way_out(planner, near_hand(0), np.array(OVER_RAD), park_rad, Load(0.05)))
    assert isinstance(path, JointTrajectory), path
    return path


@pytest.mark.parametrize(("velocity_m_s", "ways"), [(None, 0), ((-0.01, 0.0), 1)])
def test_of_the_ways_out_one_is_looked_at_in_a_tick_and_none_where_none_could_be_right(
    velocity_m_s: tuple[float, float] | None, ways: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    """All of them take seconds, in which the supervisor would not be asked."""
    from bracket_cell.skills.motion import near_hand as module
    from bracket_cell.skills.motion.planner import Load

    def looked_at(*_: object) -> Iterator[str]:
        while True:
            tried.append(1)
            yield "no way"

    tried: list[int] = []
    monkeypatch.setattr(module, "_ways", looked_at)
    planner, seen = motion_planner(), near_hand(0)
    assert seen.bench is not None
    assert seen.bench.hand is not None
    hand = replace(seen.bench.hand, velocity_m_s=velocity_m_s)
    seen = replace(seen, bench=replace(seen.bench, hand=hand))
    looking = module.way_out(planner, seen, np.array(OVER_RAD), np.array(planner.bench.arm_park_rad), Load(0.05))
    assert isinstance(next(looking), str) is (ways == 0)
    assert len(tried) == ways


def test_an_arm_that_a_near_hand_holds_may_only_go_away_and_slowly() -> None:
    supervisor, path = make_supervisor(TABLE, motion_planner()), path_out()
    held = supervisor.judge(near_hand(0))
    assert (held.action, held.holding_faults, held.new_path) == (Action.HOLD, ("hand_too_near",), True)
    assert supervisor.judge_command(near_hand(0), Command(follow=path)).action is Action.HOLD
    leaves = supervisor.judge(near_hand(1, path_s=0.0))
    assert leaves.action is Action.SLOW
    assert leaves.reasons[0] == ("hand_too_near", "the hand is too near; the arm moves away from it, slowly")
    back = JointTrajectory(path.times_s, path.positions_rad[::-1])
    supervisor.judge_command(near_hand(1, path_s=0.0), Command(follow=back))
    assert supervisor.judge(near_hand(2, path_s=back.duration_s - 0.3)).action is Action.HOLD


def beside(tick: int, x_m: float, speed_m_s: float) -> Observation:
    """An arm that stands over the bracket, and a hand that moves towards it."""
    hand = replace(hand_at(x_m, BESIDE_M[1]), box_px=(99, 99, 200, 200), height_m=0.15, velocity_m_s=(-speed_m_s, 0.0))
    return arm(positions_rad=OVER_RAD)(view(hand=hand)(sound(tick)))


def test_a_hand_that_turns_a_screw_holds_the_arm_once() -> None:
    def holds(x_m: float, speed_m_s: float) -> bool:
        return make_supervisor(TABLE, motion_planner()).judge(beside(0, x_m, speed_m_s)).action is Action.HOLD

    x_m = next(x for x in np.arange(BESIDE_M[0], 1.3, 0.02).tolist() if holds(x, 0.4) and not holds(x - 0.05, 0.0))
    supervisor = make_supervisor(TABLE, motion_planner())
    speeds_m_s = [0.4 if tick < 60 and tick % 12 < 6 else 0.0 for tick in range(110)]
    held = [supervisor.judge(beside(tick, x_m, one)).action is Action.HOLD for tick, one in enumerate(speeds_m_s)]
    changes = [tick for tick in range(1, len(held)) if held[tick] != held[tick - 1]]
    assert held[0]
    assert len(changes) == 1
    assert 58 <= changes[0] <= 75  # .3 s after the last fast motion


@pytest.mark.parametrize("signal", ["hand_unknown", "bench_stale", "camera_unhealthy", "arm_safeguard_stop"])
def test_whatever_else_holds_the_arm_holds_it_beside_a_near_hand_too(signal: str) -> None:
    supervisor, path = make_supervisor(TABLE, motion_planner()), path_out()
    supervisor.judge(near_hand(0))
    supervisor.judge_command(near_hand(0), Command(follow=path))
    judgement = supervisor.judge(SPOILS[signal](near_hand(1, path_s=0.0)))
    assert judgement.speed_scale == 0
    assert not judgement.new_path
    command = Command(follow=path)
    withhold(command, near_hand(1), judgement)
    assert command.follow is None


LOSSES: dict[str, Spoil] = {
    "arm silent": lambda seen: replace(seen, arm=replace(seen.arm, time_s=3 * TICK_S)),
    "arm raises": lambda seen: trouble("arm")(replace(seen, arm=replace(seen.arm, time_s=3 * TICK_S))),
    "gripper raises": lambda seen: trouble("gripper")(
        replace(seen, gripper=replace(seen.gripper, time_s=3 * TICK_S, echoed=False))
    ),
    "gripper silent": lambda seen: replace(seen, gripper=replace(seen.gripper, time_s=3 * TICK_S, echoed=False)),
}


@pytest.mark.parametrize("lost_s", [0.6, 3.0, 29.0])
@pytest.mark.parametrize("loss", LOSSES)
def test_a_short_loss_is_a_hold_until_a_person_says_so_and_the_path_is_given_up(loss: str, lost_s: float) -> None:
    supervisor, back = begun(), 4 + round(lost_s / TICK_S)
    lost = [supervisor.judge(LOSSES[loss](sound(tick))).action for tick in range(4, back)]
    assert set(lost[2:]) == {Action.HOLD}
    waits = [supervisor.judge(sound(tick)) for tick in range(back, back + 100)]
    if loss == "gripper silent" and lost_s < 1:  # it is sooner back than it counts as lost
        assert waits[-1].action is Action.RUN
        return
    assert {judgement.action for judgement in waits} == {Action.HOLD}
    assert supervisor.unacknowledged
    said = replace(sound(back + 100), acknowledged=True)
    supervisor.judge(said)
    assert supervisor.judge_command(said, Command()).gives_path_up(acknowledged=True)
    later = [supervisor.judge(sound(tick)).action for tick in range(back + 101, back + 120)]
    assert later[-1] is Action.RUN


@pytest.mark.parametrize("loss", LOSSES)
def test_a_loss_that_lasts_ends_the_run_for_good(loss: str) -> None:
    supervisor = begun()
    actions = [supervisor.judge(LOSSES[loss](sound(tick))).action for tick in range(4, 900)]
    assert actions[-1] is Action.STOP
    assert 30.0 / TICK_S <= actions.index(Action.STOP) <= 31.5 / TICK_S
    assert supervisor.judge(sound(901)).action is Action.STOP


@pytest.mark.parametrize("raises", [False, True])
def test_an_arm_that_is_lost_again_and_again_ends_the_run_however_often_that_is_acknowledged(raises: bool) -> None:
    supervisor, spoil = begun(), SPOILS["arm_lost" if raises else "arm_lost_long"]
    actions = list[Action]()
    for tick in range(2, 200):
        seen = replace(spoil(sound(tick)), acknowledged=tick % 10 == 0)
        supervisor.judge(seen)
        away = Command(follow=AWAY) if tick % 10 == 5 else Command()
        supervisor._memory.trajectory = AWAY  # a node ordered it, and nothing came to its end
        actions.append(supervisor.judge_command(seen, away).action)
    assert actions[-1] is Action.STOP
