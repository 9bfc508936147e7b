"""Who acts and who waits, added up over a run."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from bracket_cell.watching.observer import SentCommand, TickRecord
from bracket_cell.watching.statistics import Fluency
from bracket_ground.interfaces.command import Command, JointTrajectory
from bracket_ground.interfaces.faults import Action as Judged
from bracket_ground.interfaces.faults import SafetyDecision
from bracket_ground.interfaces.perception import Action, HandSample
from tests.cell.fakes import frame, idle_view
from tests.cell.recording.test_recorder import record


def tick(number: int, human: bool, robot: bool, held: bool = False) -> TickRecord:
    """A tick in which person and robot act or rest."""
    one = record(number)
    hand = HandSample(one.observation.time_s, (0, 0, 9, 9), (0.5, 0.0), (0.6, 0.0))
    view = replace(idle_view(frame(number)), action=Action("transit" if human else "idle", 1.0), hand=hand)
    arm = replace(one.observation.arm, moving=robot, velocities_rad_s=(0.1 * robot,) * 6)
    judgement = SafetyDecision(Judged.HOLD if held else Judged.RUN)
    return replace(one, observation=replace(one.observation, bench=view, arm=arm), judgement=judgement)


def report(*acts: tuple[bool, bool]) -> dict[str, object]:
    fluency = Fluency(lambda _: (0.2, 0.4))
    for number, (human, robot) in enumerate(acts):
        fluency.tick(tick(number, human, robot))
    return fluency.report()


def test_shares_begin_with_the_first_action_and_add_up() -> None:
    found = report(*[(False, False)] * 5, *[(True, False)] * 4, *[(True, True)] * 2, *[(False, True)] * 4)
    assert found["human_idle"] == found["robot_idle"] == pytest.approx(0.4)
    assert found["concurrent"] == pytest.approx(0.2)
    assert found["functional_delay"] == 0
    assert found["least_distance_m"] == pytest.approx(0.5)


def test_a_pause_is_a_delay_only_where_the_other_goes_on() -> None:
    pause = [(False, False)] * 5
    assert report((True, False), *pause, (True, False))["functional_delay"] == 0
    assert report((True, False), *pause, (False, True))["functional_delay"] == pytest.approx(5 / 6, abs=1e-3)


def test_interventions_and_motions_are_counted() -> None:
    fluency = Fluency(lambda _: (0.0, 0.0))
    sent = SentCommand(JointTrajectory(np.zeros(1), np.zeros((1, 6))))
    for number, held in enumerate((False, True, True, False, True)):
        fluency.tick(replace(tick(number, False, True, held), sent=sent))
    found = fluency.report()
    assert (found["interventions"], found["moves"], found["held_s"]) == (2, 5, pytest.approx(0.12))


def test_what_the_arm_lost_is_split_by_whether_the_person_acts() -> None:
    """Held time is lost whole, slowed time by the share that lacks; a slow arm that stands loses nothing."""
    fluency, slow = Fluency(lambda _: (0.0, 0.0)), SafetyDecision(Judged.SLOW, 0.25)
    for number, (human, robot, judged) in enumerate(
        [(True, True, SafetyDecision()), (True, True, slow), (False, True, slow), (False, False, slow)]
    ):
        fluency.tick(replace(tick(number, human, robot), judgement=judged))
    for number in (4, 5):
        fluency.tick(tick(number, human=number == 4, robot=True, held=True))
    found = fluency.report()
    assert (found["slowed_s"], found["held_s"]) == (pytest.approx(0.06), pytest.approx(0.08))
    assert found["lost_alone_s"] == pytest.approx(0.03 + 0.04)


def test_an_arm_that_stands_and_wants_nothing_is_not_held() -> None:
    fluency = Fluency(lambda _: (0.0, 0.0))
    wants = Command(follow=JointTrajectory(np.zeros(1), np.zeros((1, 6))))
    for number, command in enumerate((Command(), Command(), wants, Command())):
        fluency.tick(replace(tick(number, False, False, held=True), command=command))
    found = fluency.report()
    assert (found["interventions"], found["held_s"]) == (1, pytest.approx(0.08))


def test_an_arm_that_is_held_waits_and_comes_nearer_to_nobody() -> None:
    fluency = Fluency(lambda _: (0.5, 0.0))
    for number in range(4):
        one = tick(number, human=True, robot=False, held=True)
        arm = replace(one.observation.arm, moving=True)  # it follows a path, and stands on it
        fluency.tick(replace(one, observation=replace(one.observation, arm=arm)))
    found = fluency.report()
    assert (found["robot_idle"], found["concurrent"], found["least_distance_m"]) == (1, 0, None)


def test_where_nobody_acts_there_are_no_shares() -> None:
    found = report((False, False), (False, False))
    assert (found["human_idle"], found["least_distance_m"]) == (None, None)
