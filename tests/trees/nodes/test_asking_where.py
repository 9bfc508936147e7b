"""Where does this part go? Asked of a product that nobody knows, where the person goes on with nothing."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import pytest

from bracket_cell.learned.semantic.model import BayesPlanner
from bracket_cell.trees.bench import TreeBench
from bracket_cell.trees.nodes.asking_where import AskPosition
from bracket_cell.trees.nodes.people import hole_on_bench_m
from bracket_cell.trees.nodes.services import Services
from bracket_ground.interfaces.notes import ListJournal
from bracket_ground.interfaces.operator import PLACED_BY_HAND, OperatorOrder, OperatorState
from bracket_ground.interfaces.perception import HoleView
from bracket_ground.interfaces.planning import UNKNOWN_GOAL, AssemblyPlan, AssemblyState
from btxml.engine.status import Status
from btxml.testing import alone
from tests import ROOT
from tests.trees.nodes.rig import EMPTY_HOLES, HOLDING, PRODUCT, SURE, hand_at, see, services

NEW = AssemblyState({"p1": "o2", "p2": "o3", "p4": "o1", "p6": "o1"}, told_goal=UNKNOWN_GOAL)  # o1 and o2 are left
NOTHING = AssemblyPlan({"g0": 0.0, "g1": 0.0, "g2": 0.0, UNKNOWN_GOAL: 1.0}, {}, "o1", {"o1": (), "o2": (), "o3": ()})


def says(to: Services, *orders: OperatorOrder) -> None:
    to.now.observation = replace(to.now.observation, operator=OperatorState(present=True, said=orders))


def asking(to: Services, state: AssemblyState = NEW, plan: AssemblyPlan = NOTHING) -> Any:
    says(to)
    return alone(AskPosition("where"), to, plan=plan, state=state)


def later(to: Services, node: Any, time_s: float) -> Status:
    see(to, time_s)
    status: Status = node.execute()
    return status


def asked(to: Services) -> Any:
    """The node, once its first question stands."""
    node = asking(to)
    later(to, node, 0.0)
    later(to, node, 7.0)
    return node


def test_where_nothing_was_placed_for_a_while_it_asks_and_the_answer_becomes_the_plan() -> None:
    to = services()
    node = asking(to)
    assert later(to, node, 0.0) is Status.RUNNING
    assert not to.now.display.questions, "the person may go on"
    assert later(to, node, 6.1) is Status.RUNNING
    (question,) = to.now.display.questions
    assert question.reason == "where does the gate valve (o1) go: p3 or p5?"
    assert (question.kind, question.part, question.positions) == ("where", "o1", ("p3", "p5"))
    assert [answer.value for answer in question.answers] == ["p3", "p5", PLACED_BY_HAND]
    says(to, OperatorOrder("answer", "p5", question.number))
    assert node.execute() is Status.RUNNING
    state = node.state.get()
    assert state.told_parts == {"p5": "o1"}
    plan = replace(to.tools, semantic=BayesPlanner(PRODUCT)).infer(state)
    assert plan.next_part == "o1"
    assert plan.guidance["o1"][0] == "p5"
    assert plan.next_belief["o1", "p5"] == 1.0
    assert to.tools.guard.judge(plan, state, EMPTY_HOLES, "o1", "p5", True).decision == "act"
    node.plan.entry.value = plan
    assert node.execute() is Status.SUCCESS
    assert to.now.display.questions == ()


def test_a_part_that_the_person_places_is_followed_by_the_next_type_and_then_by_nothing() -> None:
    to = services()
    node = asked(to)
    for number, part in enumerate(["o1", "o2"], start=1):
        (question,) = to.now.display.questions
        assert (question.number, question.part) == (number, part)
        says(to, OperatorOrder("answer", PLACED_BY_HAND, number))
        node.execute()
        node.execute()
    assert node.status is Status.FAILURE
    assert to.now.display.questions == ()


def test_the_part_in_the_gripper_is_asked_for_first_and_though_another_is_told() -> None:
    state = replace(NEW, told_parts={"p5": "o1"})
    to = services()
    plan = replace(to.tools, semantic=BayesPlanner(PRODUCT)).infer(state)
    for held, holes in (("", None), ("o1", None), ("o2", ("p3", "p5"))):
        to = services()
        to.memory.held_part = held
        if held:
            to.now.observation = replace(to.now.observation, gripper=HOLDING)
        node = asking(to, state, plan)
        later(to, node, 0.0)
        later(to, node, 7.0)
        assert [(question.part, question.positions) for question in to.now.display.questions] == (
            [] if holes is None else [(held, holes)]
        )


def test_the_order_to_place_it_oneself_is_an_answer_once() -> None:
    to = services()
    node = asked(to)
    says(to, OperatorOrder("place", "o1", time_s=8.0))
    for time_s in (8.0, 8.1, 8.2):
        later(to, node, time_s)
    assert [(question.number, question.part) for question in to.now.display.questions] == [(2, "o2")]


def points(to: Services, node: Any, position: str, until_s: float, from_s: float = 8.0, **sample: Any) -> None:
    """A hand over a hole, in look after look."""
    x, y = hole_on_bench_m(to, position).tolist()
    closed = {"thumb_m": (x, y), "index_m": (x, y + 0.01)}
    for number in range(round((until_s - from_s) / 0.1) + 1):
        time_s = from_s + 0.1 * number
        holes = {name: view for name, view in EMPTY_HOLES.items() if name in ("p3", "p5")}
        looks = {name: replace(view, seen_s=min(time_s, 7.9)) for name, view in holes.items()} | sample.get("holes", {})
        hand = replace(hand_at(x, y), time_s=time_s, **{**closed, **sample.get("hand", {})})
        see(to, time_s, hand=hand, holes=looks, **sample.get("view", {}))
        node.execute()


def told(to: Services, node: Any) -> dict[str, str]:
    assert isinstance(to.tools.journal, ListJournal)
    found = [fields for topic, fields in to.tools.journal.notes if topic == "belief" and "told_part" in fields]
    assert all(fields["source"] == "pointing" for fields in found)
    return dict(node.state.get().told_parts)


def test_a_hand_that_points_at_an_open_hole_answers() -> None:
    to = services()
    node = asked(to)
    points(to, node, "p5", 9.7)
    assert not told(to, node), "a hand may hesitate over a hole"
    points(to, node, "p5", 10.2)
    assert told(to, node) == {"p5": "o1"}


def test_what_a_tracker_that_has_told_held_parts_tells_of_empty_fingers_counts() -> None:
    to = services()
    node = asking(to, replace(NEW, told_goal=None))
    see(to, 0.0, hand=replace(hand_at(1.0, 0.0), held_part="o1"))
    assert node.execute() is Status.FAILURE
    node.state.set(NEW)
    later(to, node, 0.5)
    later(to, node, 7.0)
    points(to, node, "p5", 10.2, hand={"thumb_m": None})
    assert told(to, node) == {"p5": "o1"}


@pytest.mark.parametrize(
    ("position", "sample"),
    [
        ("p1", {}),
        ("p5", {"hand": {"held_part": "o1"}}),
        ("p5", {"hand": {"thumb_m": None}}),
        ("p5", {"hand": {"thumb_m": (9.0, 9.0)}}),
        ("p5", {"holes": {"p5": HoleView("o2", 1.0, 7.9)}}),
        ("p5", {"holes": {"p5": HoleView(None, 1.0, -9.0)}}),
        ("p5", {"view": {"hand_unknown": "nobody knows"}}),
        ("p5", {"view": {"other_hands": ()}}),
    ],
    ids=[
        "filled",
        "holds a part",
        "fingers unknown",
        "fingers apart",
        "seen filled",
        "seen long ago",
        "unknown",
        "two",
    ],
)
def test_what_is_no_pointing_answers_nothing(position: str, sample: dict[str, Any]) -> None:
    to = services()
    node = asked(to)
    if "other_hands" in sample.get("view", {}):  # the second hand points, too
        x, y = hole_on_bench_m(to, "p3").tolist()
        both = replace(hand_at(x, y), thumb_m=(x, y), index_m=(x, y))
        sample = {"view": {"other_hands": (both,)}}
    points(to, node, position, 12.0, **sample)
    assert not told(to, node)


def test_a_hand_that_goes_from_hole_to_hole_points_at_nothing() -> None:
    to = services()
    node = asked(to)
    for begins_s, position in ((8.0, "p5"), (9.5, "p3"), (11.0, "p5")):
        points(to, node, position, begins_s + 1.5, begins_s)
    assert not told(to, node)
    points(to, node, "p5", 13.1, 12.5)
    assert told(to, node) == {"p5": "o1"}


def test_it_is_withdrawn_when_the_person_goes_on() -> None:
    to = services()
    node = asked(to)
    node.state.set(NEW.with_placement("o1", "p3"))
    assert node.execute() is Status.FAILURE
    assert to.now.display.questions == ()


@pytest.mark.parametrize(
    ("state", "plan"),
    [
        (replace(NEW, told_goal=None), NOTHING),
        (replace(NEW, told_goal="g0"), SURE),
        (NEW, SURE),
        (NEW.with_placement("o1", "p3"), NOTHING),
    ],
    ids=["nobody said that it is new", "a known goal", "planned", "one type is left"],
)
def test_what_is_known_is_not_asked(state: AssemblyState, plan: AssemblyPlan) -> None:
    assert asking(services(), state, plan).execute() is Status.FAILURE


def test_nobody_there_is_asked_nothing() -> None:
    to = services()
    node = alone(AskPosition("where"), to, plan=NOTHING, state=NEW)
    assert node.execute() is Status.FAILURE


@pytest.mark.parametrize("name", ["assemble", "shift"])
def test_a_screw_where_nothing_follows_from_the_graph_asks_where_and_then_fetches(name: str) -> None:
    answers = {
        "AssemblyFinished": "F",
        "BracketTaken": "F",
        "ChoosePosition": "FS",
        "BuiltBeside": "F",
        "AskWhichGoal": "F",
        "AskPosition": "RS",
    }
    made = TreeBench(ROOT / "trees" / f"{name}.xml", {**answers, "WaitForAction": "SR", "AwaitMisfit": "R"})
    for _ in range(30):
        made.tick(0.1)
    order = [event.removeprefix("start ") for event in made.events if event.startswith("start ")]
    assert order.index("AskPosition") < order.index("LookAtTray")


@pytest.mark.parametrize("name", ["ahead", "shift_ahead"])
def test_one_part_ahead_it_is_asked_beside_the_work(name: str) -> None:
    answers = {"AssemblyFinished": "F", "BracketTaken": "F", "AwaitPosition": "R", "AskPosition": "R"}
    made = TreeBench(ROOT / "trees" / f"{name}.xml", {**answers, "AwaitMisfit": "R"})
    for _ in range(3):
        made.tick(0.1)
    assert "start AskPosition" in made.events
    assert "start AwaitPosition" in made.events
