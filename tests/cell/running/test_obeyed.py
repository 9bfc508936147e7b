"""Orders are watched until they are obeyed, and senses until they contradict themselves: kinds of faults, no list."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import cache

import numpy as np
import pytest

from bracket_cell.configuration import load_configuration, load_faults
from bracket_cell.running.supervisor import make_supervisor
from bracket_cell.skills.motion.arm_monitor import ArmMonitor, StopLimits
from bracket_cell.skills.motion.planner import Load
from bracket_ground.interfaces.command import Command, GripperCommand, JointTrajectory
from bracket_ground.interfaces.faults import Action, SafetyDecision
from bracket_ground.interfaces.observation import ArmState, GripperState, ObjectStatus, Observation
from bracket_ground.interfaces.operator import OperatorState
from bracket_ground.interfaces.perception import Action as SeenAction
from bracket_ground.interfaces.perception import BenchView
from bracket_ground.interfaces.pose import Array
from bracket_sim.faults.signal_faults import ANY, Kind, SignalFault
from tests.cell.fakes import arm_monitor
from tests.cell.path_arm import PathArm
from tests.integration.cell_rig import motion_planner

TABLE = load_faults(load_configuration())
TICK_S = 0.04
NOTICED_TICKS, FURTHER_M = 5, 0.10
PAUSED = OperatorState(pause="now")
GRIPPED = GripperState(0.0, True, ObjectStatus.CONTACT_CLOSING, 0.027, 0.2, 0, "operational")


@cache
def way() -> JointTrajectory:
    """From the place over the tray to the parking place, as fast as the arm is."""
    planner = motion_planner()
    start, end = (np.array(joints) for joints in (planner.bench.arm_look_rad, planner.bench.arm_park_rad))
    path = planner.free_move(start, end, Load(0.05))
    assert isinstance(path, JointTrajectory)
    return path


@dataclass
class Bench:
    """An arm that goes there and back under the supervisor, and what became of it."""

    arm: PathArm = field(default_factory=lambda: PathArm(way().positions_rad[0].copy()))
    gripper: GripperState = GRIPPED
    spoil: Callable[[Observation], Observation] = lambda seen: seen
    pause_s: tuple[float, float] = (np.inf, np.inf)
    judged: list[SafetyDecision] = field(default_factory=list)
    tool_m: list[np.ndarray] = field(default_factory=list)

    def run(self, ticks: int, until: Callable[[int], None] = lambda _: None) -> None:
        """Tick; `until` may change the arm before each."""
        supervisor, legs, under_way = make_supervisor(TABLE, motion_planner()), 0, False
        for tick in range(ticks):
            until(tick)
            now_s = tick * TICK_S
            self.arm.advance(now_s)
            self.tool_m.append(motion_planner().kinematics.position_m(self.arm.true_rad))
            seen = self.spoil(self._seen(tick, now_s))
            judgement, command = supervisor.judge(seen), Command()
            under_way &= seen.arm.moving or tick <= 2
            if judgement.action < Action.HOLD and not under_way and tick > 5:
                command.follow, under_way, legs = leg(legs), True, legs + 1
            judgement = supervisor.judge_command(seen, command)
            self.judged.append(judgement)
            self.arm.order("pace", judgement.speed_scale)
            if judgement.action is Action.STOP:
                self._stop(now_s)
                return
            if command.follow is not None and judgement.new_path:
                self.arm.order("follow", command.follow)

    def _stop(self, now_s: float) -> None:
        """The safe stop."""
        self.arm.order("stop")
        for number in range(1, 50):
            self.arm.advance(now_s + number * TICK_S)
            self.tool_m.append(motion_planner().kinematics.position_m(self.arm.true_rad))

    def _seen(self, tick: int, now_s: float) -> Observation:
        view = BenchView(tick, now_s, None, {}, SeenAction("idle", 1.0))
        paused = PAUSED if self.pause_s[0] <= now_s < self.pause_s[1] else OperatorState()
        gripper = replace(self.gripper, time_s=now_s)
        return Observation(tick, now_s, replace(self.arm.state()), gripper, view, operator=paused)

    def noticed(self, since: int) -> int:
        """Ticks from one on until something was done, that one included; 0 for never."""
        acts = [any(self._of_arm(signal) for signal, _ in judgement.reasons) for judgement in self.judged[since:]]
        return acts.index(True) + 1 if True in acts else 0

    def way_m(self, since: int) -> float:
        """How far the tool went from then on, until it stood."""
        rest = self.tool_m[since:]
        return float(np.linalg.norm(np.diff(rest, axis=0), axis=1).sum())

    @staticmethod
    def _of_arm(signal: str) -> bool:
        return signal.startswith(("arm_", "gripper_")) and signal != "arm_off_path_long"


def leg(number: int) -> JointTrajectory:
    there = way()
    return there if number % 2 == 0 else JointTrajectory(there.times_s, there.positions_rad[::-1].copy())


MIDWAY = 5 + round(way().duration_s / TICK_S / 2)


def words(bench: Bench) -> list[str]:
    return [
        text
        for judgement in bench.judged
        for signal, text in judgement.reasons
        if signal not in ("blind_area", "hand_near")
    ]


def test_an_arm_that_obeys_is_never_told_to_have_disobeyed() -> None:
    bench = Bench()
    bench.run(300)
    assert words(bench) == []


@pytest.mark.parametrize("pause", [MIDWAY, MIDWAY + 7, MIDWAY - 9])
def test_neither_is_one_that_is_held_and_goes_on(pause: int) -> None:
    bench = Bench(pause_s=(pause * TICK_S, (pause + 40) * TICK_S))
    bench.run(200)
    assert set(words(bench)) <= {"paused by the operator"}


def test_an_arm_at_seventy_percent_of_its_speed_goes_on() -> None:
    bench = Bench(PathArm(way().positions_rad[0].copy(), faster=0.7))
    bench.run(300)
    assert words(bench) == []


def disobeying(**changes: object) -> Callable[[Bench], Callable[[int], None]]:
    def made(bench: Bench) -> Callable[[int], None]:
        def until(tick: int) -> None:
            if tick == MIDWAY:
                for name, value in changes.items():
                    setattr(bench.arm, name, value)

        return until

    return made


DISOBEYS = {
    "ignores pace": (disobeying(heeds=False), True),
    "goes 1.3 times as fast": (disobeying(faster=1.3), False),
    "goes 1.3 times as fast as it was slowed down to": (disobeying(faster=1.3, heeds=False), True),
}


@pytest.mark.parametrize("name", DISOBEYS)
def test_an_arm_that_goes_on_faster_than_it_may_is_stopped(name: str) -> None:
    change, pauses = DISOBEYS[name]
    bench = Bench(pause_s=((MIDWAY + 1) * TICK_S, np.inf) if pauses else (np.inf, np.inf))
    bench.run(MIDWAY + 30, change(bench))
    assert bench.judged[-1].action is Action.STOP
    assert bench.judged[-1].reasons[0][0] in ("arm_not_obeying", "arm_not_plausible")
    if not pauses:
        assert len(bench.judged) - MIDWAY <= NOTICED_TICKS


def test_an_arm_that_moves_although_nothing_was_ordered_is_stopped() -> None:
    bench = Bench(PathArm(way().positions_rad[0].copy(), drifts_rad_s=0.5), pause_s=(0.0, np.inf))
    bench.run(60)
    assert bench.judged[-1].reasons[0] == (
        "arm_not_obeying",
        bench.judged[-1].words.split(";")[0],
    )


def told_by_a_standing_arm(ticks: int, path: JointTrajectory | None, moving: bool) -> str:
    """What is wrong with an arm that stays where it is and tells a speed for so many ticks."""
    monitor, rest = arm_monitor(), (0.0,) * 5
    for tick in range(ticks + 5):
        speeds = (*rest, -0.49) if tick >= 5 else (*rest, 0.0)
        now_s = tick * TICK_S
        place_rad = (*rest, 0.001 * (tick % 2))
        monitor.see(now_s, ArmState(now_s, place_rad, speeds, moving, path_s=now_s if moving else None), 1.0, path)
        if monitor.implausible:
            return monitor.implausible
    return ""


@pytest.mark.parametrize(
    ("after_s", "runs_away"), [((0.071, 0.057, 0.037), False), ((0.071, 0.111, 0.151), True), ((0.1, 0.1, 0.1), True)]
)
def test_an_arm_that_swings_where_its_path_begins_is_no_runaway(after_s: tuple[float, ...], runs_away: bool) -> None:
    """Near rest a thousandth of a radian is much time of a path: a servo's swing there is no way on."""
    times_s: Array = np.linspace(0.0, 1.0, 101)
    path = JointTrajectory(times_s, np.outer(1.6 / 2 * times_s**2, np.eye(6)[0]).astype(np.float64))
    monitor, before_rad, said = arm_monitor(), 0.0, []
    for tick, place_s in enumerate([None, 0.008, 0.026, 0.047, *after_s]):
        rad, now_s = float(path.at(place_s or 0.0)[0]), tick * TICK_S
        speeds = ((rad - before_rad) / TICK_S, *(0.0,) * 5)
        state = ArmState(now_s, (rad, *(0.0,) * 5), speeds, place_s is not None, path_s=place_s)
        monitor.see(now_s, state, 1.0 if tick < 2 else 0.0, path if tick else None)
        before_rad = rad
        said.append(monitor.disobeys)
    assert any(said) is runs_away


@pytest.mark.parametrize(
    ("places_s", "stands", "late_s", "words"),
    [
        ([0.9, 0.9, 0.9, 0.05], 3, 0.48, ""),  # nobody looked while it began another path
        ([0.0, 0.02, 0.06, 0.06], 1, 0.48, ""),  # nor while its own watch held it
        ([0.0, 0.02, 0.06, *[0.06] * 7], 1, 0.0, "the arm does not go on for 0.24 s"),
    ],
)
def test_an_arm_that_nobody_saw_go_on_is_told_only_where_somebody_looked(
    places_s: list[float], stands: int, late_s: float, words: str
) -> None:
    """Two states that are far apart say nothing about what lay between them: a late tick is no fault of the arm."""
    monitor, said = arm_monitor(), []
    for tick, place_s in enumerate(places_s):
        now_s = tick * TICK_S + late_s * (tick == len(places_s) - 1)
        swing = (1e-6 * tick, *(0.0,) * 5)
        monitor.see(now_s, ArmState(now_s, swing, (0.0,) * 6, tick >= stands, path_s=place_s), 1.0, way())
        said.append(str(monitor.disobeys))
    assert said[-1].split(",")[0] == words


def test_a_standing_arm_that_shakes_because_it_is_rammed_is_no_liar() -> None:
    """Its place hardly changes, and the speed at the instant of a sample says little: the run goes on."""
    assert told_by_a_standing_arm(10, None, moving=False) == ""
    assert "tells -0.49 rad/s" in told_by_a_standing_arm(25, None, moving=False)
    assert "tells -0.49 rad/s" in told_by_a_standing_arm(4, way(), moving=True)


@pytest.mark.parametrize(
    ("row", "limits"),
    [
        ({"stop_s": 0.4, "stop_m": 0.2}, StopLimits(0.4, 0.2)),
        ({"stop_s": None, "stop_m": None}, StopLimits()),
    ],
)
def test_what_a_stop_may_take_by_the_table_is_what_the_monitor_allows(
    row: dict[str, float | None], limits: StopLimits
) -> None:
    faults = [fault.model_copy(update=row if fault.signal == "arm_not_obeying" else {}) for fault in TABLE.faults]
    supervisor = make_supervisor(TABLE.model_copy(update={"faults": faults}), motion_planner())
    (monitor,) = (kept for kept in supervisor.keeps if isinstance(kept, ArmMonitor))
    assert monitor.limits == limits


@cache
def stop_m(tick: int) -> float:
    """How far the tool goes on where the supervisor stops the arm in this tick."""
    bench = Bench(
        spoil=lambda seen: replace(seen, arm=replace(seen.arm, mode="emergency_stop")) if seen.tick >= tick else seen
    )
    bench.run(tick + 40)
    return bench.way_m(tick)


ARM = ("positions_rad", "velocities_rad_s", "path_s", "time_s", "moving", "mode")
STATE = ("positions_rad", "velocities_rad_s", "path_s", "moving")


TOLERATED = {"velocities_rad_s": 0.48}  # a sense may be off by less, in the signal's unit


def differ(value: object, told: object, tolerated: float) -> bool:
    """Whether a signal says something that a sound one would not."""
    if not isinstance(value, tuple) or not isinstance(told, tuple) or len(value) != len(told):
        return value != told
    return bool(max(abs(one - other) for one, other in zip(value, told, strict=True)) > tolerated)


def spoiled(
    names: tuple[str, ...], kind: Kind, shown: list[int], device: str = "arm"
) -> Callable[[Observation], Observation]:
    faults = {name: SignalFault(name, kind) for name in names}

    def spoil(seen: Observation) -> Observation:
        active, state = seen.tick >= MIDWAY, getattr(seen, device)
        told = {name: fault.apply(getattr(state, name), seen.time_s, active=active) for name, fault in faults.items()}
        other = replace(state, **told)
        if active and any(
            differ(getattr(state, name), value, TOLERATED.get(name, 0.0)) for name, value in told.items()
        ):
            shown.append(seen.tick)
        return replace(seen, **{device: other})

    return spoil


@pytest.mark.slow
@pytest.mark.parametrize("kind", ANY[:8])
@pytest.mark.parametrize("names", [*((name,) for name in ARM), STATE], ids=lambda names: "+".join(names))
def test_a_fault_of_any_kind_in_a_signal_of_the_arm_is_noticed(names: tuple[str, ...], kind: Kind) -> None:
    shown: list[int] = []
    bench = Bench(spoil=spoiled(names, kind, shown))
    bench.run(MIDWAY + 60)
    if not shown:
        assert words(bench) == []
        return
    if names == ("moving",) and kind in ("late", "repeated"):
        return  # a motion is said to end a little later
    assert 1 <= bench.noticed(shown[0]) <= NOTICED_TICKS
    assert bench.way_m(shown[0]) - stop_m(shown[0]) <= FURTHER_M


@pytest.mark.parametrize(
    ("names", "kind"), [(("velocities_rad_s",), "flipped"), (STATE, "stuck"), (("time_s",), "early")]
)
def test_a_sample_of_them_is(names: tuple[str, ...], kind: Kind) -> None:
    test_a_fault_of_any_kind_in_a_signal_of_the_arm_is_noticed(names, kind)


@dataclass
class Fingers:
    """Fingers that close on a part of 27 mm, hold it, open and close on nothing."""

    opening_m: float = 0.085
    goal_m: float = 0.085

    def state(self, time_s: float, part: bool) -> GripperState:
        least_m = 0.027 if part else 0.0
        there_m = max(self.goal_m, least_m)
        self.opening_m += float(np.clip(there_m - self.opening_m, -0.004, 0.004))
        status = ObjectStatus.MOVING
        if abs(self.opening_m - there_m) < 1e-6:
            status = ObjectStatus.AT_POSITION if there_m == self.goal_m else ObjectStatus.CONTACT_CLOSING
        return GripperState(time_s, True, status, self.opening_m, 0.1, 0, "operational")


GOALS_M = {5: 0.0, 40: 0.05, 60: 0.01}  # by tick


def handled(spoil: Callable[[Observation], Observation]) -> list[tuple[int, str]]:
    """(tick, words) of what is said of a gripper while it grips, lets go and closes; the arm stands."""
    supervisor, fingers, said = make_supervisor(TABLE, motion_planner()), Fingers(), []
    arm = PathArm(way().positions_rad[0].copy())
    for tick in range(90):
        now_s = tick * TICK_S
        arm.advance(now_s)
        view = BenchView(tick, now_s, None, {}, SeenAction("idle", 1.0))
        seen = spoil(Observation(tick, now_s, arm.state(), fingers.state(now_s, part=tick < 55), view))
        judged, command = supervisor.judge(seen), Command()
        said += [(tick, text) for signal, text in judged.reasons if signal.startswith("gripper")]
        if (goal_m := GOALS_M.get(tick)) is not None and judged.action < Action.HOLD:
            fingers.goal_m = goal_m
            command.gripper = GripperCommand(goal_m, 0.1, 60.0)
        if supervisor.judge_command(seen, command).action is Action.STOP:
            break
    return said


def test_a_gripper_that_obeys_is_never_told_to_have_disobeyed() -> None:
    assert handled(lambda seen: seen) == []


GRIPS, HOLDS, OPENS = 8, 30, 42  # ticks in which a fault comes
SHOWS: dict[tuple[str, Kind, int], int] = {  # ticks until it shows: fingers that press do not move, either, for 0.5 s
    ("opening_m", "stuck", OPENS): 16,
    ("opening_m", "stuck", HOLDS): 32,
    ("opening_m", "scaled", HOLDS): 32,
    ("opening_m", "offset", GRIPS): 0,
    ("opening_m", "offset", HOLDS): 0,
    ("opening_m", "flipped", GRIPS): 0,
    ("opening_m", "flipped", HOLDS): 0,
    ("opening_m", "lost", GRIPS): 0,
    ("object_status", "stuck", GRIPS): 24,
    ("object_status", "stuck", HOLDS): 32,
    ("object_status", "flipped", HOLDS): 0,
    ("activated", "flipped", HOLDS): 0,
    ("echoed", "flipped", HOLDS): 0,
    ("node_state", "flipped", HOLDS): 0,
    ("time_s", "stuck", HOLDS): 2,
    ("time_s", "late", HOLDS): 0,
    ("current_a", "lost", HOLDS): 0,
}


@pytest.mark.parametrize(("name", "kind", "tick"), SHOWS)
def test_a_fault_of_any_kind_in_a_signal_of_the_gripper_is_noticed(name: str, kind: Kind, tick: int) -> None:
    fault = SignalFault(name, kind)

    def spoil(seen: Observation) -> Observation:
        told = fault.apply(getattr(seen.gripper, name), seen.time_s, active=seen.tick >= tick)
        return replace(seen, gripper=replace(seen.gripper, **{name: told}))

    said = handled(spoil)
    assert said, "never noticed"
    assert tick <= said[0][0] <= tick + SHOWS[name, kind, tick] + NOTICED_TICKS, said[0]


@pytest.mark.parametrize(("told", "tick"), [(ObjectStatus.CONTACT_CLOSING, 51), (ObjectStatus.CONTACT_OPENING, 76)])
def test_fingers_that_were_opened_grip_nothing_and_closed_ones_do_not_push(told: ObjectStatus, tick: int) -> None:
    def spoil(seen: Observation) -> Observation:
        spoiled = replace(seen.gripper, object_status=told)
        return replace(seen, gripper=spoiled) if seen.tick >= tick else seen

    said = handled(spoil)
    assert said, "never noticed"
    assert tick <= said[0][0] <= tick + NOTICED_TICKS, said[0]


def test_a_fault_code_that_nobody_knows_is_not_taken_for_none() -> None:
    said = handled(lambda seen: replace(seen, gripper=replace(seen.gripper, fault=3 * (seen.tick >= HOLDS))))
    assert said[0] == (HOLDS, "the gripper takes no command, gFLT 0x03")


LIES: dict[str, Callable[[Observation], tuple[float, ObjectStatus]]] = {
    "open and gripped": lambda _: (0.085, ObjectStatus.CONTACT_CLOSING),
    "an echo and gripped": lambda _: (0.0, ObjectStatus.CONTACT_CLOSING),
    "an echo and there": lambda _: (0.0, ObjectStatus.AT_POSITION),
}


@pytest.mark.parametrize("tick", [6, 8], ids=["as they close", "half way"])
@pytest.mark.parametrize("lie", LIES)
def test_a_gripper_whose_echo_contradicts_its_fingers_is_told(lie: str, tick: int) -> None:
    def spoil(seen: Observation) -> Observation:
        if seen.tick < tick:
            return seen
        opening_m, told = LIES[lie](seen)
        return replace(seen, gripper=replace(seen.gripper, opening_m=opening_m, object_status=told))

    said = handled(spoil)
    assert said, "never noticed"
    assert said[0][0] <= tick + NOTICED_TICKS + 4, said[0]
    assert "faster than they can" in said[0][1] or "never left where they were open" in said[0][1]


@pytest.mark.parametrize("begins", [3, MIDWAY], ids=["at rest", "under way"])
@pytest.mark.parametrize("percent", [0.01, 0.1])
def test_an_arm_that_is_much_slower_than_allowed_is_told(percent: float, begins: int) -> None:
    bench = Bench()

    def until(tick: int) -> None:
        if tick == begins:
            bench.arm.faster = percent

    bench.run(begins + 75, until)
    told = [number for number, judgement in enumerate(bench.judged) if "arm_slower" in dict(judgement.reasons)]
    assert told, "never noticed"
    assert told[0] <= begins + 60
    assert bench.judged[-1].action is Action.WARN
    assert "see the pendant's slider" in bench.judged[told[0]].words
