"""From one bracket to the next: empty, begun, taken away, ended, learned, enough."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

from bracket_cell.trees.nodes.services import Services, Tools
from bracket_cell.trees.nodes.shift import BeginBracket, BracketTaken, EndBracket, ShiftIsOver, WaitForEmptyBracket
from bracket_cell.trees.nodes.watching import StartGraph
from bracket_ground.interfaces.operator import OperatorState
from bracket_ground.interfaces.perception import HoleView
from bracket_ground.interfaces.planning import AssemblyState
from bracket_ground.interfaces.resume import ResumeState
from btxml.engine.status import Status
from btxml.testing import alone
from tests.trees.nodes.rig import EMPTY_HOLES, PRODUCT, see, services

G0 = PRODUCT.goal_placements("g0")
FULL = {position: HoleView(part, 1.0, 0.0) for position, part in G0.items()}


def notes(to: Services) -> list[dict[str, object]]:
    return [fields for topic, fields in to.tools.journal.take() if topic == "bracket"]  # type: ignore[attr-defined]


def test_it_asks_for_an_empty_bracket_and_waits_until_it_is_seen() -> None:
    to = services()
    node: Any = alone(WaitForEmptyBracket("wait"), to)
    see(to, 0.0, holes=FULL)
    assert node.execute() is Status.RUNNING
    assert [question.kind for question in to.now.display.questions] == ["bracket"]
    see(to, 1.0)
    assert node.execute() is Status.RUNNING
    see(to, 2.1)
    assert node.execute() is Status.SUCCESS
    assert to.now.display.questions == ()


def test_a_hole_that_was_never_seen_is_not_taken_for_empty() -> None:
    to = services()
    node: Any = alone(WaitForEmptyBracket("wait"), to)
    for time_s in (0.0, 5.0):
        see(to, time_s, holes={"p1": HoleView(None, 1.0, 0.0)})
        assert node.execute() is Status.RUNNING


def test_brackets_are_counted_and_begin_without_edges() -> None:
    to = services()
    node: Any = alone(BeginBracket("begin"), to, number=4)
    assert node.execute() is Status.SUCCESS
    assert (node.number.get(), node.state.entry.value) == (5, AssemblyState({}))
    assert notes(to) == [{"number": 5, "edge": "begin"}]


def test_a_bracket_that_is_cleared_by_hand_is_noticed_and_one_that_never_had_parts_is_not() -> None:
    to = services()
    taken: Any = alone(BracketTaken("taken"), to, number=1, state=AssemblyState(G0))
    see(to, 0.0, holes=FULL)
    assert taken.execute() is Status.FAILURE
    see(to, 1.0)
    assert taken.execute() is Status.FAILURE
    see(to, 2.1)
    assert taken.execute() is Status.SUCCESS
    taken.number.entry.value, taken.state.entry.value = 2, AssemblyState({"p1": "o1"})
    see(to, 4.0)
    assert taken.execute() is Status.FAILURE
    see(to, 9.0)
    assert taken.execute() is Status.FAILURE


def test_the_end_is_noted_and_what_was_seen_is_learned() -> None:
    learned: list[tuple[str, ...]] = []

    def learn(tools: Tools, parts: tuple[str, ...]) -> tuple[Tools, str]:
        learned.append(parts)
        return tools, "g0"

    to = services(learn=learn)
    node: Any = alone(EndBracket("end"), to, number=3, state=AssemblyState(G0))
    see(to, 0.0, holes=FULL)
    assert node.execute() is Status.SUCCESS
    assert learned == [PRODUCT.goals["g0"]]
    assert to.memory.finished == (PRODUCT.goals["g0"],)
    assert notes(to)[0]["finished"] is True
    see(to, 1.0, holes=EMPTY_HOLES)
    node.execute()
    assert notes(to)[0]["finished"] is False
    assert len(learned) == 1


def test_enough_is_what_the_operator_wants() -> None:
    to = services()
    node: Any = alone(ShiftIsOver("over"), to, number=3)
    for wanted, status in ((None, Status.FAILURE), (4, Status.FAILURE), (3, Status.SUCCESS), (0, Status.SUCCESS)):
        to.now.observation = replace(to.now.observation, operator=OperatorState(brackets=wanted))
        assert node.execute() is status


def test_a_shift_that_begins_with_a_bracket_half_full_goes_on_with_it_but_only_the_first_time() -> None:
    to = services()
    node: Any = alone(WaitForEmptyBracket("wait"), to)
    half = {**EMPTY_HOLES, "p1": FULL["p1"]}
    see(to, 0.0, holes=half)
    assert node.execute() is Status.SUCCESS
    assert not to.now.display.questions
    to.memory.brackets = 1
    see(to, 1.0, holes=half)
    assert node.execute() is Status.RUNNING
    assert [question.kind for question in to.now.display.questions] == ["bracket"]


def test_a_resumed_shift_goes_on_with_its_bracket_and_keeps_counting() -> None:
    to = services(left_off=ResumeState(AssemblyState({"p1": "o1"}, "g0"), bracket=3))
    wait: Any = alone(WaitForEmptyBracket("wait"), to)
    see(to, 0.0)
    assert wait.execute() is Status.SUCCESS, "nothing stood in it yet, and it was begun"
    node: Any = alone(BeginBracket("begin"), to, number=0)
    assert node.execute() is Status.SUCCESS
    assert (node.number.get(), node.state.entry.value) == (3, AssemblyState({"p1": "o1"}, "g0"))
    assert notes(to) == [{"number": 3, "edge": "begin", "resumed": True}]
    assert node.execute() is Status.SUCCESS
    assert (node.number.get(), node.state.entry.value) == (4, AssemblyState({}))


def test_a_shift_that_was_left_between_two_brackets_begins_the_next_one() -> None:
    to = services(left_off=ResumeState(AssemblyState(dict(G0)), bracket=3, ended=True))
    wait: Any = alone(WaitForEmptyBracket("wait"), to)
    see(to, 0.0, holes=FULL)
    assert wait.execute() is Status.RUNNING
    node: Any = alone(BeginBracket("begin"), to, number=0)
    assert node.execute() is Status.SUCCESS
    assert (node.number.get(), node.state.entry.value) == (4, AssemblyState({}))


def test_an_assembly_that_was_left_begins_with_its_graph() -> None:
    to = services(left_off=ResumeState(AssemblyState({"p2": "o2"})))
    node: Any = alone(StartGraph("start"), to)
    assert node.execute() is Status.SUCCESS
    assert node.state.entry.value == AssemblyState({"p2": "o2"})
    assert to.memory.left_off == ResumeState()
