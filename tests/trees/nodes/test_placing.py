"""A part that does not go into its hole: a few tries, then somebody is asked."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import pytest

from bracket_cell.trees.bench import TreeBench
from bracket_cell.trees.nodes.arm import FeelFingers
from bracket_cell.trees.nodes.moving import ReturnToTray
from bracket_cell.trees.nodes.placing import AwaitLetGo, PlacedInVain, PlacePart, RecordPlacement, VerifyPlacement
from bracket_cell.trees.nodes.services import Services
from bracket_ground.interfaces.command import Command
from bracket_ground.interfaces.observation import GripperState, ObjectStatus, Observation
from bracket_ground.interfaces.perception import HoleView, PartDetection
from bracket_ground.interfaces.planning import AssemblyState
from bracket_ground.interfaces.pose import Pose
from bracket_ground.interfaces.skill import Progress, SkillStatus
from btxml.engine.status import Status
from btxml.testing import alone
from tests import ROOT
from tests.trees.nodes.rig import EMPTY_HOLES, SURE, see, services


class Lowering:
    """A skill that ends as it is told."""

    def __init__(self, end: SkillStatus) -> None:
        self._end = end

    def poll(self, observation: Observation, command: Command) -> Progress:  # noqa: ARG002
        return Progress(self._end, "lowering o1: the arm did not arrive in time")

    def halt(self, command: Command) -> None:
        """Nothing to stop."""


HOLDS = GripperState(0.0, True, ObjectStatus.CONTACT_CLOSING, 0.026, 0.1, 0)


def place(to: Services, took_s: float, *, holds: bool = True) -> None:
    node: Any = alone(PlacePart("place"), to, part="o1", position="p2")
    node.initialise()
    seen = to.now.observation
    to.now.observation = replace(seen, time_s=seen.time_s + took_s, gripper=HOLDS if holds else seen.gripper)
    node.update()


def in_vain(to: Services, position: str = "p2") -> bool:
    node: Any = alone(PlacedInVain("vain"), to, part="o1", position=position)
    return bool(node.update() is Status.SUCCESS)


def test_a_part_that_meets_something_in_its_hole_three_times_is_placed_in_vain(monkeypatch: pytest.MonkeyPatch) -> None:
    end = [SkillStatus.FAILURE]
    monkeypatch.setattr("bracket_cell.skills.pick_and_place.Place", lambda *_: Lowering(end[0]))
    to = services()
    answers = []
    place(to, 2.5, holds=False)  # what fell did not meet its hole
    for took_s in (2.5, 2.5, 0.0, 2.5):  # where there is no way at the moment, nothing was tried
        place(to, took_s)
        answers.append(in_vain(to))
    assert answers == [False, False, False, True]
    assert list(to.memory.reasons)[-1] == "the gate valve (o1) does not go into p2"
    assert not in_vain(to)  # asked once, it is tried again
    for status in (SkillStatus.FAILURE, SkillStatus.FAILURE, SkillStatus.SUCCESS, SkillStatus.FAILURE):
        end[0] = status
        place(to, 2.5)
    assert not in_vain(to)
    assert not in_vain(to, "p3")


def test_ahead_of_the_person_a_robot_asks_instead_of_pressing_on_a_full_hole_for_ever() -> None:
    """A hole that is filled and read as empty: one run lowered the same part onto another 39 times."""
    answers = {"GripperIsEmpty": "F", "PlacePart": "F", "several did not go in": "FFS", "AskForHelp": "R"}
    answers["it did not go in twice"] = "F"
    given = {"state": AssemblyState({}), "plan": SURE, "part": "o1", "position": "p2"}
    made = TreeBench(ROOT / "trees" / "ahead.xml", answers, provided=given, main="HelpAhead")
    for _ in range(60):
        made.tick(0.1)
    assert (made.started("PlacePart"), made.started("AskForHelp")) == (3, 1)


def verified(to: Services, looks: list[tuple[float, HoleView]]) -> list[Status]:
    """What VerifyPlacement answers as time goes on, from 1 s on."""
    see(to, 1.0)
    node: Any = alone(VerifyPlacement("verify"), to, part="o1", position="p2")
    node.initialise()
    answers = []
    for time_s, hole in looks:
        see(to, time_s, holes={**EMPTY_HOLES, "p2": hole})
        answers.append(node.update())
    return answers


def test_a_placement_is_looked_at_once_the_view_is_free() -> None:
    hidden, there = HoleView(None, 1.0, 0.9), HoleView("o1", 1.0, 6.0)
    assert verified(services(), [(3.0, hidden), (6.0, hidden), (6.1, there)])[-1] is Status.SUCCESS


def test_a_hole_that_looks_otherwise_for_long_or_stays_hidden_shows_no_placement() -> None:
    to = services(let_go={"p2": "o1", "p1": "o1"})
    empty = [(time_s, HoleView(None, 1.0, time_s)) for time_s in (4.0, 5.9, 6.1)]
    assert verified(to, empty) == [Status.RUNNING, Status.RUNNING, Status.FAILURE]
    assert to.memory.let_go == {"p1": "o1"}
    assert (
        verified(services(), [(10.9, HoleView(None, 1.0, 0.9)), (11.1, HoleView(None, 1.0, 0.9))])[1] is Status.FAILURE
    )


def test_what_was_let_go_counts_as_placed_once_it_is_noted(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("bracket_cell.skills.pick_and_place.Place", lambda *_: Lowering(SkillStatus.SUCCESS))
    to = services()
    awaits: Any = alone(AwaitLetGo("await"), to)
    assert awaits.update() is Status.RUNNING
    place(to, 2.5)
    assert awaits.update() is Status.SUCCESS
    assert (awaits.part.entry.value, awaits.position.entry.value) == ("o1", "p2")
    record: Any = alone(RecordPlacement("record"), to, part="o1", position="p2", state=AssemblyState({}))
    assert record.update() is Status.SUCCESS
    assert record.state.entry.value.by_robot == {"p2": "o1"}
    assert to.memory.let_go == {}


def test_what_does_not_go_in_is_exchanged_for_another_one_before_somebody_is_asked() -> None:
    answers = {"GripperIsEmpty": "F", "PlacePart": "F", "several did not go in": "F"}
    answers["it did not go in twice"] = "FS"
    given = {"state": AssemblyState({}), "plan": SURE, "part": "o1", "position": "p2"}
    made = TreeBench(ROOT / "trees" / "ahead.xml", answers, provided=given, main="HelpAhead")
    for _ in range(60):
        made.tick(0.1)
        if made.started("ReturnToTray"):
            break
    assert (made.started("PlacePart"), made.started("AskForHelp")) == (2, 0)


def test_one_that_did_not_go_in_is_taken_after_the_others_once_it_is_back(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("bracket_cell.skills.put_down.PutBack", lambda *_: Lowering(SkillStatus.SUCCESS))
    for unplaced, vain in (({}, 0), ({"o1 at p2": 2}, 1)):
        to = services(held_part="o1", unplaced=unplaced)
        node: Any = alone(ReturnToTray("back"), to)
        node.initialise()
        assert node.update() is Status.SUCCESS
        x, y = to.tool_on_bench_m()
        there = PartDetection("o1", 1.0, Pose((x, y, 0.016)), (0.045, 0.028, 0.02), (0, 0, 0, 0))
        assert to.memory.tried_in_vain(there) == vain


@pytest.mark.parametrize(("doubted", "held", "felt"), [(False, True, "S"), (True, True, "F"), (True, False, "S")])
def test_fingers_feel_for_a_part_that_sticks_where_one_was_not_seen_in_its_hole(
    monkeypatch: pytest.MonkeyPatch, doubted: bool, held: bool, felt: str
) -> None:
    end = SkillStatus.FAILURE if held else SkillStatus.SUCCESS
    monkeypatch.setattr(FeelFingers, "make_skill", lambda _: Lowering(end))
    to = services()
    if doubted:
        verified(to, [(time_s, HoleView(None, 1.0, time_s)) for time_s in (4.0, 6.1)])
    node: Any = alone(FeelFingers("feel"), to)
    node.initialise()
    assert node.update() is {"S": Status.SUCCESS, "F": Status.FAILURE}[felt]
    assert to.memory.fingers_doubted is (felt == "F")
    assert list(to.memory.reasons) == (["a part sticks to a finger"] if felt == "F" else [])
