"""When a bracket is finished, and that nobody waits for that in silence."""

from __future__ import annotations

from dataclasses import replace

import pytest

from bracket_cell.trees.nodes.people import AssemblyFinished
from bracket_cell.trees.nodes.services import Services
from bracket_cell.trees.nodes.watching import SeenAction
from bracket_ground.interfaces.perception import Action, HandSample, HoleView
from bracket_ground.interfaces.planning import UNKNOWN_GOAL, AssemblyState
from btxml.engine.status import Status
from tests.trees.nodes.rig import EMPTY_HOLES, IDLE, PRODUCT, SURE, ScriptedPlanner, hand_at, see, services

PLACED = Action("assembly", 0.9, "o1", "p2", finished=True)
TRANSIT = Action("transit", 0.6)
FULL = AssemblyState(dict.fromkeys(PRODUCT.positions, "o1"))
FILLED = {position: HoleView("o1", 1.0, 0.0) for position in PRODUCT.positions}
AT_REST, OVER_A_HOLE = hand_at(1.1, 0.45), hand_at(0.72, 0.2)


def ending(at: Services, state: AssemblyState = FULL) -> AssemblyFinished:
    node = AssemblyFinished("finished")
    node.setup(services=at)
    for port, value in (("state", state), ("away_m", 0.2), ("beside_m", 0.1), ("away_s", 8.0), ("looks_s", 2.0)):
        getattr(node, port).entry.value = value
    return node


def ticked(node: AssemblyFinished, time_s: float, action: Action, hand: HandSample | None, **seen: object) -> Status:
    see(node.services, time_s, **{"holes": FILLED, "hand": hand, "action": action, **seen})
    node.action.entry.value = SeenAction(action, 0.0)  # type: ignore[union-attr]
    return node.update()


def test_finished_means_all_filled_seen_and_the_hand_gone() -> None:
    cases = (
        (FULL, FILLED, IDLE, Status.SUCCESS),
        (AssemblyState({"p1": "o1"}), FILLED, IDLE, Status.FAILURE),
        (FULL, EMPTY_HOLES, IDLE, Status.FAILURE),
        (FULL, FILLED, PLACED, Status.FAILURE),
    )
    for state, holes, action, expected in cases:
        assert ticked(ending(services(), state), 1.0, action, AT_REST, holes=holes) is expected


def test_a_hand_that_stays_away_from_the_bracket_has_left_whatever_it_is_said_to_do() -> None:
    """An action detector that never says "idle" kept a bracket that was right for 240 s, until the time was up."""
    node = ending(services())
    for hand in (AT_REST, None):
        assert ticked(node, 1.0, TRANSIT, OVER_A_HOLE) is Status.FAILURE
        answers = [ticked(node, time_s, TRANSIT, hand) for time_s in (2.0, 9.0, 10.0)]
        assert answers == [Status.FAILURE, Status.FAILURE, Status.SUCCESS]


def test_a_hand_that_lies_still_beside_the_bracket_has_left_and_one_that_works_there_has_not() -> None:
    """Who leans in rests a hand near the holes: a bracket that was right waited for it until the time was up."""
    beside = replace(OVER_A_HOLE, palm_m=(OVER_A_HOLE.palm_m[0], 0.36), fingertips_m=(OVER_A_HOLE.palm_m[0], 0.33))
    for hand, speed_m_s, end in (
        (beside, 0.01, Status.SUCCESS),
        (beside, 0.2, Status.FAILURE),
        (beside, None, Status.FAILURE),
        (OVER_A_HOLE, 0.01, Status.FAILURE),
    ):
        node, seen = ending(services()), replace(hand, velocity_m_s=None if speed_m_s is None else (speed_m_s, 0.0))
        assert [ticked(node, time_s, TRANSIT, seen) for time_s in (1.0, 8.0, 9.5)][-1] is end


def test_a_hand_over_the_bracket_or_nobody_knows_where_is_waited_for_and_the_person_is_told() -> None:
    for hand, unknown in ((OVER_A_HOLE, ""), (AT_REST, "it vanished"), (None, "it vanished")):
        at = services()
        node = ending(at)
        for time_s in (1.0, 3.0, 30.0):
            assert ticked(node, time_s, TRANSIT, hand, hand_unknown=unknown) is Status.FAILURE
            assert at.now.display.message == ("waiting: the hand still moves" if time_s > 4.0 else "")


def test_a_hole_that_is_not_seen_filled_is_told_and_counts_once_nobody_could_make_it_visible() -> None:
    at = services()
    node = ending(at)
    holes = {**FILLED, "p4": EMPTY_HOLES["p4"]}
    for time_s in (1.0, 5.0):
        assert ticked(node, time_s, IDLE, AT_REST, holes=holes) is Status.FAILURE
    assert at.now.display.message == "waiting: not yet seen filled: p4"
    node.state.entry.value = AssemblyState(FULL.placed, kept={"p4": None})  # type: ignore[union-attr]
    assert ticked(node, 6.0, IDLE, AT_REST, holes=holes) is Status.SUCCESS


@pytest.mark.parametrize(
    ("unlisted", "robots", "told", "waits"),
    [(0.02, "p6", None, True), (0.001, "p6", None, False), (0.02, "p1", None, False), (0.02, "p6", "g0", False)],
)
def test_who_may_build_what_nobody_listed_has_time_to_take_out_the_last_part(
    unlisted: float, robots: str, told: str | None, waits: bool
) -> None:
    at = services()
    belief = {**dict.fromkeys(PRODUCT.goals, 0.0), "g0": 1 - unlisted, UNKNOWN_GOAL: unlisted}
    at.tools = replace(
        at.tools, semantic=ScriptedPlanner(replace(SURE, goal_belief=belief, guidance={}, next_part=None))
    )
    node = ending(at, replace(FULL, by_robot={robots: "o1"}, told_goal=told))
    ends = [ticked(node, time_s, IDLE, AT_REST) for time_s in (1.0, 2.5, 3.1)]
    assert ends[-1] is Status.SUCCESS
    assert (ends[1] is Status.FAILURE) == waits
