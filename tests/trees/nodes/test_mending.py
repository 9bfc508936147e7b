"""What looks wrong in the bracket: told after a while, asked again, mended, right as it is, or known to be wrong."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import pytest

from bracket_cell.trees.bench import TreeBench
from bracket_cell.trees.nodes.asking import AskWhichGoal
from bracket_cell.trees.nodes.corrections import (
    AskToMend,
    AwaitContradiction,
    AwaitMisfit,
    AwaitMistake,
    BracketIsRight,
    LeaveMistake,
)
from bracket_cell.trees.nodes.mistakes import Mistake, reason_of
from bracket_cell.trees.nodes.services import Services
from bracket_cell.trees.nodes.watching import ReconcileGraph
from bracket_ground.files.yaml_file import load_yaml
from bracket_ground.interfaces.operator import HELP_GIVEN, IS_RIGHT, OperatorOrder, OperatorState
from bracket_ground.interfaces.perception import HoleView
from bracket_ground.interfaces.planning import UNKNOWN_GOAL, AssemblyPlan, AssemblyState
from bracket_ground.interfaces.product import Product
from btxml.engine.status import Status
from btxml.testing import alone
from tests import ROOT
from tests.trees.nodes.rig import EMPTY_HOLES, PRODUCT, SURE, see, services

G1 = PRODUCT.goal_placements("g1")
P1, P2 = list(G1)[:2]
TOLD = AssemblyState({}, told_goal="g1")
ODD = next(part for part in PRODUCT.parts if part != G1[P2])
WRONG = (Mistake(P2, "wrong", ODD, G1[P2]),)
NO_IDEA = replace(SURE, goal_belief={"g0": 0.2, "g1": 0.2, "g2": 0.1, UNKNOWN_GOAL: 0.5})


def shows(to: Services, time_s: float, parts: Mapping[str, str | None] = {}, upright: bool = True) -> None:
    """A new view, in which these holes hold these parts."""
    seen = {position: HoleView(part, 1.0, time_s, upright) for position, part in {**dict.fromkeys(G1), **parts}.items()}
    see(to, time_s, holes=seen)


def waiting(to: Services, state: AssemblyState = TOLD, plan: AssemblyPlan = SURE) -> Any:
    return alone(AwaitMistake("wait"), to, state=state, plan=plan)


def asking(to: Services, mistakes: tuple[Mistake, ...] = WRONG, **ports: Any) -> Any:
    return alone(AskToMend("ask"), to, mistakes=mistakes, state=TOLD, plan=SURE, **ports)


def says(to: Services, value: str) -> None:
    """The newest question is answered."""
    order = OperatorOrder("answer", value, to.now.display.questions[-1].number)
    to.now.observation = replace(to.now.observation, operator=OperatorState(present=True, said=(order,)))


def told(
    to: Services, node: Any, end_s: float, parts: Mapping[str, str | None], upright: bool = True
) -> tuple[Mistake, ...]:
    """What is told after a view that stays the same for so long."""
    time_s = 0.0
    while time_s < end_s:
        shows(to, time_s, parts, upright)
        if node.execute() is Status.SUCCESS:
            return tuple(node.mistakes.entry.value)
        time_s += 0.5
    return ()


def test_a_wrong_part_is_told_only_when_it_stayed() -> None:
    to = services()
    assert told(to, waiting(to), 5.5, {P2: ODD}) == ()
    assert told(to, waiting(to), 8.0, {P2: ODD}) == WRONG


def test_parts_that_were_swapped_are_told_together() -> None:
    to = services()
    other = next(name for name in G1 if G1[name] != G1[P1])
    found = told(to, waiting(to), 8.0, {P1: G1[other], other: G1[P1]})
    assert {(mistake.position, mistake.kind) for mistake in found} == {(P1, "wrong"), (other, "wrong")}


def test_without_a_known_goal_only_what_a_bracket_cannot_take_is_wrong() -> None:
    to = services()
    unknown = AssemblyState({}, told_goal=UNKNOWN_GOAL)
    part, kind = min(PRODUCT.parts.items(), key=lambda item: item[1].quantity)
    names = list(G1)[: kind.quantity + 1]
    assert told(to, waiting(to, unknown), 8.0, dict.fromkeys(names[:-1], part)) == ()
    found = told(to, waiting(to, unknown), 8.0, dict.fromkeys(names, part))
    assert {(mistake.position, mistake.kind) for mistake in found} == {(name, "surplus") for name in names}
    assert reason_of(PRODUCT, found).endswith(f"hold the {PRODUCT.title(part)}, and a bracket takes 1 of them")
    assert told(to, waiting(to, AssemblyState({}), NO_IDEA), 8.0, {P2: ODD}) == ()


def test_a_part_that_does_not_stand_straight_is_told() -> None:
    to = services()
    assert told(to, waiting(to), 8.0, {P1: G1[P1]}, upright=False) == (Mistake(P1, "crooked", G1[P1]),)


def test_a_hole_that_cannot_be_read_for_long_is_told() -> None:
    to = services()
    node = waiting(to)
    found: tuple[Mistake, ...] = ()
    for time_s in range(60):
        rest = {name: HoleView(None, 1.0, float(time_s)) for name in list(G1)[1:]}
        see(to, float(time_s), holes=rest)
        if node.execute() is Status.SUCCESS:
            found = node.mistakes.entry.value
            break
    assert found == (Mistake(P1, "hidden"),)
    assert 45 <= time_s < 50


def test_a_slot_under_a_part_is_not_missed() -> None:
    layers = load_yaml(ROOT / "config" / "examples" / "layers" / "product.yaml", Product)
    to = services(product=layers)
    for placed, found in (({"p1": "o1"}, True), ({"p1": "o1", "c1": "o2"}, False)):
        node = waiting(to, AssemblyState(placed))
        statuses = []
        for time_s in range(0, 60, 5):
            holes = {name: HoleView(placed.get(name), 1.0, float(time_s)) for name in layers.positions}
            see(to, float(time_s), holes=holes | {"p1": HoleView("o1", 1.0, 0.0)})
            statuses.append(node.execute())
        assert (Status.SUCCESS in statuses) == found


def test_the_question_says_what_is_wrong_where_and_what_to_do() -> None:
    to = services()
    shows(to, 9.0, {P2: ODD})
    node = asking(to)
    assert node.execute() is Status.RUNNING
    (question,) = to.now.display.questions
    wanted = f"{P2} holds the {PRODUCT.title(ODD)}, where this bracket needs the {PRODUCT.title(G1[P2])}"
    assert (question.kind, question.reason, question.todo) == ("mend", wanted, "take it out")
    assert question.positions == (P2,)
    assert [answer.value for answer in question.answers] == [HELP_GIVEN, IS_RIGHT]


@pytest.mark.parametrize("now", [None, G1[P2]])
def test_the_bench_answers(now: str | None) -> None:
    to = services()
    shows(to, 9.0, {P2: ODD})
    node = asking(to)
    node.execute()
    shows(to, 15.0, {P2: now})
    assert node.execute() is Status.SUCCESS
    assert to.now.display.questions == ()


def test_of_two_mistakes_the_question_stands_until_both_are_mended_and_the_next_names_what_is_left() -> None:
    to = services()
    odd = next(part for part in PRODUCT.parts if part != G1[P1])
    both = (Mistake(P1, "wrong", odd, G1[P1]), *WRONG)
    shows(to, 9.0, {P1: odd, P2: ODD})
    node = asking(to, both)
    node.execute()
    shows(to, 12.0, {P2: ODD})
    assert node.execute() is Status.RUNNING
    assert list(to.now.display.questions[0].positions) == [P1, P2]
    says(to, HELP_GIVEN)
    node.execute()
    shows(to, 16.0, {P2: ODD})
    assert node.execute() is Status.FAILURE
    node.execute()
    assert list(to.now.display.questions[0].positions) == [P2]
    shows(to, 20.0)
    assert node.execute() is Status.SUCCESS


def test_who_says_done_without_having_done_it_is_asked_again() -> None:
    to = services()
    shows(to, 9.0, {P2: ODD})
    node = asking(to)
    node.execute()
    says(to, HELP_GIVEN)
    assert node.execute() is Status.RUNNING
    shows(to, 13.0, {P2: ODD})
    assert node.execute() is Status.FAILURE
    assert node.execute() is Status.RUNNING
    (question,) = to.now.display.questions
    assert (question.number, question.tried) == (2, "I asked this before, and it looks the same")
    shows(to, 15.0)
    assert node.execute() is Status.SUCCESS
    shows(to, 99.0, {P2: ODD})
    assert node.execute() is Status.RUNNING
    assert not to.now.display.questions[0].tried, "it was mended in between"


def test_nobody_answers() -> None:
    to = services()
    shows(to, 0.0, {P2: ODD})
    node = asking(to, wait_s=60.0)
    node.execute()
    shows(to, 59.0, {P2: ODD})
    assert node.execute() is Status.RUNNING
    shows(to, 61.0, {P2: ODD})
    assert node.execute() is Status.FAILURE


def test_what_a_person_says_is_right_is_not_asked_again_and_lets_the_bracket_end() -> None:
    to = services()
    shows(to, 9.0, {P2: ODD})
    assert alone(BracketIsRight("right"), to, state=TOLD, plan=SURE).execute() is Status.FAILURE
    node = asking(to)
    node.execute()
    says(to, IS_RIGHT)
    assert node.execute() is Status.SUCCESS
    state = node.state.get()
    assert (state.kept, state.known_wrong) == ({P2: ODD}, {})
    assert told(to, waiting(to, state), 9.0, {P2: ODD}) == ()
    assert alone(BracketIsRight("right"), to, state=state, plan=SURE).execute() is Status.SUCCESS


def test_what_is_said_to_be_right_counts_where_more_parts_stand_than_a_bracket_takes() -> None:
    to = services()
    part = next(name for name, kind in PRODUCT.parts.items() if kind.quantity == 3)
    names = list(G1)[:4]
    state = AssemblyState({}, told_goal=UNKNOWN_GOAL, kept={names[1]: part})
    found = told(to, waiting(to, state), 8.0, dict.fromkeys(names, part))
    assert {(mistake.position, mistake.kind) for mistake in found} == {
        (name, "surplus") for name in names if name != names[1]
    }
    left = replace(state, known_wrong={names[1]: part})
    assert told(to, waiting(to, left), 8.0, dict.fromkeys(names, part)) == (), "it is known which one is too many"


def test_of_parts_that_are_too_many_the_person_may_say_which_one_does_not_belong_there() -> None:
    to = services()
    part = next(name for name, kind in PRODUCT.parts.items() if kind.quantity == 3)
    names, odd = list(G1)[:4], list(G1)[2]
    shows(to, 9.0, dict.fromkeys(names, part))
    new = AssemblyState({}, told_goal=UNKNOWN_GOAL)
    mistakes = tuple(Mistake(name, "surplus", part) for name in names)
    node: Any = alone(AskToMend("ask"), to, mistakes=mistakes, state=new, plan=SURE)
    node.execute()
    (question,) = to.now.display.questions
    assert question.positions == tuple(names)
    assert [answer.value for answer in question.answers] == [HELP_GIVEN, *names, IS_RIGHT]
    says(to, odd)
    assert node.execute() is Status.RUNNING
    (question,) = to.now.display.questions
    assert (question.number, question.positions, question.todo) == (2, (odd,), "take it out")
    assert question.reason == f"{odd} holds the {PRODUCT.title(part)}, which is one too many"
    assert node.execute() is Status.RUNNING, "the first answer is none to the second question"
    shows(to, 15.0, {name: part for name in names if name != odd})
    assert node.execute() is Status.SUCCESS
    assert set(node.state.get().kept) == set(names) - {odd}


def test_what_is_said_to_be_right_rules_out_the_goal_that_has_it_otherwise() -> None:
    to = services()
    shows(to, 9.0, {P2: ODD})
    to.now.observation = replace(to.now.observation, operator=OperatorState(present=True))
    plan = replace(SURE, goal_belief={"g0": 0.04, "g1": 0.94, "g2": 0.0, UNKNOWN_GOAL: 0.02})
    state = AssemblyState({P2: ODD}, kept={P2: ODD})
    assert to.tools.guard.sure_goal(plan, replace(state, kept={})) == "g1"
    assert to.tools.guard.sure_goal(plan, state) is None
    assert to.tools.guard.asks_for_goal(plan, state)
    held = next(iter(plan.next_belief))
    assert to.tools.guard.judge(plan, state, EMPTY_HOLES, *held, True).decision == "ask"
    assert to.tools.guard.sure_goal(plan, replace(state, told_goal="g1")) == "g1", "what is told counts more"


def test_an_order_that_a_person_builds_against_is_asked_about_once_and_nothing_is_placed_twice() -> None:
    """A person who goes on with another goal than was ordered takes the robot's part out again."""
    to = services()
    to.now.observation = replace(to.now.observation, operator=OperatorState(present=True))
    plan = replace(SURE, goal_belief={"g0": 0.0, "g1": 1.0, "g2": 0.0, UNKNOWN_GOAL: 0.0})
    ordered = AssemblyState({P2: G1[P2]}, by_robot={P2: G1[P2]}).with_goal("g1")
    assert not to.tools.guard.asks_for_goal(plan, ordered)
    gone = ordered.seen({})
    assert to.tools.guard.judge(plan, gone, EMPTY_HOLES, G1[P1], P1, True).decision == "ask"
    assert to.tools.guard.sure_goal(plan, gone) is None
    for state, ends in ((ordered, Status.RUNNING), (gone, Status.SUCCESS)):
        contradicted: Any = alone(AwaitContradiction("contradicted"), to, plan=plan, state=state)
        for time_s in (1.0, 4.0):
            see(to, time_s)
            last = contradicted.execute()
        assert last is ends
    to.now.observation = replace(to.now.observation, operator=OperatorState(present=True))
    node: Any = alone(AskWhichGoal("ask"), to, plan=plan, state=gone)
    assert node.execute() is Status.RUNNING
    assert to.now.display.questions[0].reason == "I took this for bracket B, and what I placed was taken out again"
    again = gone.with_goal("g1")
    assert not to.tools.guard.asks_for_goal(plan, again)
    assert to.tools.guard.sure_goal(plan, again) == "g1"
    verdict = to.tools.guard.judge(plan, again, EMPTY_HOLES, G1[P2], P2, True)
    assert (verdict.decision, verdict.reason) == ("wait", f"a person took {G1[P2]} out of {P2}")
    assert not to.tools.guard.asks_for_goal(plan, again.seen({P1: G1[P1]}))


def test_what_the_robot_placed_and_a_person_took_out_rules_out_the_goal_that_has_it() -> None:
    to = services()
    to.now.observation = replace(to.now.observation, operator=OperatorState(present=True))
    plan = replace(SURE, goal_belief={"g0": 0.0, "g1": 1.0, "g2": 0.0, UNKNOWN_GOAL: 0.0})
    state = AssemblyState({P1: G1[P1], P2: G1[P2]}, by_robot={P2: G1[P2]})
    reconcile: Any = alone(ReconcileGraph("reconcile"), to, state=state)
    for time_s in (0.0, 1.0, 2.0):
        shows(to, time_s, {P1: G1[P1]})
        reconcile.execute()
    gone = reconcile.state.get()
    assert (gone.placed, gone.taken_out, gone.by_robot) == ({P1: G1[P1]}, {P2: G1[P2]}, {})
    assert to.tools.guard.sure_goal(plan, state) == "g1"
    assert to.tools.guard.sure_goal(plan, gone) is None
    assert to.tools.guard.fits_none(gone)
    assert to.tools.guard.judge(plan, gone, EMPTY_HOLES, G1[P2], P2, True).decision == "ask"
    node: Any = alone(AskWhichGoal("ask"), to, plan=plan, state=gone)
    assert node.execute() is Status.RUNNING
    assert to.now.display.questions[0].reason == "I took this for bracket B, and what I placed was taken out again"
    for time_s in (3.0, 4.0, 5.0):
        shows(to, time_s, {P1: G1[P1], P2: G1[P2]})
        reconcile.execute()
    assert not reconcile.state.get().taken_out, "it was put back"
    own: Any = alone(ReconcileGraph("reconcile"), to, state=replace(state, by_robot={}))
    for time_s in (6.0, 7.0, 8.0):
        shows(to, time_s, {P1: G1[P1]})
        own.execute()
    assert not own.state.get().taken_out, "people may take back what they placed themselves"


def test_what_nobody_mends_is_known_to_be_wrong() -> None:
    to = services()
    node: Any = alone(LeaveMistake("leave"), to, mistakes=WRONG, state=TOLD)
    assert node.execute() is Status.SUCCESS
    assert node.state.get().known_wrong == {P2: ODD}
    assert told(to, waiting(to, node.state.get()), 9.0, {P2: ODD}) == ()
    other = next(part for part in PRODUCT.parts if part not in (ODD, G1[P2]))
    assert told(to, waiting(to, node.state.get()), 9.0, {P2: other}), "another part there is another mistake"


def test_a_hole_that_nobody_clears_is_not_asked_about_again_and_not_known_to_be_wrong() -> None:
    to = services()
    node: Any = alone(LeaveMistake("leave"), to, mistakes=(Mistake(P1, "hidden"),), state=TOLD)
    assert node.execute() is Status.SUCCESS
    state = node.state.get()
    assert (state.kept, state.known_wrong) == ({P1: None}, {})
    waits = waiting(to, state)
    for time_s in range(60):
        see(to, float(time_s), holes={name: HoleView(None, 1.0, float(time_s)) for name in list(G1)[1:]})
        assert waits.execute() is Status.RUNNING


def test_what_fits_no_product_is_asked_about_where_no_further_part_tells() -> None:
    to = services()
    shows(to, 0.0)
    to.now.observation = replace(to.now.observation, operator=OperatorState(present=True))
    odd = AssemblyState({P1: "o3", P2: "o3"})
    puzzled = replace(SURE, goal_belief={"g0": 0.8, "g1": 0.0, "g2": 0.0, UNKNOWN_GOAL: 0.2}, next_belief={})
    assert to.tools.guard.fits_none(odd)
    assert not to.tools.guard.asks_for_goal(puzzled, odd), "one of them may have been misread"
    assert to.tools.guard.asks_for_goal(puzzled, odd, waited_s=60.0)
    full = AssemblyState({**dict.fromkeys(PRODUCT.positions, "o1"), **odd.placed})
    assert to.tools.guard.asks_for_goal(puzzled, full)
    sure = replace(SURE, goal_belief={"g0": 0.99, "g1": 0.0, "g2": 0.0, UNKNOWN_GOAL: 0.01})
    assert not to.tools.guard.asks_for_goal(sure, AssemblyState({P1: PRODUCT.goal_placements("g0")[P1]}))
    node: Any = alone(AwaitMisfit("misfit"), to, state=odd)
    assert node.execute() is Status.RUNNING
    shows(to, 5.0)
    assert node.execute() is Status.RUNNING
    shows(to, 6.1)
    assert node.execute() is Status.SUCCESS


@pytest.mark.parametrize("present", [False, True])
def test_a_full_bracket_of_no_known_product_is_not_right_before_a_person_says_so(present: bool) -> None:
    to = services()
    see(to, 1.0, holes=EMPTY_HOLES)
    full = AssemblyState(dict(zip(PRODUCT.positions, ("o1", "o1", "o2", "o1", "o2", "o3"), strict=True)))
    right: Any = alone(BracketIsRight("right"), to, state=full, plan=NO_IDEA)
    to.now.observation = replace(to.now.observation, operator=OperatorState(present=present))
    assert right.execute() is Status.FAILURE
    right.state.entry.value = replace(full, told_goal=UNKNOWN_GOAL)
    assert right.execute() is Status.SUCCESS


@pytest.mark.parametrize("tree", ["assemble", "ahead"])
def test_beside_all_else_an_order_that_is_contradicted_is_asked_about(tree: str) -> None:
    answers = {
        "AwaitContradiction": "RRS", "AskWhichGoal": "R", "AssemblyFinished": "F", "GripperIsEmpty": "S",
        "AwaitMistake": "R", "AwaitMisfit": "R", "AwaitLetGo": "R", "WaitForAction": "R", "AskPosition": "R",
        "ChooseSparePart": "R", "HoldsNeededPart": "F",
    }  # fmt: skip
    made = TreeBench(ROOT / "trees" / f"{tree}.xml", answers)
    for _ in range(9):
        made.tick(0.1)
    assert made.started("AskWhichGoal") == 1
