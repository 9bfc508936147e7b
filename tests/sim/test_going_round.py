"""People go round an arm that stands in their way, and press no harder on it than who is surprised."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import pytest

from bracket_ground.interfaces.bench import Bench
from bracket_ground.interfaces.command import JointTrajectory
from bracket_ground.interfaces.pose import Array
from bracket_ground.interfaces.product import Product
from bracket_sim.cell import SimCell
from bracket_sim.scene.person import BesideRobot, Person, ScrewHabits
from bracket_sim.scene.settings import SimSettings
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
    wait(cell, 50.0)
    assert cell.contacts is not None
    assert cell.worker is not None
    placed = sum(event.kind == "assembly" and event.edge == "end" for event in cell.worker.events)
    assert placed >= 3
    touches = cell.contacts.all()
    assert touches, "one of the holes is behind the arm"
    assert max(contact.force_n for contact in touches) < CLAMPED_N
