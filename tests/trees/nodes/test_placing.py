"""A part that does not go into its hole: a few tries, then somebody is asked."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import pytest

from cell.interfaces.command import Command
from cell.interfaces.observation import Observation
from cell.interfaces.planning import AssemblyState
from cell.interfaces.skill import Progress, SkillStatus
from tests import ROOT
from tests.trees.nodes.rig import SURE, services
from trees.engine.status import Status
from trees.nodes.placing import PlacedInVain, PlacePart
from trees.nodes.services import Services
from trees.testing import TreeBench, alone


class Lowering:
    """A skill that ends as it is told."""

    def __init__(self, end: SkillStatus) -> None:
        self._end = end

    def poll(self, observation: Observation, command: Command) -> Progress:  # noqa: ARG002
        return Progress(self._end, "lowering o1: the arm did not arrive in time")

    def halt(self, command: Command) -> None:
        """Nothing to stop."""


def place(to: Services, took_s: float) -> None:
    node: Any = alone(PlacePart("place"), to, part="o1", position="p2")
    node.initialise()
    to.now.observation = replace(to.now.observation, time_s=to.now.observation.time_s + took_s)
    node.update()


def in_vain(to: Services, position: str = "p2") -> bool:
    node: Any = alone(PlacedInVain("vain"), to, part="o1", position=position)
    return bool(node.update() is Status.SUCCESS)


def test_a_part_that_meets_something_in_its_hole_three_times_is_placed_in_vain(monkeypatch: pytest.MonkeyPatch) -> None:
    end = [SkillStatus.FAILURE]
    monkeypatch.setattr("skills.pick_and_place.Place", lambda *_: Lowering(end[0]))
    to = services()
    answers = []
    for took_s in (2.5, 2.5, 0.0, 2.5):  # where there is no way at the moment, nothing was tried
        place(to, took_s)
        answers.append(in_vain(to))
    assert answers == [False, False, False, True]
    assert list(to.memory.reasons)[-1] == "the gate valve (o1) does not go into p2"
    assert not in_vain(to)  # asked once, it is tried again
    for one in (SkillStatus.FAILURE, SkillStatus.FAILURE, SkillStatus.SUCCESS, SkillStatus.FAILURE):
        end[0] = one
        place(to, 2.5)
    assert not in_vain(to)
    assert not in_vain(to, "p3")


def test_ahead_of_the_person_a_robot_asks_instead_of_pressing_on_a_full_hole_for_ever() -> None:
    """A hole that is filled and read as empty: one run lowered the same part onto another 39 times."""
    answers = {"GripperIsEmpty": "F", "PlacePart": "F", "PlacedInVain": "FFS", "AskForHelp": "R"}
    given = {"state": AssemblyState({}), "plan": SURE, "part": "o1", "position": "p2"}
    made = TreeBench(ROOT / "trees" / "ahead.xml", answers, provided=given, main="HelpAhead")
    for _ in range(60):
        made.tick(0.1)
    assert (made.started("PlacePart"), made.started("AskForHelp")) == (3, 1)
