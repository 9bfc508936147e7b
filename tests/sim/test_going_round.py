"""People go round an arm that stands in their way, and press no harder on it than who is surprised."""

from __future__ import annotations

from collections.abc import Iterator
from types import SimpleNamespace
from typing import cast

import numpy as np
import pytest

from bracket_ground.interfaces.bench import Bench
from bracket_ground.interfaces.command import JointTrajectory
from bracket_ground.interfaces.pose import Array
from bracket_ground.interfaces.product import Product
from bracket_sim.cell import SimCell
from bracket_sim.scene.hand import Hand
from bracket_sim.scene.person import BesideRobot, Person, ScrewHabits
from bracket_sim.scene.settings import SimSettings
from bracket_sim.worker.going_round import WAITS_S, YIELDS_N, GoingRound
from bracket_sim.worker.handing import Giver

BESIDE = Person(robot=BesideRobot(waits=0.0), screw=ScrewHabits(probability=0.0, unscrewed_limit=9))
HELD_OUT_M = (0.93, 0.20, 0.20)
CLAMPED_N = 140.0  # ISO/TS 15066, hand and fingers, quasi-static


@pytest.fixture
def cell(product: Product, bench: Bench) -> Iterator[SimCell]:
    """Whoever works here does not wait for the arm, which is held out between hand and bracket."""
    blind = bench.model_copy(update={"overhead": bench.overhead.model_copy(update={"rate_hz": 0.01})})
    opened = SimCell(product, blind, SimSettings(person=BESIDE), "virtual", "round", 3, "g0", rendered=False)
    there = Giver(opened.world, (), lambda _: False, np.random.default_rng(0))._solve(np.array(HELD_OUT_M), 0.0)
    go(opened, there)
    yield opened
    opened.close()


def go(cell: SimCell, joints_rad: Array, duration_s: float = 2.0) -> None:
    start, times = np.array(cell.arm.state().positions_rad), np.linspace(0.0, duration_s, 251)
    share = (times / duration_s) ** 3 * (10 - 15 * times / duration_s + 6 * (times / duration_s) ** 2)
    cell.arm.follow(JointTrajectory(times, start + np.outer(share, joints_rad - start)))
    assert cell.worker is not None
    cell.worker.away = True
    wait(cell, duration_s + 0.5)
    cell.worker.away = False


def wait(cell: SimCell, for_s: float) -> None:
    clock = cell.devices.clock
    end_s = clock.now_s() + for_s
    while clock.now_s() < end_s:
        cell.arm.pace(1.0)
        clock.sleep_until(clock.now_s() + 0.04)


def test_the_bracket_is_filled_beside_an_arm_that_stands_there_and_nothing_hits_it(cell: SimCell) -> None:
    wait(cell, WAITS_S)
    assert cell.contacts is not None
    assert cell.worker is not None
    assert not cell.contacts.all(), "who has no way round waits, longer than an arm offers or asks for a part"
    wait(cell, 100.0)
    placed = sum(event.kind == "assembly" and event.edge == "end" for event in cell.worker.events)
    assert placed >= 3
    touches = cell.contacts.all()
    assert touches, "one of the holes is behind the arm"
    assert max(contact.force_n for contact in touches) < CLAMPED_N


def test_a_hand_that_came_off_the_arm_is_not_thrown_at_it_again(cell: SimCell) -> None:
    """A touch that flickers, commanded far ahead in between, hits harder each time."""
    hand = SimpleNamespace(touches_robot=False, position_m=np.zeros(3), stiffness_n_m=8000.0)
    assert cell.worker is not None
    going = GoingRound(cast(Hand, hand), cell.worker._sight, 0.0, minds=False)
    wanted_m, ahead_m = np.array([-0.06, 0.0, 0.0]), list[float]()
    for period in range(100):
        hand.touches_robot = 10 <= period < 50 and period % 2 == 0
        going.update(wanted_m, 0.0, 0.008, meant=False, room=True, waits=False)
        ahead_m.append(float(np.linalg.norm(going.goes_to(wanted_m, gently=True))))
    assert ahead_m[0] == ahead_m[99] == 0.06
    assert max(ahead_m[10:80]) * hand.stiffness_n_m <= YIELDS_N + 1e-6


@pytest.mark.parametrize(("robot", "touches"), [("finger_left", True), ("tool", False)])
def test_a_part_in_the_fingers_of_the_robot_is_the_robot_for_a_hand_at_it(
    cell: SimCell, monkeypatch: pytest.MonkeyPatch, robot: str, touches: bool
) -> None:
    """Pressed as if it were free, it was shoved out of the grip."""
    model, part = cell.world.model, cell.world.bodies[0].name
    hand, held, finger = (int(model.body(name).geomadr[0]) for name in ("hand", part, robot))
    contact = SimpleNamespace(geom=np.array([[hand, held], [held, finger]]))
    assert cell.worker is not None
    monkeypatch.setattr(cell.worker.hand, "_data", SimpleNamespace(ncon=2, contact=contact))
    assert cell.worker.hand.touches_robot is touches
