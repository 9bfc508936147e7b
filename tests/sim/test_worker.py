"""The person alone assembles every goal, by friction, at a human pace, and lets the robot work."""

from __future__ import annotations

import numpy as np
import pytest

from bracket_ground.interfaces.command import Display
from bracket_ground.interfaces.pose import Pose
from bracket_sim.scene.hand import CONAFFINITY, FOREARM_GROUP, Hand
from bracket_sim.scene.parts import ScenePart
from bracket_sim.scene.person import PERSONS, Grip, Person, ScrewHabits
from bracket_sim.scene.storage import person_set
from tests.sim.worker_bench import Shift, bench, product, world_of, world_with_hand

GOALS = tuple(product().goals)
ARM_OVER_BRACKET_RAD = (-0.1, -1.6, 1.7, -1.67, -1.57, 0.0)
ARM_HELD_OUT_RAD = (0.04, -1.07, 1.46, -1.96, -1.57, 3.18)
BRISK = Person(screw=ScrewHabits(probability=0.0, unscrewed_limit=9))


def hole(position: str, height_m: float = 0.0) -> tuple[float, float, float]:
    x, y = product().bracket.holes_m[position]
    x, y, z = bench().bracket.pose.transform(np.array([x, y, height_m]))
    return float(x), float(y), float(z)


def with_robot_part(part: str, pose: Pose) -> Shift:
    """A shift in which the robot has left one part in the bracket."""
    scene = (*person_set(product(), bench()), ScenePart(part, pose))
    return Shift("g0", settings=BRISK, world=world_with_hand(scene))


@pytest.mark.long
@pytest.mark.parametrize("goal", GOALS[:1])
def test_person_alone_assembles(goal: str) -> None:
    shift = Shift(goal, seed=1)
    assert shift.until(lambda: shift.worker.done)
    assert shift.placed() == product().goal_placements(goal)


@pytest.mark.slow
@pytest.mark.parametrize("goal", GOALS)
def test_person_alone_assembles_almost_always(goal: str) -> None:
    right = 0
    for seed in range(30):
        shift = Shift(goal, seed)
        shift.until(lambda shift=shift: shift.worker.done)  # type: ignore[misc]
        right += shift.placed() == product().goal_placements(goal)
    assert right >= 29


def test_same_seed_same_bits() -> None:
    runs = [Shift(seed=3), Shift(seed=3)]
    for shift in runs:
        shift.until(lambda: False, 8.0)
    first, second = (shift.world.data for shift in runs)
    assert np.array_equal(first.qpos, second.qpos)
    assert np.array_equal(first.qvel, second.qvel)
    assert runs[0].worker.events == runs[1].worker.events


def test_hand_keeps_to_a_human_pace() -> None:
    shift = Shift("g1", seed=5)
    hand = Hand(shift.world.model, shift.world.data)
    fastest_m_s = 0.0
    while shift.time_s < 15.0:
        shift.period()
        fastest_m_s = max(fastest_m_s, hand.speed_m_s)
    assert 0.5 < fastest_m_s < 1.6


def test_part_falls_when_fingers_open() -> None:
    shift = Shift(seed=2)
    shift.until(lambda: shift.doing("assembly"))
    part = next(body for body in shift.world.bodies if shift.world.part_pose(body).position_m[2] > 0.1)
    hand = Hand(shift.world.model, shift.world.data)
    hand.command(hand.position_m, hand.yaw_rad, 0.1)
    for _ in range(60):
        shift.world.step_period()
    assert shift.world.part_pose(part).position_m[2] < 0.06


def test_actions_follow_each_other_without_gaps() -> None:
    shift = Shift(seed=4)
    shift.until(lambda: shift.time_s > 20.0)
    events = shift.worker.events
    ends, starts = events[1::2], events[2::2]
    assert all(event.edge == "end" for event in ends)
    assert [event.time_s for event in ends[: len(starts)]] == [event.time_s for event in starts]
    assert {event.kind for event in events} == {"idle", "transit", "assembly", "screw"}


def test_person_screws_a_few_seconds_and_disturbs_nothing() -> None:
    shift = Shift(seed=0)
    assert shift.until(lambda: shift.doing("screw"))
    before = shift.placed()
    began_s = shift.time_s
    assert shift.until(lambda: not shift.doing("screw"))
    assert 3.9 < shift.time_s - began_s < 6.1
    assert shift.placed() == before != {}


def test_filled_position_is_skipped() -> None:
    shift = with_robot_part("o3", Pose(hole("p6")))
    assert shift.until(lambda: shift.worker.done)
    assert shift.placed() == product().goal_placements("g0")
    assert all(event.position != "p6" for event in shift.worker.events)


def test_wrong_part_of_the_robot_is_taken_out_and_everything_done() -> None:
    shift = with_robot_part("o1", Pose(hole("p6")))
    assert shift.until(lambda: shift.worker.done)
    assert shift.placed() == product().goal_placements("g0")


def test_crooked_part_is_set_straight() -> None:
    x, y, z = hole("p4", height_m=0.013)  # the peg stands beside its hole
    shift = with_robot_part("o2", Pose((x + 0.018, y, z)))
    assert "p4" not in shift.placed()
    assert shift.until(lambda: shift.worker.done)
    assert shift.placed() == product().goal_placements("g0")


def test_person_waits_while_the_arm_is_not_parked() -> None:
    shift = Shift()
    shift.world.set_arm(bench().arm_look_rad)
    shift.until(lambda: False, 5.0)
    assert {event.kind for event in shift.worker.events} == {"idle"}
    shift.world.set_arm(bench().arm_park_rad)
    assert shift.until(lambda: shift.doing("assembly"), 5.0)


def test_help_request_gets_the_person_going() -> None:
    shift = Shift(seed=6)
    shift.world.set_arm(bench().arm_look_rad)
    shift.until(lambda: False, 2.0)
    shift.worker.show(Display(help_request="please place o3 at p6"))
    assert shift.until(lambda: shift.doing("assembly"), 5.0)
    assert (shift.worker.events[-1].part, shift.worker.events[-1].position) == ("o3", "p6")


def test_person_goes_on_when_the_arm_just_stands_there() -> None:
    shift = Shift()
    shift.world.set_arm(bench().arm_look_rad)
    assert not shift.until(lambda: shift.doing("transit"), 7.0)
    assert shift.until(lambda: shift.doing("transit"), 3.0)


def test_person_waits_longer_for_an_arm_that_holds_something_out_in_the_way_but_not_for_ever() -> None:
    shift = Shift()
    shift.world.set_arm(ARM_HELD_OUT_RAD)
    assert not shift.until(lambda: shift.doing("transit"), 15.0)
    assert shift.until(lambda: shift.doing("transit"), 20.0)


def test_person_stops_screwing_when_the_arm_comes() -> None:
    shift = Shift(seed=0)
    assert shift.until(lambda: shift.doing("screw"))
    shift.world.set_arm(ARM_OVER_BRACKET_RAD)
    assert shift.until(lambda: shift.doing("idle"), 2.0)
    assert not shift.until(lambda: not shift.doing("idle"), 12.0)


@pytest.mark.parametrize(("person", "goes_on"), [("careful", False), ("careful_brisk", True)])
def test_a_person_goes_on_when_the_arm_is_parked_or_already_when_it_leaves(person: str, goes_on: bool) -> None:
    shift = Shift(seed=0, settings=PERSONS[person])
    assert shift.until(lambda: shift.doing("screw"))
    shift.world.set_arm(ARM_OVER_BRACKET_RAD)
    assert shift.until(lambda: shift.doing("idle"), 2.0)
    assert not shift.until(lambda: not shift.doing("idle"), 2.0)
    beside = (ARM_OVER_BRACKET_RAD[0] - 0.6, *ARM_OVER_BRACKET_RAD[1:])
    shift.world.data.ctrl[shift.world.arm_ctrl] = beside
    assert shift.until(lambda: not shift.doing("idle"), 3.0) is goes_on


def test_person_with_a_part_waits_for_the_arm_to_leave_the_bracket() -> None:
    shift = Shift(seed=2)
    assert shift.until(lambda: shift.doing("assembly"))
    shift.world.set_arm(ARM_OVER_BRACKET_RAD)
    shift.until(lambda: False, 3.0)
    assert shift.worker.hand.position_m[0] > bench().bracket.position_m[0] + 0.2
    assert shift.placed() == {}
    shift.world.set_arm(bench().arm_park_rad)
    assert shift.until(lambda: len(shift.placed()) == 1, 6.0)


def test_hole_filled_meanwhile_sends_the_part_back_to_its_bin() -> None:
    shift = with_robot_part("o3", Pose((0.56, -0.38, 0.016)))
    shift.worker.show(Display(help_request="o3"))
    assert shift.until(lambda: shift.doing("assembly"))
    robots = next(part for part in shift.world.bodies if part.owner == "robot")
    shift.world.place(robots, Pose(hole("p6")))
    own = next(part for part in shift.world.bodies if part.name == "o3_person_0")
    home = (*bench().bins_m["o3"][:2], 0.016)
    assert not shift.until(lambda: shift.worker.done, 8.0)
    assert np.allclose(shift.world.part_pose(own).position_m, home, atol=0.01)
    assert shift.placed()["p6"] == "o3"


def touched(shift: Shift, prefix: str, other: str) -> bool:
    """Whether a body whose name begins so touches another one now."""
    model, data = shift.world.model, shift.world.data
    for first, second in model.geom_bodyid[data.contact.geom]:
        names = model.body(int(first)).name, model.body(int(second)).name
        if any(one.startswith(prefix) and two.startswith(other) for one, two in (names, names[::-1])):
            return True
    return False


def test_a_tool_stands_on_the_part_that_it_screws_and_leaves_it_seated() -> None:
    person = Person(screw=ScrewHabits(probability=1.0, tool=1.0, duration_s=(1.0, 1.0)))
    world = world_of(person, 1)
    shift = Shift("g0", 1, person, world)
    screws = 0
    for _ in range(3):
        assert shift.until(lambda: shift.doing("screw"))
        assert shift.until(lambda: touched(shift, "hand_tool", "o"), 1.0)
        assert shift.until(lambda: not shift.doing("screw"))
        screws += 1
    shift.until(lambda: False, 1.0)
    assert len(shift.placed()) >= screws


def test_the_hand_does_not_go_through_the_table() -> None:
    world = world_with_hand()
    hand = Hand(world.model, world.data)
    down_m = np.array([0.95, -0.35, -0.20])  # beside bins and bracket
    for _ in range(150):
        hand.command(down_m, 0.0, 0.02)
        world.step_period()
    lowest = min(
        world.data.geom_xpos[geom][2] - world.model.geom_rbound[geom]
        for geom in range(world.model.ngeom)
        if world.model.body(world.model.geom_bodyid[geom]).name.startswith("hand")
        and world.model.geom_conaffinity[geom] == CONAFFINITY
        and world.model.geom_group[geom] != FOREARM_GROUP
    )
    assert lowest > -0.03
    assert hand.position_m[2] > -0.01


def test_the_forearm_does_not_go_through_the_table() -> None:
    """A wrist that bends back presses it down; without a table it would go 7 cm lower."""
    world = world_of(Person(grip=Grip(tilt_rad=(0.0, 0.6))), 1)
    hand = Hand(world.model, world.data)
    for _ in range(150):
        hand.command(np.array([0.75, -0.55, 0.08]), 0.0, 0.02, tilt_rad=-0.6)
        world.step_period()
    model, data = world.model, world.data
    [sleeve] = (
        geom
        for geom in np.flatnonzero(model.geom_group == FOREARM_GROUP)
        if model.geom(geom).matid[0] == model.material("hand_sleeve").id
    )
    radius_m, half_m, _ = model.geom_size[sleeve]
    assert data.geom_xpos[sleeve][2] - abs(data.geom_xmat[sleeve][8]) * half_m - radius_m > -0.005


def test_ring_and_little_finger_lie_otherwise_from_grasp_to_grasp() -> None:
    person = Person(grip=Grip(curl_rad=(-0.6, 0.35)))
    shift = Shift("g0", 2, person, world_of(person, 2))
    joint = shift.world.model.joint("hand_curl").qposadr[0]
    bent: list[float] = []
    for _ in range(3):
        assert shift.until(lambda: shift.doing("assembly"))
        bent.append(float(shift.world.data.qpos[joint]))
        assert shift.until(lambda: not shift.doing("assembly"))
    assert all(-0.7 < value < 0.45 for value in bent)
    assert max(bent) - min(bent) > 0.05


def test_the_forearm_pushes_parts_that_stand_in_its_way() -> None:
    start = Pose((1.03, -0.30, product().parts["o2"].peg_length_m))
    world = world_with_hand([ScenePart("o2", start)])
    hand = Hand(world.model, world.data)
    [part] = world.bodies
    above, along = [(-0.5, 0.3)] * 100, [(y, 0.012) for y in np.linspace(-0.5, -0.1, 150)]
    for y, z in (*above, *along):
        hand.command(np.array([0.79, y, z]), 0.0, 0.02)
        world.step_period()
    moved_m = np.array(world.part_pose(part).position_m) - np.array(start.position_m)
    assert np.linalg.norm(moved_m) > 0.03
