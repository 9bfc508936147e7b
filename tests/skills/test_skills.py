"""Skills on an ideal robot: what they send, how they fail, and that they can be halted at any tick."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from bracket_cell.skills.grasping.contact import Descend, tool_height_m
from bracket_cell.skills.grasping.handling import joints_of, present_hold
from bracket_cell.skills.grasping.phases import PhasedSkill, SetGripper
from bracket_cell.skills.grasping.straight import MoveUntilContact
from bracket_cell.skills.motion.grasp_pose import hole_pose
from bracket_cell.skills.motion.lying_grasp import lying_holds
from bracket_cell.skills.motion.planner import Load, MotionPlanner, settled
from bracket_cell.skills.motion.trajectory import joint_move
from bracket_cell.skills.move_aside import MoveAside
from bracket_cell.skills.move_to import MoveTo
from bracket_cell.skills.pick_and_place import Pick, Place
from bracket_cell.skills.put_down import PutBack
from bracket_ground.interfaces.bench import Bench
from bracket_ground.interfaces.command import Command, GripperCommand
from bracket_ground.interfaces.grasping import OFF_MIDDLE_M
from bracket_ground.interfaces.grip import Grip, Hold
from bracket_ground.interfaces.gripper import load_gripper
from bracket_ground.interfaces.observation import GripperState, ObjectStatus
from bracket_ground.interfaces.perception import PartDetection
from bracket_ground.interfaces.pose import Array, Pose
from bracket_ground.interfaces.product import Product
from bracket_ground.interfaces.skill import SkillStatus
from tests.skills.ideal_robot import TICK_S, IdealRobot

DATASHEET_RAD_S = np.radians([120.0, 120.0, 180.0, 180.0, 180.0, 180.0])


def seen(product: Product, part: str, x: float, y: float, yaw: float = 0.3, z: float = 0.016) -> PartDetection:
    kind = product.parts[part]
    return PartDetection(part, 1.0, Pose.from_yaw((x, y, z), yaw), kind.size_m, (0, 0, 0, 0))


@pytest.fixture
def robot(bench: Bench) -> IdealRobot:
    return IdealRobot(bench.arm_look_rad, part_m=0.034)


def holding(planner: MotionPlanner, product: Product, robot: IdealRobot) -> IdealRobot:
    """The robot after picking an o2."""
    assert robot.run(Pick(planner, seen(product, "o2", 0.55, -0.4))).status is SkillStatus.SUCCESS
    return robot


def test_what_was_taken_and_not_lifted_goes_straight_up_with_the_next_motion_and_does_not_stop_there(
    planner: MotionPlanner, product: Product, robot: IdealRobot
) -> None:
    part, beside = seen(product, "o2", 0.55, -0.4), seen(product, "o1", 0.55, -0.31)
    progress = robot.run(Pick(planner, part, [beside], lifts=False))
    assert (progress.status, progress.reason) == (SkillStatus.SUCCESS, "holding o2")
    assert tool_height_m(planner, robot.observe()) < 0.05
    before = len(robot.sent)
    assert robot.run(Place(planner, "p6", "o2", [beside])).status is SkillStatus.SUCCESS
    way = next(command.follow for command in robot.sent[before:] if command.follow is not None)
    tools_m = np.array([planner.kinematics.forward(joints).position_m for joints in way.positions_rad])
    straight = np.hypot(*(tools_m[:, :2] - tools_m[0, :2]).T) < 0.001
    clear_m = tools_m[~straight][0, 2] - tools_m[0, 2]
    assert clear_m > product.parts["o1"].size_m[2] / 2, "the neighbour is passed above"
    stands = np.abs(np.diff(way.positions_rad, axis=0)).max(axis=1) < 1e-4
    assert not stands[20:-20].any()


@pytest.mark.parametrize("halted_m", [0.01, 0.03])
def test_a_lift_that_was_halted_is_gone_on_with(
    planner: MotionPlanner, product: Product, robot: IdealRobot, halted_m: float
) -> None:
    assert robot.run(Pick(planner, seen(product, "o2", 0.55, -0.4), lifts=False)).status is SkillStatus.SUCCESS
    low_m, place = tool_height_m(planner, robot.observe()), Place(planner, "p6", "o2")
    while tool_height_m(planner, robot.observe()) < low_m + halted_m:
        command = Command()
        place.poll(robot.observe(), command)
        robot.act(command)
    command = Command()
    place.halt(command)
    robot.act(command)
    here = planner.kinematics.forward(np.array(robot.observe().arm.positions_rad))
    before = len(robot.sent)
    assert robot.run(MoveTo(planner, "park", held="o2")).status is SkillStatus.SUCCESS
    way = next(command.follow for command in robot.sent[before:] if command.follow is not None)
    first = planner.kinematics.forward(way.positions_rad[len(way.times_s) // 8])
    rose = first.position_m[2] - here.position_m[2]
    assert np.hypot(*np.subtract(first.position_m, here.position_m)[:2]) <= rose
    assert planner.lifts_to is None


def test_pick_ends_with_the_part_held_above_what_stands_near_it(
    planner: MotionPlanner, product: Product, robot: IdealRobot, bench: Bench
) -> None:
    progress = robot.run(Pick(planner, seen(product, "o2", 0.55, -0.4)))
    assert (progress.status, progress.reason) == (SkillStatus.SUCCESS, "holding o2")
    observation = robot.observe()
    assert observation.gripper.holding
    lone_m = tool_height_m(planner, observation)
    assert lone_m > 0.07
    assert robot.time_s < 3.0
    beside = [seen(product, "o1", 0.55, -0.3)]
    robot = IdealRobot(bench.arm_look_rad, part_m=0.034)
    assert robot.run(Pick(planner, seen(product, "o2", 0.55, -0.4), beside)).status is SkillStatus.SUCCESS
    assert tool_height_m(planner, robot.observe()) > lone_m + 0.0199


def test_place_lets_go_in_the_hole(planner: MotionPlanner, product: Product, robot: IdealRobot) -> None:
    holding(planner, product, robot)
    before = len(robot.sent)
    progress = robot.run(Place(planner, "p4", "o2"))
    assert (progress.status, progress.reason) == (SkillStatus.SUCCESS, "o2 was let go at p4")
    releases = [i for i, command in enumerate(robot.sent) if i >= before and command.gripper is not None]
    assert len(releases) == 1
    assert not robot.observe().gripper.holding
    lowest = min(
        planner.kinematics.forward(joints).position_m
        for trajectory in robot.trajectories[-1:]
        for joints in trajectory.positions_rad[-1:]
    )
    assert lowest[0] == pytest.approx(0.72, abs=1e-3)


@pytest.mark.parametrize("opens", [0, 1, 3])
def test_a_release_that_was_broken_off_is_gone_on_with(
    planner: MotionPlanner, product: Product, robot: IdealRobot, opens: int
) -> None:
    """As a hand came between: the part between the fingers is the one that stands in the hole."""
    holding(planner, product, robot)
    place = Place(planner, "p4", "o2")
    while planner.around is None or opens > 0:
        opens -= planner.around is not None
        command = Command()
        place.poll(robot.observe(), command)
        robot.act(command)
    command = Command()
    place.halt(command)
    robot.act(command)
    progress = robot.run(Place(planner, "p4", "o2"))
    assert (progress.status, progress.reason) == (SkillStatus.SUCCESS, "o2 was let go at p4")
    assert not robot.observe().gripper.holding


def test_from_a_part_in_its_hole_the_fingers_go_up_before_they_go_aside(
    planner: MotionPlanner, product: Product, robot: IdealRobot
) -> None:
    holding(planner, product, robot)
    assert robot.run(Place(planner, "p4", "o2")).status is SkillStatus.SUCCESS
    let_go = planner.kinematics.forward(np.array(robot.observe().arm.positions_rad)).position_m
    assert planner.around is not None
    assert robot.run(MoveTo(planner, "park")).status is SkillStatus.SUCCESS
    for joints in robot.trajectories[-1].positions_rad:
        x, y, z = np.subtract(planner.kinematics.forward(joints).position_m, let_go)
        assert z > 0.02 or np.hypot(x, y) < 0.005
    assert planner.around is None


def test_a_tool_that_was_pushed_against_the_part_it_let_go_leaves_it_upwards(
    planner: MotionPlanner, product: Product, robot: IdealRobot, bench: Bench
) -> None:
    """A hand pushes the arm: from there no way was free, and a person was told to empty fingers that were."""
    holding(planner, product, robot)
    assert robot.run(Place(planner, "p4", "o2")).status is SkillStatus.SUCCESS
    seen_from = robot.observe()
    load, let_go = Load(seen_from.gripper.opening_m), planner.kinematics.forward(joints_of(seen_from))
    for pushed_m in np.linspace(-0.03, 0.03, 61):
        x, y, z = let_go.position_m
        joints = planner.kinematics.follow(Pose((x, y + pushed_m, z), let_go.quaternion_wxyz), joints_of(seen_from))
        assert joints is not None
        way = planner.free_move(joints, np.array(bench.arm_park_rad), load)
        assert not isinstance(way, str), f"{pushed_m:.3f}: {way}"
        first = planner.kinematics.forward(way.positions_rad[len(way.times_s) // 8]).position_m
        assert first[2] > z


@pytest.mark.parametrize("skill", [Pick, MoveAside])
def test_the_way_to_a_part_in_the_tray_keeps_clear_of_parts_in_holes(
    planner: MotionPlanner, product: Product, robot: IdealRobot, skill: type[Pick | MoveAside]
) -> None:
    robot.holes = {"p5": "o3"}
    phases = skill(planner, seen(product, "o2", 0.55, -0.4), []).prepare(robot.observe())
    assert not isinstance(phases, str), phases
    (descent,) = [phase for phase in phases if isinstance(phase, Descend)]
    assert "o3 at p5" in [box.name for box in descent.load.obstacles]


def test_around_a_part_in_its_hole_the_fingers_do_not_close_for_the_next_one(
    planner: MotionPlanner, product: Product, bench: Bench
) -> None:
    robot = IdealRobot(bench.arm_look_rad, part_m=0.065)
    beside = [seen(product, "o2", 0.55, -0.36, 0.0)]
    assert robot.run(Pick(planner, seen(product, "o2", 0.55, -0.4, 0.0), beside)).status is SkillStatus.SUCCESS
    assert robot.run(Place(planner, "p4", "o2", beside)).status is SkillStatus.SUCCESS
    assert (around := planner.around) is not None
    robot.part_m = 0.034
    picked = Pick(planner, seen(product, "o2", 0.55, -0.4))
    status = SkillStatus.RUNNING
    told = None
    while status is SkillStatus.RUNNING and told is None:
        seen_from, command = robot.observe(), Command()
        status = picked.poll(seen_from, command).status
        if command.gripper is not None:
            told = planner.kinematics.forward(np.array(seen_from.arm.positions_rad)).position_m
        robot.act(command)
    assert told is not None
    assert command.gripper is not None
    assert command.gripper.opening_m < 0.065
    assert np.abs(np.subtract(told, around.pose.position_m)).max() > 0.08
    assert robot.run(picked).status is SkillStatus.SUCCESS


def test_a_part_held_across_its_length_is_placed_with_the_tool_turned(
    planner: MotionPlanner, product: Product, bench: Bench
) -> None:
    headings = []
    for beside, part_m in (([], 0.034), ([seen(product, "o2", 0.55, -0.36, 0.0)], 0.065)):
        robot = IdealRobot(bench.arm_look_rad, part_m=part_m)
        assert robot.run(Pick(planner, seen(product, "o2", 0.55, -0.4, 0.0), beside)).status is SkillStatus.SUCCESS
        grasped = planner.kinematics.forward(np.array(robot.observe().arm.positions_rad)).yaw_rad
        assert robot.run(Place(planner, "p4", "o2", beside)).status is SkillStatus.SUCCESS
        placed = planner.kinematics.forward(np.array(robot.observe().arm.positions_rad)).yaw_rad
        assert np.sin(placed - grasped) == pytest.approx(0.0, abs=1e-3)
        headings.append(placed)
    assert np.cos(headings[0] - headings[1]) == pytest.approx(0.0, abs=1e-3)


def beside_its_middle(product: Product) -> list[PartDetection]:
    """What leaves an o2 at (0.55, -0.4) but one way to be taken: across its width, towards +x."""
    return [
        seen(product, "o3", 0.635, -0.4, 0.0),
        seen(product, "o2", 0.527, -0.345, np.pi / 2),
    ]


def test_a_part_taken_beside_its_middle_goes_to_the_middle_of_its_hole(
    planner: MotionPlanner, product: Product, robot: IdealRobot
) -> None:
    beside = beside_its_middle(product)
    part = seen(product, "o2", 0.55, -0.4, 0.0)
    assert robot.run(Pick(planner, part, beside)).status is SkillStatus.SUCCESS
    tool = planner.kinematics.forward(np.array(robot.observe().arm.positions_rad))
    assert tool.position_m[:2] == pytest.approx((0.55 + OFF_MIDDLE_M[1], -0.4), abs=1e-3)
    part_from_tool = np.subtract(tool.position_m[:2], (0.55, -0.4)) * np.cos(tool.yaw_rad - np.pi / 2)
    assert robot.run(Place(planner, "p4", "o2", beside)).status is SkillStatus.SUCCESS
    above = planner.kinematics.forward(np.array(robot.observe().arm.positions_rad))
    hole = hole_pose(planner.product, planner.bench, "p4").position_m
    offset = part_from_tool * np.cos(above.yaw_rad - np.pi / 2)
    assert above.position_m[:2] == pytest.approx(tuple(hole[:2] + offset), abs=1e-3)


def test_a_part_found_in_the_gripper_may_be_held_anywhere_along_its_sides(
    planner: MotionPlanner, product: Product, robot: IdealRobot
) -> None:
    holding(planner, product, robot)
    observation = robot.observe()
    assert present_hold(planner, "o2", observation) == planner.hold == Hold(Grip.WIDTH)
    planner.hold = None  # another controller
    assert present_hold(planner, "o2", observation) == Hold(Grip.WIDTH, unsure_m=OFF_MIDDLE_M[1])
    assert robot.run(PutBack(planner, "o2", [])).status is SkillStatus.SUCCESS


def test_fingers_come_down_slowly_where_there_is_little_room(
    planner: MotionPlanner, product: Product, bench: Bench
) -> None:
    durations = []
    for gap_m in (0.021, 0.017):
        robot = IdealRobot(bench.arm_look_rad, part_m=0.032)
        beside = [seen(product, "o3", 0.55, -0.4 + 0.042 + gap_m, 0.0)]
        assert robot.run(Pick(planner, seen(product, "o3", 0.55, -0.4, 0.0), beside)).status is SkillStatus.SUCCESS
        durations.append(robot.trajectories[0].duration_s)
    assert durations[1] > durations[0] + 0.05


def test_all_motions_keep_the_limits_and_start_where_the_arm_is(
    planner: MotionPlanner, product: Product, robot: IdealRobot, bench: Bench
) -> None:
    holding(planner, product, robot)
    robot.run(Place(planner, "p1", "o2"))
    robot.run(MoveTo(planner, "park"))
    end = np.array(bench.arm_look_rad)
    assert len(robot.trajectories) == 5
    for trajectory in robot.trajectories:
        np.testing.assert_allclose(trajectory.positions_rad[0], end, atol=1e-3)
        speeds = np.diff(trajectory.positions_rad, axis=0) / np.diff(trajectory.times_s)[:, None]
        assert (np.abs(speeds) <= DATASHEET_RAD_S).all()
        end = trajectory.positions_rad[-1]
    assert robot.at(np.array(bench.arm_park_rad))


def test_the_arm_parks_with_its_fingers_turned_as_is_soonest(planner: MotionPlanner, bench: Bench) -> None:
    park, look = np.array(bench.arm_park_rad), np.array(bench.arm_look_rad)
    for turned in (-np.pi, 0.0, np.pi / 2):
        robot = IdealRobot((*bench.arm_look_rad[:5], bench.arm_look_rad[5] + turned))
        assert robot.run(MoveTo(planner, "park")).status is SkillStatus.SUCCESS
        stands = np.array(robot.observe().arm.positions_rad)
        assert stands[:5] == pytest.approx(park[:5], abs=1e-6)
        assert np.sin(stands[5] - park[5]) == pytest.approx(0.0, abs=1e-6)
        there_s, on_s = (planner.travel_s(way) for way in (stands - robot_start(bench, turned), look - stands))
        usual_s = planner.travel_s(park - robot_start(bench, turned)) + planner.travel_s(look - park)
        assert there_s + on_s <= usual_s + 1e-3
    assert joint_move(park, look, planner.settings).duration_s <= 0.8


def robot_start(bench: Bench, turned: float) -> Array:
    """Looking, with the wrist turned."""
    joints: Array = np.array(bench.arm_look_rad)
    joints[5] += turned
    return joints


def test_move_to_where_the_arm_is_sends_nothing(planner: MotionPlanner, robot: IdealRobot) -> None:
    assert robot.run(MoveTo(planner, "look")).status is SkillStatus.SUCCESS
    assert robot.trajectories == []


def test_nothing_between_the_fingers_is_a_failure(planner: MotionPlanner, product: Product, robot: IdealRobot) -> None:
    robot.part_m = None
    progress = robot.run(Pick(planner, seen(product, "o2", 0.55, -0.4)))
    assert progress.status is SkillStatus.FAILURE
    assert "nothing between the fingers" in progress.reason


def test_a_dropped_part_is_a_failure_that_stops_the_arm(
    planner: MotionPlanner, product: Product, robot: IdealRobot
) -> None:
    holding(planner, product, robot)
    place = Place(planner, "p4", "o2")
    for _ in range(8):
        command = Command()
        place.poll(robot.observe(), command)
        robot.act(command)
    robot.drop()
    progress = robot.run(place)
    assert progress.status is SkillStatus.FAILURE
    assert "dropped" in progress.reason
    assert robot.sent[-1].stop_arm


@pytest.mark.parametrize(
    ("skill", "reason"),
    [
        (lambda planner, product: Pick(planner, seen(product, "o2", 1.5, 0.0)), "out of the arm's reach"),
        (lambda planner, product: Pick(planner, seen(product, "o2", 0.55, -0.4, z=-0.021)), "would touch the tray"),
        (
            lambda planner, product: Pick(
                planner, seen(product, "o3", 0.55, -0.4, 0.0), [seen(product, "o3", 0.55, -0.35, 0.0)]
            ),
            "no room for the fingers",
        ),
    ],
)
def test_what_cannot_be_picked_fails_before_anything_moves(
    planner: MotionPlanner, product: Product, robot: IdealRobot, skill: object, reason: str
) -> None:
    assert callable(skill)
    progress = robot.run(skill(planner, product))
    assert progress.status is SkillStatus.FAILURE
    assert reason in progress.reason
    assert robot.trajectories == []
    assert all(command.gripper is None for command in robot.sent)


def test_a_filled_hole_is_refused(planner: MotionPlanner, product: Product, robot: IdealRobot) -> None:
    holding(planner, product, robot)
    sent = len(robot.trajectories)
    robot.holes = {"p4": "o1"}
    progress = robot.run(Place(planner, "p4", "o2"))
    assert progress.status is SkillStatus.FAILURE
    assert "o1 is there" in progress.reason
    assert len(robot.trajectories) == sent


def test_an_arm_that_does_not_move_is_a_timeout(planner: MotionPlanner, robot: IdealRobot) -> None:
    robot.blocked = True
    progress = robot.run(MoveTo(planner, "park"))
    assert progress.status is SkillStatus.FAILURE
    assert "did not arrive in time" in progress.reason


def test_a_long_search_for_a_way_is_no_arm_that_does_not_arrive(
    planner: MotionPlanner, robot: IdealRobot, monkeypatch: pytest.MonkeyPatch
) -> None:
    ticks, found = round(2 * planner.settings.arm_timeout_s / TICK_S), planner.free_way
    monkeypatch.setattr(planner, "free_way", lambda *asked: iter([*[None] * ticks, settled(found(*asked))]))
    assert robot.run(MoveTo(planner, "park")).status is SkillStatus.SUCCESS
    assert robot.tick > ticks


def test_move_aside_moves_a_part_and_lets_go(planner: MotionPlanner, product: Product, robot: IdealRobot) -> None:
    part, other = seen(product, "o2", 0.55, -0.36, 1.5), seen(product, "o3", 0.55, -0.43, 0.0)
    progress = robot.run(MoveAside(planner, part, [other]))
    assert (progress.status, progress.reason) == (SkillStatus.SUCCESS, "o2 moved aside")
    assert not robot.observe().gripper.holding


@pytest.mark.parametrize("skill", [Pick, MoveAside])
def test_fingers_that_hold_a_part_do_not_open_over_the_tray_to_take_another(
    planner: MotionPlanner, product: Product, robot: IdealRobot, skill: type[Pick] | type[MoveAside]
) -> None:
    """As after a part that could not be put aside."""
    holding(planner, product, robot)
    before = len(robot.sent)
    progress = robot.run(skill(planner, seen(product, "o1", 0.5, -0.45), ()))
    assert progress.status is SkillStatus.FAILURE
    assert progress.reason == "cannot take o1: the gripper holds a part already"
    assert not [command for command in robot.sent[before:] if command.gripper is not None or command.follow is not None]
    assert robot.observe().gripper.holding


@pytest.mark.parametrize("name", ["pick", "place", "move aside", "move to"])
def test_every_skill_can_be_halted_at_any_tick(
    planner: MotionPlanner, product: Product, bench: Bench, name: str
) -> None:
    def start() -> tuple[IdealRobot, PhasedSkill]:
        robot = IdealRobot(bench.arm_look_rad, part_m=0.034)
        if name == "place":
            holding(planner, product, robot)
        skills: dict[str, PhasedSkill] = {
            "pick": Pick(planner, seen(product, "o2", 0.55, -0.4)),
            "place": Place(planner, "p2", "o2"),
            "move aside": MoveAside(planner, seen(product, "o2", 0.55, -0.4), []),
            "move to": MoveTo(planner, "park"),
        }
        return robot, skills[name]

    robot, skill = start()
    first = robot.tick
    robot.run(skill)
    length = robot.tick - first
    for ticks in range(0, length, max(1, length // 12)):
        robot, skill = start()
        for _ in range(ticks):
            command = Command()
            skill.poll(robot.observe(), command)
            robot.act(command)
        command = Command()
        skill.halt(command)
        assert command.stop_arm
        assert command.follow is None
        assert command.gripper is None
        robot.act(command)
        assert not robot.observe().arm.moving
        after = Command()
        assert skill.poll(robot.observe(), after).status is not SkillStatus.RUNNING
        assert after == Command()


def test_a_start_that_a_halt_withdrew_in_the_same_tick_is_made_again(planner: MotionPlanner, robot: IdealRobot) -> None:
    skill, command = MoveTo(planner, "park"), Command()
    skill.poll(robot.observe(), command)
    assert command.follow is not None
    MoveTo(planner, "look").halt(command)
    robot.act(command)
    assert robot.run(skill, limit_s=10.0).status is SkillStatus.SUCCESS
    assert len(robot.trajectories) == 1


def test_no_skill_begins_in_the_tick_of_a_stop(planner: MotionPlanner, robot: IdealRobot) -> None:
    skill, command = MoveTo(planner, "park"), Command(stop_arm=True)
    assert skill.poll(robot.observe(), command).reason == "waiting until the arm has stopped"
    assert command.follow is None


@pytest.mark.parametrize("fault", [5, 7])
def test_fingers_that_do_not_let_go_are_a_failure(planner: MotionPlanner, robot: IdealRobot, fault: int) -> None:
    """A9 of fault injection: a gripper that refused to open (gFLT 5 or 7) counted as having let go."""
    command = GripperCommand(0.085, 0.1, 40.0)
    phase, sent = SetGripper("letting go of o1", command, planner.settings), Command()
    held = replace(
        robot.observe(),
        gripper=GripperState(robot.time_s, True, ObjectStatus.CONTACT_CLOSING, 0.03, 0.1, fault),
    )
    assert phase.poll(held, sent).status is SkillStatus.RUNNING
    assert sent.gripper == command
    progress = phase.poll(held, Command())
    assert progress.status is SkillStatus.FAILURE
    assert "still hold something" in progress.reason


def test_a_cup_that_took_nothing_is_switched_off(planner: MotionPlanner, robot: IdealRobot) -> None:
    """One that goes on sucking takes something on the way, and nobody knows that it does."""
    cup = load_gripper("cup")
    assert cup.switched is not None
    settings = planner.settings.of(planner.settings.robot.model_copy(update={"gripper": cup}))
    phase = SetGripper("grasping o1", GripperCommand(0.0), settings, must_hold=True)
    empty = replace(robot.observe(), gripper=GripperState(robot.time_s, True, ObjectStatus.AT_POSITION, 0.0, 0.1, 0))
    phase.poll(empty, Command())
    progress = phase.poll(empty, sent := Command())
    assert progress.status is SkillStatus.FAILURE
    assert sent.gripper == GripperCommand(cup.switched.stroke_m)


def lost_on_the_way(robot: IdealRobot, skill: PhasedSkill, doing: str, after_ticks: int) -> list[Command]:
    """What is sent while the arm is held that lost its path in the middle of a motion; the skill is over afterwards."""
    before, lost_at = 0, None
    for _ in range(1500):
        command = Command()
        progress = skill.poll(robot.observe(), command)
        if progress.status is not SkillStatus.RUNNING:
            assert progress.status is SkillStatus.SUCCESS, progress.reason
            break
        robot.act(command)
        before = before + 1 if progress.reason.startswith(doing) else 0
        if before == after_ticks and lost_at is None:
            robot.lose_path(held_s=2.0)
            lost_at = len(robot.sent)
    assert lost_at is not None
    return robot.sent[lost_at : lost_at + 50]


@pytest.mark.parametrize(
    ("name", "doing", "after_ticks"),
    [
        ("pick", "going down to o2", 4),
        ("place", "lowering o2", 4),
        ("place", "lowering o2", 9),  # by feel
        ("put back", "lowering o2", 4),
    ],
)
def test_an_arm_that_lost_its_path_while_it_was_held_has_met_nothing(
    planner: MotionPlanner, product: Product, robot: IdealRobot, name: str, doing: str, after_ticks: int
) -> None:
    """Its clock goes on without it: it hangs far above where its trajectory would have it by now."""
    if name == "pick":
        skill: PhasedSkill = Pick(planner, seen(product, "o2", 0.55, -0.4))
    else:
        holding(planner, product, robot)
        skill = Place(planner, "p2", "o2") if name == "place" else PutBack(planner, "o2", ())
    while_held = lost_on_the_way(robot, skill, doing, after_ticks)
    assert not any(command.gripper or command.follow or command.stop_arm for command in while_held)


def test_an_arm_that_is_pushed_while_it_is_held_has_met_nothing(
    planner: MotionPlanner, product: Product, robot: IdealRobot
) -> None:
    """It hangs above its path, which it still has: only while it follows that freely, something below may be why."""
    skill = Pick(planner, seen(product, "o2", 0.55, -0.4))
    going_down = 0
    while going_down < 6:
        command = Command()
        progress = skill.poll(robot.observe(), command)
        assert progress.status is SkillStatus.RUNNING
        going_down += progress.reason.startswith("going down")
        robot.act(command)
        if going_down == 1:
            above = robot.observe().arm.positions_rad
    seen_now = robot.observe()
    pushed = replace(seen_now, arm=replace(seen_now.arm, positions_rad=above))
    assert skill.poll(replace(pushed, speed_scale=0.0), Command()).status is SkillStatus.RUNNING
    assert skill.poll(pushed, Command()).reason == "the fingers met something on the way down to o2"


def test_a_way_until_contact_that_was_lost_ends_no_farther_for_it(planner: MotionPlanner, robot: IdealRobot) -> None:
    start_m = tool_height_m(planner, robot.observe())
    skill = MoveUntilContact(planner, np.array([0.0, 0.0, -0.05]), 0.02)
    for tick in range(200):
        command = Command()
        progress = skill.poll(robot.observe(), command)
        robot.act(command)
        if tick == 30:
            robot.lose_path(held_s=1.0)
    assert progress.reason == "nothing was met on the whole way"
    assert tool_height_m(planner, robot.observe()) == pytest.approx(start_m - 0.05, abs=1e-3)


class OverFloor(IdealRobot):
    """A robot whose tool goes no lower than this, as what it holds rests on something then."""

    def __init__(self, planner: MotionPlanner, joints_rad: tuple[float, ...], part_m: float) -> None:
        super().__init__(joints_rad, part_m)
        self._planner, self.floor_m, self.lowest_m = planner, 0.0, 1.0

    def act(self, command: Command) -> None:
        before = self._joints
        super().act(command)
        if tool_height_m(self._planner, self.observe()) < self.floor_m:
            self._joints = before
        if self.observe().gripper.holding and command.gripper is None:
            self.lowest_m = min(self.lowest_m, tool_height_m(self._planner, self.observe()))


@pytest.mark.parametrize("lying", [False, True])
@pytest.mark.parametrize(("lower_m", "lets_go"), [(0.0, True), (0.012, True), (0.09, False)])
def test_a_part_that_hangs_lower_than_it_was_taken_is_let_go_where_it_rests(
    planner: MotionPlanner, product: Product, bench: Bench, lying: bool, lower_m: float, lets_go: bool
) -> None:
    """A person pulled it down in the fingers. What is met far above the ground is something else: it stays held."""
    lowest_m = 0.0
    for met_m in (None, lower_m):
        robot = OverFloor(planner, bench.arm_look_rad, 0.034)
        holding(planner, product, robot)
        planner.lying = lying_holds(product.parts["o2"], "+y", planner.settings)[0] if lying else None
        before, robot.lowest_m = len(robot.sent), 1.0
        robot.floor_m = 0.0 if met_m is None else lowest_m + met_m
        progress = robot.run(PutBack(planner, "o2", ()))
        lowest_m = robot.lowest_m
    opened = [command for command in robot.sent[before:] if command.gripper is not None]
    assert (progress.status is SkillStatus.SUCCESS, len(opened)) == (lets_go, int(lets_go)), progress.reason
    assert robot.observe().gripper.holding != lets_go
    assert lets_go or "it met something" in progress.reason
    assert not lets_go or tool_height_m(planner, robot.observe()) > robot.floor_m + 0.02
