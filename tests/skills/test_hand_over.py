"""Giving, taking and holding on an ideal robot beside a hand that a test moves: when the fingers open, and when not."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace

import pytest

from bracket_cell.running.device_writer import withhold
from bracket_cell.running.gripper_checks import GripperMemory, with_hand
from bracket_cell.skills.hand_over import HandOver, HoldForPerson, TakeFromHand
from bracket_cell.skills.motion.planner import MotionPlanner
from bracket_cell.skills.pick_and_place import Pick
from bracket_ground.interfaces.bench import Bench
from bracket_ground.interfaces.command import Command, GripperCommand, HandCommand
from bracket_ground.interfaces.faults import HAND_TOO_NEAR, Action, SafetyDecision
from bracket_ground.interfaces.observation import GripperState, ObjectStatus, Observation
from bracket_ground.interfaces.operator import OperatorOrder, OperatorState
from bracket_ground.interfaces.perception import Action as HandAction
from bracket_ground.interfaces.perception import ActionKind, HandSample
from bracket_ground.interfaces.pose import FINGERS_DOWN, Pose
from bracket_ground.interfaces.product import Product
from bracket_ground.interfaces.skill import Progress, Skill, SkillStatus
from tests.skills.ideal_robot import TICK_S, IdealRobot
from tests.skills.test_skills import seen

OUT = Pose.from_yaw((0.93, 0.20, 0.20), math.pi / 2) @ FINGERS_DOWN
AT_PART, FAR = (0.96, 0.20), (1.12, 0.44)
AT_PADS, BEHIND = (0.94, 0.20), (0.87, 0.16)  # between the pads, and an arm that reaches past them
HELD = SafetyDecision(Action.HOLD, 0.0, holding_faults=(HAND_TOO_NEAR,))


@dataclass
class Beside:
    """What a hand does in a tick.

    Attributes:
        at_m: where it is seen; None for nobody in view.
        force_n: along x at the tool; None where the arm tells none.
        lost: nobody knows where the hand is.
        moves_m: so far it moved the fingers, which then say that they grip nothing.
        closing: the fingers are on their way.
    """

    at_m: tuple[float, float] | None = FAR
    force_n: float | None = 0.0
    lost: bool = False
    speed_m_s: float = 0.0
    moves_m: float = 0.0
    closing: bool = False
    action: ActionKind = "idle"
    said: tuple[OperatorOrder, ...] = ()


class HandedRobot(IdealRobot):
    """An ideal robot that a near hand holds as the supervisor would."""

    def __init__(self, joints_rad: tuple[float, ...], part_m: float | None = None) -> None:
        super().__init__(joints_rad, part_m)
        self.does: Callable[[float], Beside] = lambda _: Beside()

    def observe(self) -> Observation:
        now, plain = self.does(self.time_s), super().observe()
        bench = plain.bench
        assert bench is not None
        hand = None
        if now.at_m is not None:
            x, y = now.at_m
            hand = HandSample(self.time_s, (9, 9, 99, 99), now.at_m, (x + 0.1, y), velocity_m_s=(now.speed_m_s, 0.0))
        bench = replace(bench, hand=hand, hand_unknown="lost" * now.lost, action=HandAction(now.action, 1.0))
        force = None if now.force_n is None else (now.force_n, 0.0, 0.0)
        near, gripper = now.at_m in (AT_PART, AT_PADS, BEHIND), plain.gripper
        if now.moves_m and gripper.holding:
            opening_m, status = gripper.opening_m + now.moves_m, ObjectStatus.AT_POSITION
            gripper = replace(gripper, opening_m=opening_m, object_status=status)
        if now.closing:
            gripper = replace(gripper, object_status=ObjectStatus.MOVING)
        return replace(
            plain,
            gripper=gripper,
            bench=bench,
            arm=replace(plain.arm, force_n=force),
            speed_scale=0.0 if near else plain.speed_scale,
            holding_faults=(HAND_TOO_NEAR,) if near else (),
            operator=OperatorState(said=now.said),
        )

    def act(self, command: Command) -> None:
        """As far as the supervisor lets it."""
        observed = self.observe()
        if observed.holding_faults:
            withhold(command, observed, HELD)
        super().act(command)


@pytest.fixture
def robot(planner: MotionPlanner, product: Product, bench: Bench) -> HandedRobot:
    """One that holds an o2."""
    robot = HandedRobot(bench.arm_look_rad, part_m=0.034)
    assert robot.run(Pick(planner, seen(product, "o2", 0.55, -0.4))).status is SkillStatus.SUCCESS
    return robot


def over(planner: MotionPlanner, robot: HandedRobot, does: Callable[[float], Beside], pull_n: float = 8.0) -> Progress:
    """Hand the o2 over beside a hand, of which `does` tells by the seconds since the arm stood."""
    skill, stood = HandOver(planner, "o2", OUT, wait_s=10.0, pull_n=pull_n), list[float]()

    def now(time_s: float) -> Beside:
        if not stood and skill._phases is not None and len(skill._phases) < 3:
            stood.append(time_s)
        return does(time_s - stood[0]) if stood else Beside()

    robot.does = now
    return robot.run(skill)


def pulls(since_s: float, until_s: float = math.inf, force_n: float = 15.0) -> Callable[[float], Beside]:
    """A hand that comes after a second, pulls, and leaves with the part."""

    def does(time_s: float) -> Beside:
        if time_s < 1.0 or time_s > 4.0:
            return Beside()
        return Beside(AT_PART, force_n if since_s <= time_s <= until_s else 0.0)

    return does


def opened(robot: HandedRobot) -> bool:
    return not robot.observe().gripper.holding


def test_a_hand_that_pulls_gets_the_part_though_it_holds_the_arm(planner: MotionPlanner, robot: HandedRobot) -> None:
    progress = over(planner, robot, pulls(2.0))
    assert (progress.status, progress.reason) == (SkillStatus.SUCCESS, "o2 was handed over")
    assert opened(robot)


@pytest.mark.parametrize("force_n", [-15.0, -30.0, -50.0])
def test_a_hand_that_pushes_at_the_part_does_not_get_it(
    planner: MotionPlanner, robot: HandedRobot, force_n: float
) -> None:
    assert over(planner, robot, pulls(2.0, force_n=force_n)).reason == "nobody took o2 in 10 s"
    assert not opened(robot)


def test_a_hand_that_pulls_while_the_part_is_still_brought_gets_it(planner: MotionPlanner, robot: HandedRobot) -> None:
    assert over(planner, robot, lambda _: Beside(AT_PART, 15.0)).status is SkillStatus.SUCCESS
    assert opened(robot)


@pytest.mark.parametrize("brought", [True, False])
@pytest.mark.parametrize(("moves_m", "gets"), [(0.002, True), (-0.03, False)])
def test_fingers_that_a_hand_moved_a_little_still_hold_the_part(
    planner: MotionPlanner, robot: HandedRobot, moves_m: float, gets: bool, brought: bool
) -> None:
    begins_s = robot.time_s

    def does(time_s: float) -> Beside:
        since_s = robot.time_s - begins_s - 2.0 if brought else time_s - 1.0
        return Beside() if since_s < 0 else Beside(AT_PART, 3.0 if since_s < 1 else 15.0, moves_m=moves_m)

    robot.does = does
    progress = robot.run(HandOver(planner, "o2", OUT, wait_s=10.0)) if brought else over(planner, robot, does)
    assert (progress.status is SkillStatus.SUCCESS) == gets


@pytest.mark.parametrize(
    ("does", "says"),
    [
        (lambda _: Beside(), "nobody took o2"),
        (pulls(9.0), "nobody took o2"),  # a hand is there, and never pulls
        (pulls(2.0, 2.06), "nobody took o2"),  # a knock
        (pulls(2.0, force_n=4.0), "nobody took o2"),
        (lambda time_s: Beside(None, 15.0 if time_s > 1 else 0.0), "nobody took o2"),  # nobody is seen who pulls
        (lambda time_s: Beside(FAR, 15.0 if time_s > 1 else 0.0), "nobody took o2"),
        (lambda time_s: Beside(AT_PART, 15.0 if time_s > 1 else 0.0, lost=time_s > 0.8), "nobody took o2"),
        (lambda time_s: Beside(AT_PART if time_s > 1 else FAR, math.nan), "nobody took o2"),
        (pulls(2.0, force_n=90.0), "o2 is kept: 90 N at it is more than a pull, 60 N"),
        (lambda _: Beside(force_n=None), "the arm does not tell what pulls at it"),
    ],
)
def test_fingers_keep_the_part_in_doubt(
    planner: MotionPlanner, robot: HandedRobot, does: Callable[[float], Beside], says: str
) -> None:
    progress = over(planner, robot, does)
    assert progress.status is SkillStatus.FAILURE
    assert says in progress.reason
    assert not opened(robot)


def test_a_hand_that_goes_again_does_not_open_the_fingers_later(planner: MotionPlanner, robot: HandedRobot) -> None:
    def does(time_s: float) -> Beside:
        return Beside(AT_PART if 1.0 < time_s < 2.0 else FAR, 15.0 if time_s > 1.95 else 0.0)

    assert over(planner, robot, does).status is SkillStatus.FAILURE
    assert not opened(robot)


def test_a_part_that_is_pulled_out_early_is_told(planner: MotionPlanner, robot: HandedRobot) -> None:
    def does(time_s: float) -> Beside:
        if time_s > 1.0:
            robot.drop()
        return Beside()

    assert "pulled out of the closed fingers" in over(planner, robot, does).reason


def give(bench: Bench, width_m: float | None, does: Callable[[float], Beside]) -> HandedRobot:
    robot = HandedRobot(bench.arm_look_rad)
    robot.does = lambda time_s: does(time_s) if robot._opening_m and not robot._moving else Beside()
    robot.part_m = width_m
    return robot


def comes(time_s: float, *, leaves_s: float = math.inf, speed_m_s: float = 0.0) -> Beside:
    return Beside(AT_PART, speed_m_s=speed_m_s) if 8.0 < time_s < leaves_s else Beside()


def test_a_part_is_taken_from_a_hand_that_holds_it_still(planner: MotionPlanner, bench: Bench) -> None:
    robot = give(bench, 0.034, lambda time_s: comes(time_s, leaves_s=11.0))
    progress = robot.run(TakeFromHand(planner, "o2", OUT, wait_s=12.0))
    assert (progress.status, progress.reason) == (SkillStatus.SUCCESS, "holding o2")
    goals = [command.gripper for command in robot.sent if command.gripper is not None]
    beside = [goal for goal in goals if isinstance(goal, HandCommand)]
    assert [(goal.opening_m, goal.speed_m_s, goal.force_n) for goal in beside] == [(0.0, 0.02, 20.0)]
    assert goals[-1].force_n == planner.settings.grip_force_n


@pytest.mark.parametrize(
    ("does", "width_m"),
    [
        (lambda _: Beside(), 0.034),
        (lambda time_s: comes(time_s, speed_m_s=0.3), 0.034),  # it never holds still
        (lambda time_s: replace(comes(time_s), lost=time_s > 7.9), 0.034),
        (lambda time_s: comes(time_s), 0.060),  # this is no o2: the fingers open again
    ],
)
def test_nothing_is_taken_from_nobody_or_what_is_no_such_part(
    planner: MotionPlanner, bench: Bench, does: Callable[[float], Beside], width_m: float
) -> None:
    robot = give(bench, width_m, does)
    progress = robot.run(TakeFromHand(planner, "o2", OUT, wait_s=12.0))
    assert (progress.status, progress.reason) == (SkillStatus.FAILURE, "nobody gave o2 in 12 s")
    assert opened(robot)


def goals_beside(robot: HandedRobot) -> list[float]:
    """What the fingers were told beside a hand, in order."""
    return [command.gripper.opening_m for command in robot.sent if isinstance(command.gripper, HandCommand)]


@pytest.mark.parametrize("at_m", [AT_PADS, BEHIND])
def test_fingers_do_not_close_where_a_hand_is_seen_between_them(
    planner: MotionPlanner, bench: Bench, at_m: tuple[float, float]
) -> None:
    robot = give(bench, 0.034, lambda time_s: Beside(at_m) if time_s > 8.0 else Beside())
    said = words_of(robot, TakeFromHand(planner, "o2", OUT, wait_s=12.0))
    assert goals_beside(robot) == []
    assert "a hand is between the fingers: please put o2 there by one end" in said


@pytest.mark.parametrize(
    "then", [Beside(AT_PADS, closing=True), Beside(BEHIND, closing=True), Beside(AT_PART, lost=True, closing=True)]
)
def test_fingers_that_close_open_again_where_a_hand_comes_between_them(
    planner: MotionPlanner, bench: Bench, then: Beside
) -> None:
    robot = give(bench, 0.034, lambda time_s: replace(comes(time_s), closing=time_s > 8.0) if time_s < 10.0 else then)
    words_of(robot, TakeFromHand(planner, "o2", OUT, wait_s=12.0))
    assert goals_beside(robot) == [0.0, planner.open_m]


def test_fingers_that_closed_on_more_than_the_part_say_what_may_be_beside_it(
    planner: MotionPlanner, bench: Bench
) -> None:
    robot = give(bench, 0.050, comes)
    said = words_of(robot, TakeFromHand(planner, "o2", OUT, wait_s=12.0))
    assert "this is no o2, or something is beside it: please put it between the fingers by one end" in said


def words_of(robot: HandedRobot, skill: Skill) -> set[str]:
    """What a skill says until it ends."""
    said, polled = set[str](), skill.poll

    def poll(observation: Observation, command: Command) -> Progress:
        progress = polled(observation, command)
        said.add(progress.reason)
        return progress

    skill.poll = poll  # type: ignore[method-assign]
    robot.run(skill)
    return said


def fasten(robot: HandedRobot, planner: MotionPlanner, **told: object) -> tuple[Progress, float]:
    """Hold the o2 at p4 beside a hand there that does this from 8 to 11 s; when the fingers opened [s]."""
    at_hole = (0.74, planner.bench.bracket.position_m[1] - 0.04)
    robot.does = lambda time_s: Beside(at_hole, **told) if 8.0 < time_s < 11.0 else Beside()  # type: ignore[arg-type]
    robot.tick = 0
    progress = robot.run(HoldForPerson(planner, "p4", "o2", wait_s=20.0))
    opens = [n for n, command in enumerate(robot.sent) if command.gripper and command.gripper.opening_m > 0.034]
    return progress, (opens[-1] - len(robot.sent) + robot.tick) * TICK_S


@pytest.mark.parametrize("told", [{"action": "screw"}, {"said": (OperatorOrder("fastened", "s1", time_s=9.0),)}])
def test_a_part_is_held_until_it_is_fastened_and_the_hand_has_left(
    planner: MotionPlanner, robot: HandedRobot, told: dict[str, object]
) -> None:
    progress, opened_s = fasten(robot, planner, **told)
    assert (progress.status, progress.reason) == (SkillStatus.SUCCESS, "o2 was held at p4 until it was fastened")
    assert opened_s > 11.0


def test_what_nobody_fastens_is_let_go_and_told(planner: MotionPlanner, robot: HandedRobot) -> None:
    progress, _ = fasten(robot, planner)
    assert (progress.status, progress.reason) == (SkillStatus.FAILURE, "nobody fastened o2 in 20 s; it was let go")
    assert opened(robot)


@pytest.mark.parametrize("tick", range(0, 240, 20))
def test_a_hand_over_that_is_halted_keeps_the_part(planner: MotionPlanner, robot: HandedRobot, tick: int) -> None:
    skill: Skill = HandOver(planner, "o2", OUT)
    for _ in range(tick):
        command = Command()
        skill.poll(robot.observe(), command)
        robot.act(command)
    command = Command()
    skill.halt(command)
    robot.act(command)
    assert not opened(robot)


OPEN = HandCommand(0.06, 0.15, 20.0)


@pytest.mark.parametrize(
    ("goal", "holding_faults", "moves"),
    [
        (OPEN, (HAND_TOO_NEAR,), True),
        (GripperCommand(0.06, 0.15, 20.0), (HAND_TOO_NEAR,), False),
        (OPEN, (HAND_TOO_NEAR, "hand_unknown"), False),
        (OPEN, ("bench_stale",), False),
        (OPEN, ("operator_pause",), False),
        (HandCommand(0.0, 0.02, 20.0), (HAND_TOO_NEAR,), True),
        (HandCommand(0.0, 0.15, 20.0), (HAND_TOO_NEAR,), False),
        (HandCommand(0.0, 0.02, 60.0), (HAND_TOO_NEAR,), False),
        (HandCommand(math.nan, 0.15, math.nan), (HAND_TOO_NEAR,), False),
    ],
)
def test_fingers_move_beside_a_hand_only_to_give_or_to_take_gently(
    robot: HandedRobot, goal: GripperCommand, holding_faults: tuple[str, ...], moves: bool
) -> None:
    command, judgement = Command(gripper=goal), SafetyDecision(Action.HOLD, 0.0, holding_faults=holding_faults)
    withhold(command, robot.observe(), judgement)
    assert (command.gripper is goal) == moves
    assert with_hand(goal, robot.observe().gripper, SafetyDecision(Action.STOP, 0.0)) is False


@pytest.mark.parametrize(("goal", "contradicts"), [(OPEN, False), (GripperCommand(0.06, 0.15, 20.0), True)])
def test_the_supervisor_knows_of_fingers_that_opened_to_a_hand(goal: GripperCommand, contradicts: bool) -> None:
    """What was withheld did not go out: fingers that stand open then say what they cannot."""
    memory, taken = GripperMemory(), GripperState(0.0, True, ObjectStatus.CONTACT_CLOSING, 0.034, 0.1, 0)
    memory.see(taken, 0.0)
    memory.command(Command(gripper=GripperCommand(0.0)), SafetyDecision(), 0.0)
    found = []
    for tick in range(1, 100):
        now_s = tick * TICK_S
        opening_m = min(0.06, 0.034 + 0.15 * max(0.0, now_s - 2.04))
        status = ObjectStatus.AT_POSITION if opening_m == 0.06 else ObjectStatus.MOVING
        told = (
            replace(taken, time_s=now_s)
            if now_s < 2.04
            else replace(taken, time_s=now_s, opening_m=opening_m, object_status=status)
        )
        memory.see(told, now_s)
        found.append(memory.contradicts)
        command = Command(gripper=goal if tick == 50 else None)
        sent = command.gripper
        if sent is not None and not with_hand(sent, told, HELD):
            command.gripper = None
        memory.command(command, HELD if now_s < 2.6 else SafetyDecision(), now_s)
    assert any(found) == contradicts
