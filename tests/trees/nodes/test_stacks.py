"""Parts on which others lie: refused, and what is on top is moved first, taken as it lies."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import pytest

from bracket_cell.trees.nodes.clutter import CheckGraspability, DecodeSolution, FindPart
from bracket_cell.trees.nodes.lying import FindLying
from bracket_cell.trees.nodes.moving import MoveAside
from bracket_ground.interfaces.command import Command
from bracket_ground.interfaces.observation import Observation
from bracket_ground.interfaces.perception import PartDetection, PartsView
from bracket_ground.interfaces.planning import GraspPlan
from bracket_ground.interfaces.pose import Pose
from bracket_ground.interfaces.skill import Progress, SkillStatus
from btxml.engine.errors import NodeError
from btxml.engine.status import Status
from btxml.testing import alone
from tests.trees.nodes.rig import ScriptedGrasps, seen_parts, services

FREE = GraspPlan(0.9, (), False, "grasp")
BOXES = [(10 * number, 0, 10 * number + 9, 9) for number in range(4)]


def lying(part: str, number: int, *on: int, told: bool = True) -> PartDetection:
    """A part that lies on those whose boxes have these numbers."""
    lies = Pose((0.5, -0.4, 0.05), (0.5**0.5, 0.5**0.5, 0.0, 0.0)) if told else None
    below = tuple(BOXES[one] for one in on)
    place = Pose((0.5, -0.4, 0.004))
    return PartDetection(part, 0.9, place, (0.09, 0.05, 0.08), BOXES[number], upright=False, lies=lies, lies_on=below)


def stack(*others: PartDetection) -> PartsView:
    """An o1 that stands in box 0, an o2 in box 1, and others."""
    standing = seen_parts("o1", "o2").detections
    return PartsView(0, 1.0, tuple(replace(detection, box_px=BOXES[i]) for i, detection in enumerate(standing)), others)


TOWER = stack(lying("o2", 2, 0), lying("o3", 3, 2, 0))
FREE_PLANS = dict.fromkeys(range(4), FREE)


def test_what_lies_on_a_part_is_told_topmost_first() -> None:
    assert TOWER.on_top(0) == (3, 2)
    assert TOWER.on_top(2) == (3,)
    assert TOWER.on_top(1) == TOWER.on_top(3) == ()
    bridge = stack(lying("o3", 2, 0, 1))
    assert bridge.on_top(0) == bridge.on_top(1) == (2,)
    in_a_circle = stack(lying("o2", 2, 3), lying("o3", 3, 2))
    assert in_a_circle.on_top(2) == (3,)


def test_a_carrier_is_refused_whatever_the_planner_says_and_the_topmost_is_named() -> None:
    at = services(grasp=ScriptedGrasps(FREE_PLANS))
    check: Any = alone_at(CheckGraspability("check"), at, 0)
    decode: Any = alone_at(DecodeSolution("decode"), at, 0)
    assert check.update() is Status.FAILURE
    assert check.feedback_message == "o3 o2 on it"
    assert decode.update() is Status.SUCCESS
    assert decode.feedback_message == "move d and c"
    assert decode.blocker.entry.value == 3
    assert alone_at(CheckGraspability("check"), at, 3).update() is Status.SUCCESS, "it can be taken as it lies"
    assert alone_at(CheckGraspability("check"), at, 1).update() is Status.SUCCESS, "nothing lies on it"


def test_what_lies_on_a_part_in_a_way_that_is_not_clear_needs_help() -> None:
    at = services(grasp=ScriptedGrasps(FREE_PLANS))
    decode: Any = alone_at(DecodeSolution("decode"), at, 0, stack(lying("o3", 2, 0, told=False)))
    assert decode.update() is Status.FAILURE
    assert any("something lies on it" in reason for reason in at.memory.reasons), at.memory.reasons


def test_what_the_arm_cannot_take_as_it_lies_needs_help() -> None:
    at = services()
    at.why_not_graspable = lambda parts, required: "no room for the fingers"  # type: ignore[method-assign]  # noqa: ARG005
    assert at.solve(TOWER, 3).text == "help"


def test_what_stands_in_the_way_of_a_part_that_lies_is_moved_first() -> None:
    """Of what stands there only what frees it and can be taken itself."""
    at, view = services(), stack(lying("o3", 2))

    def why_not(parts: PartsView, required: int) -> str | None:
        there = [detection.part for detection in parts.detections]
        return "no room for the fingers" if parts.seen[required].part == "o3" and "o2" in there else None

    at.why_not_graspable = why_not  # type: ignore[method-assign]
    assert at.solve(view, 2).blockers == (1,)
    at.why_not_graspable = lambda parts, required: None if len(parts.seen) < 3 else "none"  # type: ignore[method-assign]  # noqa: ARG005
    again = replace(view, sequence=1)
    assert at.solve(again, 2).text == "help", "what is in its way cannot be taken either"


def test_a_part_that_lies_under_others_is_found_and_one_without_anything_on_it_comes_first() -> None:
    view = stack(lying("o3", 2), lying("o2", 3, 2))
    for part, number in (("o3", 2), ("o2", 1)):
        find: Any = alone(FindPart("find"), services(grasp=ScriptedGrasps(FREE_PLANS)), part=part, parts=view)
        assert find.update() is Status.SUCCESS
        assert find.index.entry.value == number
    lone: Any = alone(FindPart("find"), services(), part="o3", parts=stack(lying("o3", 2)))
    assert lone.update() is Status.FAILURE, "it is to be set upright"


def test_a_part_on_which_something_lies_is_not_set_upright() -> None:
    node: Any = alone(FindLying("find"), services(), parts=stack(lying("o3", 2), lying("o2", 3, 2)))
    assert node.update() is Status.SUCCESS
    assert node.index.entry.value == 3


class Done:
    """A skill that succeeds at once."""

    def poll(self, observation: Observation, command: Command) -> Progress:  # noqa: ARG002
        return Progress(SkillStatus.SUCCESS, "moved aside")

    def halt(self, command: Command) -> None:
        """Nothing to stop."""


@pytest.mark.parametrize(
    ("index", "skill"), [(1, "bracket_cell.skills.move_aside.MoveAside"), (3, "bracket_cell.skills.lying.LayAside")]
)
def test_a_part_is_moved_aside_as_it_stands_or_as_it_lies(
    monkeypatch: pytest.MonkeyPatch, index: int, skill: str
) -> None:
    made: list[PartDetection] = []

    def make(_planner: object, part: PartDetection, _others: object) -> Done:
        made.append(part)
        return Done()

    monkeypatch.setattr(skill, make)
    at = services()
    node: Any = alone(MoveAside("move"), at, parts=TOWER, index=index)
    node.initialise()
    assert node.update() is Status.SUCCESS
    assert made == [TOWER.seen[index]]
    assert at.memory.held_lying is not TOWER.seen[index].upright
    assert len(at.memory.tray_parts) == 3


@pytest.mark.parametrize(("on_others", "turns"), [(False, 1), (True, 0)])
def test_a_part_that_is_laid_elsewhere_to_be_turned_there_counts_as_turned(
    monkeypatch: pytest.MonkeyPatch, on_others: bool, turns: int
) -> None:
    """Else one that fits nowhere would be laid about for ever."""
    monkeypatch.setattr("bracket_cell.skills.lying.LayAside", lambda *_: Done())
    monkeypatch.setattr("bracket_cell.skills.lying.raised", lambda _, part: bool(part.lies_on))
    at = services()
    at.memory.failed_at(lying("o2", 2))
    view = stack(lying("o3", 2, *([0] if on_others else [])))
    node: Any = alone(MoveAside("move"), at, parts=view, index=2)
    node.initialise()
    assert node.update() is Status.SUCCESS
    assert at.memory.turned.get("o3", 0) == turns
    assert at.memory.in_vain == (), "there is room now"


def test_only_what_was_tried_in_vain_is_laid_elsewhere() -> None:
    at, view = services(), stack(lying("o3", 2))
    find: Any = alone(FindLying("find"), at, part="o3", parts=view, after=1)
    assert find.update() is Status.FAILURE
    at.memory.failed_at(view.seen[2])
    assert find.update() is Status.SUCCESS


def test_what_lies_in_a_way_that_is_not_clear_is_not_moved() -> None:
    node: Any = alone(MoveAside("move"), services(), parts=stack(lying("o3", 2, 0, told=False)), index=2)
    with pytest.raises(NodeError, match="part number 2 does not stand, and it is not clear how it lies"):
        node.initialise()


def alone_at(node: Any, to: Any, index: int, view: PartsView = TOWER) -> Any:
    """A node about one part of a view."""
    return alone(node, to, parts=view, index=index)
