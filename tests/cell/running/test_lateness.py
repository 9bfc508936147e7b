"""How late ticks begin is counted in bounded memory, with its cause; a slow machine is told of once."""

from __future__ import annotations

import sys

import pytest

from bracket_cell.running.observers import Announcer
from bracket_cell.watching.lateness import BIN_S, Lateness, Quantiles
from bracket_cell.watching.observer import Level, SentCommand, TickRecord
from bracket_ground.interfaces.command import Command
from bracket_ground.interfaces.faults import Action, SafetyDecision
from bracket_ground.interfaces.observation import Observation
from tests.cell.running.test_finished import ARM, GRIPPER

PERIOD_S = 0.04


def late(late_s: float, wall_s: float = 0.001, observers_s: float = 0.001) -> TickRecord:
    seen = Observation(1, 1.0, ARM, GRIPPER, late_s=late_s)
    return TickRecord(seen, "RUNNING", (), (), Command(), SentCommand(), wall_s, False, observers_s=observers_s)


def test_quantiles_are_right_to_a_bin_and_need_no_more_memory_for_more_values() -> None:
    quantiles = Quantiles()
    before = sys.getsizeof(quantiles._counts)
    for number in range(100_000):
        quantiles.add(number % 1000 * 1e-5)
    assert quantiles.quantile(0.5) == pytest.approx(0.005, abs=BIN_S)
    assert quantiles.quantile(0.99) == pytest.approx(0.0099, abs=BIN_S)
    assert quantiles.quantile(1.0) == quantiles.largest == pytest.approx(0.00999)
    assert sys.getsizeof(quantiles._counts) == before
    quantiles.add(7.0)
    assert quantiles.quantile(1.0) == 7.0


@pytest.mark.parametrize(
    ("before", "delays", "cause"),
    [
        (late(0.0, wall_s=0.09), {"machine": 0.001, "world": 0.002}, "nodes"),
        (late(0.0, observers_s=0.09), {"machine": 0.001, "world": 0.002}, "observers"),
        (late(0.0), {"machine": 0.045, "world": 0.002}, "machine"),
        (late(0.0), {"machine": 0.001, "world": 0.046}, "world"),
        (late(0.0), {"machine": 0.001, "world": 0.002}, "devices"),
    ],
)
def test_the_longest_delay_is_the_cause(before: TickRecord, delays: dict[str, float], cause: str) -> None:
    lateness = Lateness(PERIOD_S, lambda: delays)
    lateness.tick(before)
    lateness.tick(late(0.05))
    assert lateness.report()["late_causes"] == {cause: 1}
    assert lateness.report()["late_max_s"] == 0.05


def test_a_world_that_falls_behind_is_told_of_once() -> None:
    told: list[tuple[float, Level, str]] = []
    lost = [0.0]
    lateness = Lateness(PERIOD_S, dict, lambda: lost[0], lambda *words: told.append(words))
    for lost_s in (0.0, 0.4, 0.6, 5.0, 50.0):
        lost[0] = lost_s
        lateness.tick(late(0.0))
    assert len(told) == 1
    assert "too slow" in told[0][2]


def test_a_late_tick_is_told_once_and_other_troubles_every_time() -> None:
    announcer = Announcer()
    slow = SafetyDecision(Action.SLOW, 0.25, (("tick_late", "a tick came 0.09 s late"),))
    hold = SafetyDecision(Action.HOLD, 0.0, (("hand_too_near", "the hand is too near"),))
    judgements = (slow, SafetyDecision(), slow, SafetyDecision(), hold, SafetyDecision(), hold)
    told = [announcer.news(judgement, 10.0 * number) for number, judgement in enumerate(judgements)]
    assert [words and words[1].split(":")[0] for words in told] == [
        "slow",
        None,
        None,
        None,
        "hold",
        "all clear",
        "hold",
    ]


def test_a_hand_that_comes_again_at_once_is_told_once() -> None:
    announcer, hold = Announcer(), SafetyDecision(Action.HOLD, 0.0, (("hand_too_near", "the hand is too near"),))
    told = [announcer.news(hold if number % 10 < 6 else SafetyDecision(), 0.1 * number) for number in range(60)]
    told += [announcer.news(SafetyDecision(), 6.0 + 0.1 * number) for number in range(30)]
    assert [words[1].split(":")[0] for words in told if words] == ["hold", "all clear"]


def test_a_hold_that_clears_while_a_hand_has_just_gone_is_never_told_without_a_reason() -> None:
    announcer = Announcer()
    lost = ("camera_lost", "camera wrist: nothing comes")
    both = SafetyDecision(Action.HOLD, 0.0, (lost, ("hand_too_near", "the hand is too near")))
    judgements = [both, SafetyDecision(Action.HOLD, 0.0, (lost,)), *(SafetyDecision() for _ in range(30))]
    told = [announcer.news(judgement, 0.1 * number) for number, judgement in enumerate(judgements)]
    assert [words[1].split(":")[0] for words in told if words] == ["hold", "all clear"]
