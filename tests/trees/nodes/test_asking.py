"""Questions: asked once, answered by words, by the bench or by nobody, and withdrawn."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import pytest

from bracket_cell.trees.nodes.asking import AskForHelp, AskWhichGoal, HearOperator, WaitWhilePaused
from bracket_cell.trees.nodes.services import Services
from bracket_ground.interfaces.operator import HELP_GIVEN, PLACED_BY_HAND, OperatorOrder, OperatorState
from bracket_ground.interfaces.perception import HoleView
from bracket_ground.interfaces.planning import UNKNOWN_GOAL, AssemblyPlan, AssemblyState
from btxml.engine.status import Status
from btxml.testing import alone
from tests.trees.nodes.rig import BENCH, EMPTY_HOLES, SURE, hand_at, see, services

TEXT = "put one into the tray"
DOUBTFUL = AssemblyPlan(
    goal_belief={"g0": 0.2, "g1": 0.0, "g2": 0.0, UNKNOWN_GOAL: 0.8},
    next_belief={("o1", "p1"): 0.5},
    next_part="o1",
    guidance={"o1": ("p1",), "o2": (), "o3": ()},
)


def says(to: Services, *orders: OperatorOrder, **state: Any) -> None:
    """What the operator has said so far."""
    known = OperatorState(present=True, said=orders, **state)
    to.now.observation = replace(to.now.observation, operator=known)


def asking(to: Services) -> Any:
    return alone(AskForHelp("help"), to, text=TEXT, part="o3", wait_s=60.0)


def test_without_waiting_it_asks_and_goes_on() -> None:
    to = services()
    node: Any = alone(AskForHelp("help"), to, text=TEXT, part="o3")
    assert node.execute() is Status.SUCCESS
    assert to.now.display.help_request == f"safety valve (o3): {TEXT}"
    assert to.now.display.questions == ()


def test_a_question_says_why_what_was_tried_and_what_to_do() -> None:
    to = services()
    for _ in range(3):
        to.memory.failed("there is no safety valve (o3) in the tray")
    node = asking(to)
    assert node.execute() is Status.RUNNING
    (question,) = to.now.display.questions
    assert question.reason == "there is no safety valve (o3) in the tray"
    assert question.tried == "there is no safety valve (o3) in the tray (3 times)"
    assert (question.todo, question.part) == (TEXT, "o3")
    assert not to.memory.reasons


def test_help_that_was_given_succeeds_and_the_question_goes() -> None:
    to = services()
    node = asking(to)
    node.execute()
    says(to, OperatorOrder("answer", HELP_GIVEN, to.now.display.questions[0].number))
    assert node.execute() is Status.SUCCESS
    assert to.now.display.questions == ()
    assert to.now.display.help_request is None


def test_a_part_that_the_person_places_ends_it_without_another_try() -> None:
    to = services()
    see(to, 0.1)
    node = asking(to)
    node.execute()
    see(to, 5.0, holes={**EMPTY_HOLES, "p3": HoleView("o3", 1.0, 5.0)})
    assert node.execute() is Status.FAILURE
    to = services()
    node = asking(to)
    node.execute()
    says(to, OperatorOrder("answer", PLACED_BY_HAND, 1))
    assert node.execute() is Status.FAILURE


def test_a_hand_that_was_in_the_tray_is_an_answer() -> None:
    to = services()
    x, y, _ = BENCH.tray.centre_m
    see(to, 0.1, hand=hand_at(1.1, 0.4))
    node = asking(to)
    assert node.execute() is Status.RUNNING
    see(to, 1.0, hand=hand_at(x, y))
    assert node.execute() is Status.RUNNING
    see(to, 2.0, hand=hand_at(1.1, 0.4))
    assert node.execute() is Status.SUCCESS


def test_a_hand_that_vanishes_over_the_tray_is_none_and_one_that_goes_out_of_view_is() -> None:
    to = services()
    x, y, _ = BENCH.tray.centre_m
    see(to, 0.1)
    node = asking(to)
    assert node.execute() is Status.RUNNING
    see(to, 1.0, hand=hand_at(x, y))
    assert node.execute() is Status.RUNNING
    see(to, 1.5, hand_unknown="the hand vanished inside the view")
    assert node.execute() is Status.RUNNING
    see(to, 2.0)
    assert node.execute() is Status.SUCCESS


def test_nobody_answers() -> None:
    to = services()
    see(to, 0.0)
    node = asking(to)
    node.execute()
    see(to, 59.0)
    assert node.execute() is Status.RUNNING
    see(to, 60.1)
    assert node.execute() is Status.FAILURE
    assert to.now.display.questions == ()


def test_a_halt_withdraws_the_question() -> None:
    to = services()
    node = asking(to)
    node.execute()
    node.halt()
    assert to.now.display.questions == ()


def which_goal(to: Services, plan: AssemblyPlan) -> Any:
    return alone(AskWhichGoal("goal"), to, plan=plan, state=AssemblyState({"p6": "o2"}))


def test_a_doubtful_first_act_is_asked_and_the_answer_changes_the_state() -> None:
    to = services()
    says(to)
    node = which_goal(to, DOUBTFUL)
    assert node.execute() is Status.RUNNING
    (question,) = to.now.display.questions
    assert [answer.value for answer in question.answers] == ["g0", "g1", "g2", UNKNOWN_GOAL]
    assert dict(question.answers[0].placements)["p6"] == "o3"
    says(to, OperatorOrder("answer", "g0", question.number))
    assert node.execute() is Status.RUNNING, "the plan does not know of it yet"
    assert node.state.get() == AssemblyState({"p6": "o2"}, told_goal="g0")
    node.plan.entry.value = SURE
    assert node.execute() is Status.SUCCESS
    assert to.now.display.questions == ()


@pytest.mark.parametrize("answered", [0, 1])
def test_two_branches_of_a_tree_ask_one_question_and_both_hear_the_answer(answered: int) -> None:
    to = services()
    says(to)
    nodes = [which_goal(to, DOUBTFUL), which_goal(to, DOUBTFUL)]
    nodes[1].state = nodes[0].state  # one blackboard
    for node in (*nodes, *nodes):
        assert node.execute() is Status.RUNNING
    (question,) = to.now.display.questions
    says(to, OperatorOrder("answer", "g0", question.number))
    for node in nodes[::-1] if answered else nodes:
        assert node.execute() is Status.RUNNING
    for node in nodes:
        node.plan.entry.value = SURE
        node.execute()
    assert [node.status for node in nodes] == [Status.SUCCESS, Status.SUCCESS]
    assert to.now.display.questions == ()
    assert to.memory.questions == 1


def test_the_other_branch_asks_on_where_the_one_that_asked_is_halted() -> None:
    to = services()
    says(to)
    nodes = [which_goal(to, DOUBTFUL), which_goal(to, DOUBTFUL)]
    for node in nodes:
        node.execute()
    nodes[0].halt()
    assert not to.now.display.questions
    assert nodes[1].execute() is Status.RUNNING
    assert [question.kind for question in to.now.display.questions] == ["goal"]


def test_where_nothing_is_doubtful_or_nobody_is_there_it_fails_at_once() -> None:
    to = services()
    says(to)
    assert which_goal(to, SURE).execute() is Status.FAILURE
    to = services()
    assert which_goal(to, DOUBTFUL).execute() is Status.FAILURE
    assert to.now.display.questions == ()


def test_where_the_tree_says_so_it_asks_though_nobody_is_known_to_be_there() -> None:
    to = services()
    node = which_goal(to, DOUBTFUL)
    node.unattended.entry.value = True
    assert node.execute() is Status.RUNNING
    assert [question.kind for question in to.now.display.questions] == ["goal"]


def test_an_operator_corrects_the_goal_once() -> None:
    to = services()
    node: Any = alone(HearOperator("hear"), to, state=AssemblyState({}))
    assert node.execute() is Status.SUCCESS
    assert node.state.get().told_goal is None
    says(to, OperatorOrder("goal", "g1", time_s=3.0))
    node.execute()
    assert node.state.get().told_goal == "g1"
    node.state.set(AssemblyState({}))
    node.execute()
    assert node.state.get().told_goal is None


def test_what_it_was_taken_for_can_be_denied_and_is_not_resumed() -> None:
    to = services()
    hears: Any = alone(HearOperator("hear"), to, state=AssemblyState({"p6": "o3"}, told_goal="g0"))
    says(to, OperatorOrder("other", "g0", time_s=3.0))
    assert hears.execute() is Status.SUCCESS
    state = hears.state.get()
    assert (state.told_goal, state.denied) == (None, ("g0",))
    taken = replace(DOUBTFUL, goal_belief={"g0": 0.9, "g1": 0.05, "g2": 0.0, UNKNOWN_GOAL: 0.05})
    assert taken.after_reactions(to.tools.product, state).goal_belief["g0"] < 0.1
    assert to.tools.guard.asks_for_goal(taken, state)
    node: Any = alone(AskWhichGoal("goal"), to, plan=taken, state=state)
    assert node.execute() is Status.RUNNING
    assert to.now.display.questions[0].reason == "you said that it is not what I took it for"
    hears.execute()
    assert hears.state.get().denied == ("g0",), "each statement counts once"
    assert hears.state.get().with_goal("g0").denied == (), "what is said later counts more"


def test_nothing_new_begins_while_paused() -> None:
    to = services()
    node: Any = alone(WaitWhilePaused("pause"), to)
    says(to, pause="after part")
    assert node.execute() is Status.RUNNING
    says(to)
    assert node.execute() is Status.SUCCESS
