"""The AND/OR graph: what it knows, and what it does not."""

from __future__ import annotations

import numpy as np

from bracket_cell.learned.semantic.graph import EMPTY, Layout
from bracket_cell.learned.semantic.misdetection import Scenarios
from bracket_ground.interfaces.planning import UNKNOWN_GOAL
from bracket_lab.experiments.paper.and_or import AndOrGraph, AndOrPlanner
from bracket_lab.learned.semantic.scenarios import consistent, scenarios, split, sub_demonstrations
from tests.learned.products import DEFAULT

LAYOUT = Layout.of(DEFAULT)
WHOLE = scenarios(LAYOUT, 0)


def planner(train: Scenarios) -> AndOrPlanner:
    return AndOrPlanner(DEFAULT, AndOrGraph.of(LAYOUT, train))


def test_with_all_states_it_believes_in_the_goals_that_fit_and_no_others() -> None:
    found = planner(WHOLE)
    for row, fits in zip(WHOLE.seen, consistent(LAYOUT, WHOLE.seen), strict=True):
        belief = found.plan(LAYOUT.state(row)).goal_belief
        assert [belief[goal] > 0 for goal in LAYOUT.goals] == fits.tolist()
        assert belief[UNKNOWN_GOAL] == 0.0


def test_it_says_so_where_nothing_was_demonstrated() -> None:
    train, held_out = split(WHOLE, 0.5, 0)
    known = {tuple(row) for row in train.seen.tolist()}
    found = planner(train)
    for row in held_out.seen:
        plan = found.plan(LAYOUT.state(row))
        if tuple(row.tolist()) in known:
            assert plan.goal != UNKNOWN_GOAL
        else:
            assert plan.goal == UNKNOWN_GOAL
            assert plan.next_part is None
            assert not plan.next_belief
            assert not any(plan.guidance.values())


def test_sub_demonstrations_add_the_states_on_the_way() -> None:
    train, _ = split(WHOLE, 0.5, 0)
    few, many = (AndOrGraph.of(LAYOUT, some).nodes for some in (train, sub_demonstrations(LAYOUT, train)))
    assert few.keys() < many.keys()


def test_an_arc_leads_to_a_state_of_the_same_goals() -> None:
    graph = AndOrGraph.of(LAYOUT, WHOLE)
    arcs = 0
    for state, node in graph.nodes.items():
        for position in np.flatnonzero(node.arcs):
            assert state[position] == EMPTY
            reached = [list(state) for _ in LAYOUT.goals]
            for goal, after in enumerate(reached):
                after[position] = int(LAYOUT.types[goal, position])
            assert any(tuple(after) in graph.nodes for after in reached)
            arcs += 1
    assert arcs > 100
