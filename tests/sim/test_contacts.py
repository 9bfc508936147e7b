"""Hand and robot touch each other, and every contact is measured."""

from __future__ import annotations

import math
from collections.abc import Iterator
from itertools import chain

import numpy as np
import pytest

from bracket_ground.interfaces.bench import Bench
from bracket_ground.interfaces.command import JointTrajectory
from bracket_ground.interfaces.pose import Array, Pose
from bracket_ground.interfaces.product import Product
from bracket_sim.cell import SimCell
from bracket_sim.scene.clutter import standing
from bracket_sim.scene.person import BesideRobot, Person
from bracket_sim.scene.settings import SimSettings
from bracket_sim.truth.contacts import ContactMonitor
from bracket_sim.worker.worker import Worker
from tests.sim.rig import Rig, downwards

SWEEP_RAD = (0.75, 0.0, 0.0, 0.0, 0.0, 0.0)  # of the base: the tool goes from the tray to the bracket
RUDE = Person(robot=BesideRobot(waits=0.0, chases=0.0))


@pytest.fixture
def cell(product: Product, bench: Bench) -> Iterator[SimCell]:
    """No frames, and a person who waits for nothing."""
    slow = bench.overhead.model_copy(update={"rate_hz": 0.01})
    blind = bench.model_copy(update={"overhead": slow})
    opened = SimCell(product, blind, SimSettings(person=RUDE), "virtual", "contacts", 1, "g0")
    yield opened
    opened.close()


def sweep(cell: SimCell, by_rad: tuple[float, ...], duration_s: float) -> None:
    """Turn the arm smoothly; it goes on while time passes."""
    start = np.array(cell.arm.state().positions_rad)
    times: Array = np.linspace(0.0, duration_s, round(duration_s / 0.008) + 1)
    share = times / times[-1]
    share = 10 * share**3 - 15 * share**4 + 6 * share**5
    cell.arm.follow(JointTrajectory(times, start + np.outer(share, by_rad)))


def wait(cell: SimCell, until_s: float) -> None:
    """Let time pass; the arm hears that somebody is there."""
    clock = cell.devices.clock
    while clock.now_s() < until_s:
        cell.arm.pace(1.0)
        clock.sleep_until(clock.now_s() + 0.04)


def contacts(cell: SimCell) -> ContactMonitor:
    assert cell.contacts is not None
    return cell.contacts


def test_a_hand_in_the_way_of_the_moving_arm_is_a_contact(cell: SimCell) -> None:
    assert cell.worker is not None
    sweep(cell, SWEEP_RAD, 1.6)
    wait(cell, 0.4)
    cell.worker.intrude("freeze", speed_m_s=1.6)
    wait(cell, 6.0)
    [first, *_] = contacts(cell).all()
    assert first.robot in {"gripper", "tool", "finger_left", "finger_right", "arm wrist_3_link", "arm wrist_2_link"}
    assert first.speed_m_s > 0.25
    assert first.force_n > 20.0
    report = cell.report()
    assert report["contacts"] == len(contacts(cell).all())
    assert report["contact_speed_m_s"] == pytest.approx(
        max(contact.speed_m_s for contact in contacts(cell).all()), abs=1e-3
    )
    told = [event.fields for event in cell.truth()]
    acts = [fields["act"] for fields in told if "act" in fields]
    assert acts[acts.index("intrude") :][:3] == ["intrude", "freeze", "back"]
    assert any(fields.get("edge") == "start" and "point_m" in fields for fields in told)


@pytest.mark.parametrize("begins_s", [0.1, 0.5, 0.9])
def test_a_hand_that_chases_the_arm_catches_it(product: Product, bench: Bench, begins_s: float) -> None:
    blind = bench.model_copy(update={"overhead": bench.overhead.model_copy(update={"rate_hz": 0.01})})
    chaser = Person(robot=BesideRobot(waits=0.0, chases=1.0))
    opened = SimCell(product, blind, SimSettings(person=chaser), "virtual", f"chase{begins_s}", 1, "g0")
    assert opened.worker is not None
    sweep(opened, SWEEP_RAD, 1.6)
    wait(opened, begins_s)
    opened.worker.intrude("withdraw", speed_m_s=1.6)
    wait(opened, 3.0)
    assert contacts(opened).all()
    opened.close()


def test_a_hand_that_leans_on_the_standing_arm_pushes_as_hard_as_a_person_does(cell: SimCell) -> None:
    assert cell.worker is not None
    sweep(cell, SWEEP_RAD, 1.6)
    wait(cell, 3.0)
    cell.worker.intrude("freeze", speed_m_s=0.3)
    wait(cell, 7.0)
    [leaning] = contacts(cell).all()
    assert leaning.speed_m_s == 0.0
    assert leaning.end_s - leaning.start_s > 0.5
    assert 100.0 < leaning.force_n < 200.0


def test_a_part_in_the_gripper_counts_as_the_robot(product: Product, bench: Bench) -> None:
    slow = bench.overhead.model_copy(update={"rate_hz": 0.01})
    blind = bench.model_copy(update={"overhead": slow})
    scene = [standing(product, bench.tray, "o3", bench.tray.centre_m[:2], 0.0)]
    opened = SimCell(product, blind, SimSettings(person=RUDE), "virtual", "held", 1, "g0", clutter=scene)
    rig = Rig(opened, "held")
    try:
        assert opened.worker is not None
        rig.activate()
        sweep(opened, SWEEP_RAD, 1.6)
        rig.wait(2.0)
        part = next(body for body in opened.world.bodies if body.owner == "robot")
        tool = opened.world.tool_pose()
        x, y, z = tool.position_m
        hold_m = opened.world.product.parts["o3"].size_m[2] * 0.7
        yaw_rad = math.atan2(tool.rotation[1, 0], tool.rotation[0, 0]) + math.pi / 2
        opened.world.place(part, Pose.from_yaw((x, y, z - hold_m), yaw_rad))
        rig.request(rGTO=1, rPR=0)
        for _ in range(40):  # until the fingers hold it
            opened.world.place(part, Pose.from_yaw((x, y, z - hold_m), yaw_rad))
            rig.wait(0.02)
        rig.wait(0.3)
        assert opened.world.part_pose(part).position_m[2] > z - hold_m - 0.02
        for sequel in ("pull", "pull"):
            opened.worker.intrude(sequel, speed_m_s=0.6)
            rig.wait(4.0)
        assert part.name in {contact.robot for contact in contacts(opened).all()}
    finally:
        rig.close()


@pytest.mark.parametrize("chases", [0.0, 1.0])
def test_a_hand_at_a_part_goes_over_the_parts_on_its_way_to_the_arm(
    product: Product, bench: Bench, chases: float
) -> None:
    slow = bench.overhead.model_copy(update={"rate_hz": 0.01})
    blind = bench.model_copy(update={"overhead": slow})
    rude = Person(robot=BesideRobot(waits=0.0, chases=chases))
    opened = SimCell(product, blind, SimSettings(person=rude), "virtual", "over", 1, "g0")
    rig = Rig(opened, "over")
    try:
        stands = fill_bracket(opened)
        rig.move(downwards(0.60, -0.10, 0.20, 0.0), 1.5)
        assert opened.worker is not None
        touch(opened.worker, next(reversed(stands.values())))
        rig.wait(1.6)
        opened.worker.intrude("freeze", speed_m_s=1.2)
        rig.wait(1.6)
        assert contacts(opened).all()  # it got there
        for part in opened.world.bodies:
            if part.name in stands:
                moved_m = math.dist(opened.world.part_pose(part).position_m, stands[part.name].position_m)
                assert moved_m < 0.003, part.name
    finally:
        rig.close()


def fill_bracket(cell: SimCell) -> dict[str, Pose]:
    """A part of the person's in every hole; poses by body."""
    world, stands = cell.world, {}
    spare = [part for part in world.bodies if part.owner == "person"]
    bracket = world.bench.bracket.pose
    for part, (x, y) in zip(spare, world.product.bracket.holes_m.values(), strict=True):
        stands[part.name] = bracket @ Pose.from_yaw((x, y, 0.0), math.pi / 2)
        world.place(part, stands[part.name])
    return stands


def touch(worker: Worker, part: Pose) -> None:
    """Begin to bring the fingertips to the head of a part, from above."""
    work = worker._work
    x, y, z = part.position_m
    over_m, at_m = np.array([x, y, z + 0.15]), np.array([x, y, z + 0.05])
    worker._intruding = chain(work.reach(over_m, 0.0, 0.025), work.reach(at_m))
