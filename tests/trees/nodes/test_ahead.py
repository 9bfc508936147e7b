"""Working ahead of the person: which part is fetched, where it goes, what is still believed of the tray."""

from __future__ import annotations

from dataclasses import replace

import pytest

from bracket_cell.configuration import load_configuration, load_product
from bracket_cell.trees.guard import Guard, GuardSettings
from bracket_cell.trees.nodes.ahead import AwaitPosition, ChooseSparePart, HoldsNeededPart, RecallTray
from bracket_cell.trees.nodes.handing import PartIsNeeded
from bracket_cell.trees.nodes.planning import CheckPlacement
from bracket_cell.trees.nodes.services import Services
from bracket_ground.interfaces.perception import Action, HandSample, HoleView
from bracket_ground.interfaces.planning import UNKNOWN_GOAL, AssemblyPlan, AssemblyState
from btxml.engine.status import Status
from btxml.testing import alone
from tests import ROOT
from tests.trees.nodes.rig import BENCH, EMPTY_HOLES, HOLDING, PRODUCT, SURE, hand_at, see, seen_parts, services

IDLE, TRANSIT = Action("idle", 1.0), Action("transit", 1.0)
ONE_O1_TWO_O2 = AssemblyState({"p1": "o1", "p2": "o1", "p4": "o3"})
DONE = AssemblyState(dict(zip(PRODUCT.positions, ("o1", "o1", "o1", "o2", "o2", "o3"), strict=True)))
ONE_OF_TWO = AssemblyState({"p1": "o1", "p2": "o1", "p4": "o3", "p5": "o2"})


def chooser(at: Services, state: AssemblyState) -> ChooseSparePart:
    node = ChooseSparePart("choose")
    node.setup(services=at)
    for port, value in (("state", state), ("plan", SURE), ("patience_s", 0.8), ("steady_s", 0.4)):
        getattr(node, port).entry.value = value
    node.initialise()
    return node


def holding(part: str | None) -> HandSample:
    return replace(hand_at(1.0, 0.2), held_part=part)


@pytest.mark.parametrize(
    ("state", "action", "held", "chosen"),
    [
        (AssemblyState({}), TRANSIT, None, "o1"),  # three o1 are needed whatever the person takes
        (ONE_O1_TWO_O2, TRANSIT, None, "o2"),  # of two one remains
        (ONE_OF_TWO, TRANSIT, None, None),  # the person may take either
        (ONE_OF_TWO, TRANSIT, "o1", "o2"),
        (ONE_OF_TWO, TRANSIT, "o2", "o1"),
        (ONE_OF_TWO, Action("screw", 1.0), None, "o1"),  # who screws takes nothing; o1 has a sure position
        (DONE, Action("screw", 1.0), None, None),
    ],
)
def test_a_part_is_chosen_that_is_needed_whatever_the_person_takes(
    state: AssemblyState, action: Action, held: str | None, chosen: str | None
) -> None:
    at = services()
    node = chooser(at, state)
    for time_s in (1.0, 1.2, 1.5):
        see(at, time_s, hand=holding(held), action=action)
        status = node.update()
    assert status is (Status.RUNNING if chosen is None else Status.SUCCESS)
    assert chosen is None or node.part.entry.value == chosen  # type: ignore[union-attr]


def test_a_part_that_the_hand_passes_over_is_not_in_it() -> None:
    at = services()
    node = chooser(at, ONE_OF_TWO)
    for time_s, held in ((1.0, "o1"), (1.2, "o1"), (1.3, "o2"), (1.5, None), (1.8, None)):
        see(at, time_s, hand=holding(held), action=TRANSIT)
        assert node.update() is Status.RUNNING


def test_a_hand_that_has_just_come_to_rest_goes_first() -> None:
    at = services()
    node = chooser(at, AssemblyState({}))
    answers = []
    for time_s in (1.0, 1.5, 1.9):
        see(at, time_s, action=IDLE)
        answers.append(node.update())
    assert answers == [Status.RUNNING, Status.RUNNING, Status.SUCCESS]


def test_a_hand_that_rests_goes_first_once_the_arm_is_out_of_its_way_but_not_for_the_last_part() -> None:
    at = services()
    node = chooser(at, AssemblyState({}))
    still = at.now.observation.arm
    for time_s, moving in ((1.0, True), (2.0, True), (3.0, False), (3.7, False)):
        at.now.observation = replace(at.now.observation, arm=replace(still, moving=moving))
        see(at, time_s, action=IDLE)
        assert node.update() is Status.RUNNING
    see(at, 3.9, action=IDLE)
    assert node.update() is Status.SUCCESS
    last = chooser(services(), AssemblyState({**ONE_OF_TWO.placed, "p6": "o2"}))
    see(last.services, 1.0, action=IDLE)
    assert last.update() is Status.SUCCESS
    assert last.part.entry.value == "o1"  # type: ignore[union-attr]


def test_what_was_let_go_and_not_yet_seen_is_neither_fetched_nor_placed_again() -> None:
    at = services(let_go={"p2": "o1"})
    node = waiter(at)
    see(at, 1.0, action=TRANSIT)
    assert node.update() is Status.SUCCESS
    assert node.position.entry.value == "p1"  # type: ignore[union-attr]
    last = chooser(services(let_go={"p6": "o1"}), AssemblyState({**ONE_OF_TWO.placed, "p3": "o2"}))
    see(last.services, 1.0, action=Action("screw", 1.0))
    assert last.update() is Status.RUNNING


def test_a_robot_that_fetches_nothing_says_why() -> None:
    """A detector that takes a resting hand for one that fetches would keep the robot waiting in silence."""
    at = services()
    node = chooser(at, ONE_OF_TWO)
    for time_s, said in ((1.0, ""), (2.0, ""), (9.0, "waiting: the person may take what remains")):
        see(at, time_s, hand=hand_at(1.0, 0.2), action=TRANSIT)
        assert node.update() is Status.RUNNING
        assert at.now.display.message == said
    done = services()
    node = chooser(done, DONE)
    see(done, 9.0, action=TRANSIT)
    assert node.update() is Status.RUNNING
    assert not done.now.display.message  # what the end is waited for, the end says


def waiter(at: Services, part: str = "o1") -> AwaitPosition:
    at.now.observation = replace(at.now.observation, gripper=HOLDING)
    node = AwaitPosition("await")
    node.setup(services=at)
    for port, value in (("state", AssemblyState({})), ("plan", SURE), ("part", part)):
        getattr(node, port).entry.value = value
    return node


def hole_m(position: str) -> tuple[float, float]:
    x, y = PRODUCT.bracket.holes_m[position]
    return BENCH.bracket.position_m[0] + x, BENCH.bracket.position_m[1] + y


@pytest.mark.parametrize(("beside", "chosen"), [("p1", "p2"), (None, "p2")])
def test_the_position_whose_way_is_clear_and_short_is_taken(beside: str | None, chosen: str) -> None:
    at = services()
    node = waiter(at)
    see(at, 1.0, hand=None if beside is None else hand_at(*hole_m(beside)), action=TRANSIT)
    assert node.update() is Status.SUCCESS
    assert node.position.entry.value == chosen  # type: ignore[union-attr]


def test_what_was_begun_after_a_wait_goes_on_when_the_person_places_a_part_meanwhile() -> None:
    """As sure as before, it was turned back there: the wait, which made it worth its risk, began anew."""
    likely = replace(SURE, goal_belief={"g0": 0.96, UNKNOWN_GOAL: 0.04}, next_belief={("o1", "p1"): 0.96})
    at = services(guard=Guard(PRODUCT, GuardSettings(placement_s=4.0)), placed_s=0.0)
    node, state = waiter(at), AssemblyState({"p3": "o1", "p4": "o2", "p5": "o2"})
    node.plan.entry.value, node.state.entry.value = likely, state  # type: ignore[union-attr]
    see(at, 5.0)
    assert node.update() is Status.RUNNING
    see(at, 20.0)
    assert node.update() is Status.SUCCESS
    at.memory.placed_s, waited_s = 20.5, node.waited_s.entry.value  # type: ignore[union-attr]
    see(at, 21.0)
    for waited, answer in ((0.0, Status.FAILURE), (waited_s, Status.SUCCESS)):
        check = alone(CheckPlacement("check"), at, plan=likely, state=state, part="o1", position="p1", waited_s=waited)
        assert check.update() is answer


def test_a_position_that_the_person_is_filling_is_theirs() -> None:
    at = services()
    node = waiter(at)
    see(at, 1.0, action=Action("assembly", 1.0, "o1", "p2"))
    assert node.update() is Status.SUCCESS
    assert node.position.entry.value == "p1"  # type: ignore[union-attr]


def test_a_hand_near_every_way_is_waited_for_but_not_for_ever() -> None:
    at = services()
    node = waiter(at)
    node.clear_m.entry.value = 0.25  # type: ignore[union-attr]
    node.patience_s.entry.value = 2.0  # type: ignore[union-attr]
    node.initialise()
    answers = []
    for time_s in (1.0, 2.9, 3.1):
        see(at, time_s, hand=hand_at(*hole_m("p1")), action=TRANSIT)
        answers.append(node.update())
    assert answers == [Status.RUNNING, Status.RUNNING, Status.SUCCESS]
    node.initialise()
    see(at, 4.0, hand=hand_at(1.2, 0.5), action=TRANSIT)
    assert node.update() is Status.SUCCESS


def test_a_part_waits_until_the_guard_is_sure_and_fails_where_nothing_is_left_for_it() -> None:
    at = services()
    node = waiter(at)
    see(at, 1.0)
    node.plan.entry.value = replace(SURE, next_belief={("o1", "p1"): 0.6})  # type: ignore[union-attr]
    assert node.update() is Status.RUNNING
    assert "< 0.9" in node.feedback_message
    node.state.entry.value = AssemblyState({"p1": "o1", "p2": "o1", "p3": "o1"})  # type: ignore[union-attr]
    assert node.update() is Status.FAILURE


def test_a_robot_that_stands_with_a_part_says_what_it_waits_for_also_after_it_has_moved() -> None:
    at = services()
    node = waiter(at)
    node.plan.entry.value = replace(SURE, next_belief={("o1", "p1"): 0.6})  # type: ignore[union-attr]
    see(at, 1.0)
    node.update()
    at.now.show(message="arm at park")
    see(at, 2.0)
    node.update()
    assert at.now.display.message.startswith("holding o1; o1 at p")


def test_a_part_in_the_gripper_is_kept_as_long_as_it_is_needed() -> None:
    at = services(held_part="o3")
    node = HoldsNeededPart("holds")
    node.setup(services=at)
    node.state.entry.value = AssemblyState({})  # type: ignore[union-attr]
    assert node.update() is Status.FAILURE
    at.now.observation = replace(at.now.observation, gripper=HOLDING)
    assert node.update() is Status.SUCCESS
    node.state.entry.value = AssemblyState({"p5": "o3"})  # type: ignore[union-attr]
    assert node.update() is Status.FAILURE


@pytest.mark.parametrize(("seen", "status"), [("o2", Status.SUCCESS), ("o3", Status.FAILURE)])
def test_nobody_is_offered_what_the_holes_show_to_be_there(seen: str, status: Status) -> None:
    at = services()
    assert alone(PartIsNeeded("needed"), at, part="o3").update() is Status.FAILURE, "nobody sees the bracket"
    see(at, 1.0, holes={**EMPTY_HOLES, "p5": HoleView(seen, 0.99, 1.0)})
    assert alone(PartIsNeeded("needed"), at, part="o3").update() is status


def test_the_tray_is_believed_for_a_while_after_a_look() -> None:
    parts = seen_parts("o1", "o2")
    at = services()
    node = RecallTray("recall")
    node.setup(services=at)
    node.oldest_s.entry.value = 60.0  # type: ignore[union-attr]
    assert node.update() is Status.FAILURE
    at.memory.tray_parts, at.memory.tray_seen_s = parts.detections[1:], 5.0
    at.now.observation = replace(at.now.observation, time_s=64.0)
    assert node.update() is Status.SUCCESS
    assert [part.part for part in node.parts.entry.value.detections] == ["o2"]  # type: ignore[union-attr]
    at.now.observation = replace(at.now.observation, time_s=66.0)
    assert node.update() is Status.FAILURE


def test_a_part_that_no_likely_goal_wants_any_more_is_put_back() -> None:
    """Two goals take two gate valves, and the person has shown that it is the one that takes one."""
    file = ROOT / "config" / "examples" / "subassembly" / "cell.yaml"
    product = load_product(load_configuration(file), file)
    at = services(product=product, held_part="o2", observation=replace(services().now.observation, gripper=HOLDING))
    placed = AssemblyState({"p1": "o2", "p3": "o3", "p4": "o3"})
    for share, status in ((0.5, Status.SUCCESS), (0.001, Status.FAILURE)):
        plan = AssemblyPlan({"g0": share, "g1": 1 - share}, {}, "pump", {})
        assert alone(HoldsNeededPart("holds"), at, state=placed, plan=plan).update() is status


def test_a_person_who_rests_is_brought_what_only_one_likely_goal_wants() -> None:
    """Both waited for each other: the person for the robot, the robot for a placement that tells which goal it is."""
    file = ROOT / "config" / "examples" / "subassembly" / "cell.yaml"
    configuration = load_configuration(file)
    at = services(product=load_product(configuration, file), bench=configuration.bench)
    plan = AssemblyPlan({"g0": 0.9, "g1": 0.1}, {}, "o2", {})
    state = AssemblyState({"p3": "o3", "p1": "pump"})  # g0 takes two gate valves more, g1 one, at another place
    node = alone(ChooseSparePart("spare"), at, state=replace(state, placed={**state.placed, "p2": "o2"}), plan=plan)
    node.initialise()
    told = []
    for time_s, action in ((1.0, TRANSIT), (1.5, IDLE), (2.6, IDLE)):
        see(at, time_s, action=action)
        told.append(node.update())
    assert told == [Status.RUNNING, Status.RUNNING, Status.SUCCESS]
    assert node.part.entry.value == "o2"  # type: ignore[attr-defined]
