"""A world on the wall's time: absolute deadlines, never hurried, and stamps that are the wall's."""

from __future__ import annotations

import pytest

from bracket_ground.interfaces.clock import ManualClock
from bracket_sim.devices.pacing import CATCH_UP_S, Pacer

PERIOD_S = 0.008


class Wall:
    """The machine's clock, moved by hand."""

    def __init__(self) -> None:
        self.time_s = 100.0

    def __call__(self) -> float:
        return self.time_s


@pytest.fixture
def wall() -> Wall:
    return Wall()


def stepped(wall: Wall, world: ManualClock, pacer: Pacer, until_s: float) -> int:
    """Steps at their deadlines until the wall's time; how many."""
    count = 0
    while wall.time_s < until_s:
        wall.time_s += max(pacer.due_in_s(), 1e-6)
        before_s = world.now_s()
        pacer.step()
        count += world.now_s() > before_s
    return count


def test_a_world_that_keeps_pace_shows_the_walls_time(wall: Wall) -> None:
    world = ManualClock()
    pacer = Pacer(world, PERIOD_S, wall.time_s, wall)
    assert stepped(wall, world, pacer, 101.0) == pytest.approx(125, abs=1)
    assert world.now_s() == pytest.approx(1.0, abs=PERIOD_S)
    assert pacer.wall_s(world.now_s()) == pytest.approx(world.now_s())
    assert pacer.lost_s == 0


def test_a_short_delay_is_made_up_for_and_a_long_one_is_lost(wall: Wall) -> None:
    world = ManualClock()
    pacer = Pacer(world, PERIOD_S, wall.time_s, wall)
    stepped(wall, world, pacer, 100.5)
    wall.time_s += 0.8 * CATCH_UP_S
    stepped(wall, world, pacer, 101.0)
    assert pacer.lost_s == 0
    assert world.now_s() == pytest.approx(1.0, abs=PERIOD_S)
    wall.time_s += 2.0
    assert stepped(wall, world, pacer, wall.time_s + 1e-9) == 1, "one step, no burst"
    assert pacer.lost_s == pytest.approx(2.0, abs=2 * PERIOD_S)
    before_s = wall.time_s
    assert stepped(wall, world, pacer, before_s + 0.4) == pytest.approx(50, abs=1)


def test_stamps_from_before_a_delay_stay_where_they_were(wall: Wall) -> None:
    world = ManualClock()
    pacer = Pacer(world, PERIOD_S, wall.time_s, wall)
    stepped(wall, world, pacer, 100.4)
    early_s = world.now_s()
    wall.time_s += 3.0
    pacer.step()
    assert pacer.wall_s(early_s - PERIOD_S) == pytest.approx(early_s - PERIOD_S)
    assert pacer.wall_s(world.now_s()) == pytest.approx(wall.time_s - 100.0, abs=PERIOD_S)
    assert pacer.wall_s(world.now_s()) > pacer.wall_s(early_s)
