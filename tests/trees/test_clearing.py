"""Getting at a part in clutter: what a failed try leaves in the gripper goes back before the next one begins."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import pytest

from bracket_cell.trees.bench import TreeBench
from bracket_cell.trees.loading import load_tree
from bracket_cell.trees.node_library import node_registry
from bracket_cell.trees.nodes.moving import MoveAside, PickPart
from tests import ROOT
from tests.trees.nodes.rig import HOLDING, seen_parts, services

TREE = ROOT / "trees" / "clear_and_grasp.xml"
FOUND: dict[str, dict[str, Any]] = {
    "FindPart": {"index": 0},
    "DecodeSolution": {"blocker": 1},
    "LookAtTray": {"parts": seen_parts("o3", "o1")},
}


def ticked_to_its_end(tree: TreeBench) -> str:
    """A letter for each tick, ten a second; the last is S for success or F for failure."""
    told = ""
    while told[-1:] not in ("S", "F"):
        told += tree.tick(0.1)
    return told


def test_a_part_that_could_not_be_put_aside_is_put_back_before_the_next_look() -> None:
    """The fingers would open over the tray to take the next one, and drop it."""
    answers = {"CheckGraspability": "FSS", "MoveAside": "F", "GripperIsEmpty": "SFS", "PickPart": "S"}
    made = TreeBench(TREE, answers, FOUND)
    while made.tick(0.1) == "R" and "start PickPart" not in made.events:
        pass
    began = [event.split()[1] for event in made.events if event.startswith("start")]
    after = began[began.index("MoveAside") + 1 :]
    assert after.index("ReturnToTray") < after.index("MoveTo") < after.index("PickPart")


@pytest.mark.parametrize("name", ["ahead", "assemble", "shift", "shift_ahead"])
def test_every_tree_gives_way_before_and_after_it_places_a_part(name: str) -> None:
    tree = load_tree(ROOT / "trees" / f"{name}.xml", node_registry())
    places = [node for node in tree.nodes if type(node).__name__ == "PlacePart"]
    assert places
    for node in places:
        placing = node.full_path.rsplit("/", 1)[0]
        siblings = [tree_node for tree_node in tree.nodes if tree_node.full_path.startswith(placing)]
        ways = [
            type(sibling).__name__
            for sibling in siblings
            if type(sibling).__name__ in ("GiveWay", "PlacePart", "MoveTo")
        ]
        ahead = "ahead" in name  # there it may go on with the next part, and gives way then
        assert ways == (["GiveWay", "PlacePart"] if ahead else ["GiveWay", "PlacePart", "GiveWay", "MoveTo"])
    for park in (node for node in tree.nodes if "StayOutOfTheWay" in node.full_path):
        if type(park).__name__ == "MoveTo":
            beside = [
                tree_node
                for tree_node in tree.nodes
                if tree_node.full_path.rsplit("/", 1)[0] == park.full_path.rsplit("/", 1)[0]
            ]
            assert [type(tree_node).__name__ for tree_node in beside] == ["ReactiveSequence", "GiveWay", "MoveTo"]


def test_one_part_ahead_the_arm_waits_for_the_hand_beside_the_hole() -> None:
    answers = {"GripperIsEmpty": "F", "WaitForHandClear": "RRRS", "MoveBeside": "RS", "PlacePart": "RS"}
    made = TreeBench(ROOT / "trees" / "ahead.xml", answers, main="PlaceAhead", part=True)
    assert ticked_to_its_end(made) == "RRRRS"
    moves = [event for event in made.events if event.split()[1] in ("MoveBeside", "PlacePart") and "tick" not in event]
    assert moves == ["start MoveBeside", "end MoveBeside", "start PlacePart", "end PlacePart"]


@pytest.mark.parametrize("kind", [PickPart, MoveAside])
def test_what_the_gripper_holds_is_not_forgotten_where_another_part_is_to_be_taken(kind: type[Any]) -> None:
    at = services()
    at.now.observation = replace(at.now.observation, gripper=HOLDING)
    at.memory.held_part, at.memory.held_lying = "o2", True
    node = kind("take")
    node.setup(services=at)
    node.parts.entry.value, node.index.entry.value = seen_parts("o3", "o1"), 0
    node.make_skill()
    assert (at.memory.held_part, at.memory.held_lying) == ("o2", True)


@pytest.mark.parametrize("tree", ["ahead", "assemble"])
@pytest.mark.parametrize(
    ("first", "then", "asked", "end"),
    [("FS", "F", 0, "S"), ("F", "S", 1, "S"), ("F", "FS", 2, "S"), ("F", "F", 2, "F")],
)
def test_a_person_is_asked_to_take_out_what_cannot_be_put_back(
    tree: str, first: str, then: str, asked: int, end: str
) -> None:
    """As what a person pulled down in the fingers; the run ends well where it goes back after that."""
    returns = {"EmptyFingers::2/EmptyOrPutBack::5/ReturnToTray::11": first, "ReturnToTray": then}
    answers = {"GripperIsEmpty": "F", **returns}
    made = TreeBench(ROOT / "trees" / f"{tree}.xml", answers, main="PutBack")
    told = ticked_to_its_end(made)
    assert (made.started("AskForHelp"), told[-1]) == (asked, end)


def test_clearing_takes_nothing_more_where_the_fingers_stay_full() -> None:
    answers = {"GripperIsEmpty": "F", "ReturnToTray": "F"}
    made = TreeBench(TREE, answers, FOUND, main="ClearAndGrasp", provided={"part": "o3"})
    told = ticked_to_its_end(made)
    assert (told[-1], made.started("AskForHelp"), made.started("PickPart")) == ("F", 2, 0)


def test_a_part_that_is_not_seen_is_looked_for_a_second_apart_and_soon_asked_for() -> None:
    answers = {"FindPart": "F", "FindLying": "F"}
    made = TreeBench(TREE, answers, FOUND, main="ClearAndGrasp", provided={"part": "o3"})
    told = ticked_to_its_end(made)
    assert (told[-1], made.started("LookAtTray")) == ("F", 3)
    assert len(told) >= 20


def test_where_the_required_type_is_not_seen_what_lies_on_others_is_moved() -> None:
    answers = {"FindPart": "FS", "FindLying": "F", "what lies on others": "S"}
    made = TreeBench(TREE, answers, FOUND, main="ClearAndGrasp", provided={"part": "o3"})
    assert ticked_to_its_end(made)[-1] == "S"
    assert (made.started("LookAtTray"), made.started("MoveAside"), made.started("PickPart")) == (2, 1, 1)


@pytest.mark.parametrize(("lies", "looks"), [("S", 6), ("SSF", 5)])
def test_a_part_that_could_not_be_set_upright_does_not_count_as_one_that_is_not_seen(lies: str, looks: int) -> None:
    """Several may lie there, each to be tried twice; where all were, nothing is left to be seen."""
    answers = {"FindPart": "F", "FindLying": lies, "SetUpright": "F", "MoveAside": "F", "what lies on others": "F"}
    found = {**FOUND, "FindLying": {"index": 0}}
    made = TreeBench(TREE, answers, found, main="ClearAndGrasp", provided={"part": "o3"})
    told = ticked_to_its_end(made)
    assert (told[-1], made.started("LookAtTray")) == ("F", looks)


@pytest.mark.parametrize("on_others", ["S", "F"])
def test_what_cannot_be_turned_where_it_lies_is_laid_elsewhere_after_what_lies_on_others(on_others: str) -> None:
    answers = {"FindPart": "FFS", "FindLying": "S", "SetUpright": "FS", "what lies on others": on_others}
    found = {**FOUND, "FindLying": {"index": 0}, "what lies on others": {"index": 1}}
    made = TreeBench(TREE, answers, found, main="ClearAndGrasp", provided={"part": "o3"})
    assert ticked_to_its_end(made)[-1] == "S"
    assert (made.started("SetUpright"), made.started("MoveAside"), made.started("PickPart")) == (3, 1, 1)


def test_what_stands_beside_a_part_that_has_no_room_is_moved_away() -> None:
    answers = {"FindPart": "FS", "FindLying": "S", "SetUpright": "F", "what lies on others": "F", "MoveAside": "FS"}
    found = {**FOUND, "FindLying": {"index": 0}}
    made = TreeBench(TREE, answers, found, main="ClearAndGrasp", provided={"part": "o3"})
    assert ticked_to_its_end(made)[-1] == "S"
    assert (made.started("MoveAside"), made.started("DecodeSolution"), made.started("PickPart")) == (2, 1, 1)
