"""The AND/OR graph: what it knows, what it does not, and its file."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from cell.errors import ModelError
from cell.interfaces.planning import UNKNOWN_GOAL, AssemblyState
from learned.inference.onnx_model import ModelCard
from learned.semantic.and_or import AndOrGraph
from learned.semantic.graph import EMPTY, Layout
from learned.semantic.model import AndOrPlanner, load_semantic_planner
from learned.semantic.scenarios import Scenarios, consistent, scenarios, split, sub_demonstrations
from tests.learned.products import DEFAULT, HARDER

LAYOUT = Layout.of(DEFAULT)
WHOLE = scenarios(LAYOUT, 0)
CARD = ModelCard(kind="semantic.and_or", vocabulary=LAYOUT.vocabulary, data_sha256="", command="", seed=0)


def planner(train: Scenarios) -> AndOrPlanner:
    return AndOrPlanner(DEFAULT, AndOrGraph.of(LAYOUT, train, CARD))


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
    few, many = (AndOrGraph.of(LAYOUT, some, CARD).nodes for some in (train, sub_demonstrations(LAYOUT, train)))
    assert few.keys() < many.keys()


def test_an_arc_leads_to_a_state_of_the_same_goals() -> None:
    graph = AndOrGraph.of(LAYOUT, WHOLE, CARD)
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


def test_the_file_is_the_graph(tmp_path: Path) -> None:
    graph = AndOrGraph.of(LAYOUT, WHOLE, CARD)
    path = tmp_path / "graph.json"
    graph.save(path)
    assert AndOrGraph.load(path, LAYOUT).nodes == graph.nodes
    plan = load_semantic_planner("and_or", path, DEFAULT).plan(AssemblyState({"p6": "o3"}))
    assert plan.goal == "g0"


def test_files_that_are_no_graph_of_this_product(tmp_path: Path) -> None:
    path = tmp_path / "graph.json"
    with pytest.raises(ModelError, match=r"graph\.json: cannot read the graph"):
        AndOrGraph.load(path, LAYOUT)
    path.write_text("{}")
    with pytest.raises(ModelError, match=r"graph\.json: no AND/OR graph, or damaged"):
        AndOrGraph.load(path, LAYOUT)
    AndOrGraph.of(LAYOUT, WHOLE, CARD).save(path)
    with pytest.raises(ModelError, match="trained for goals"):
        AndOrGraph.load(path, Layout.of(HARDER))
    AndOrGraph.of(LAYOUT, WHOLE, CARD.model_copy(update={"kind": "semantic.paper"})).save(path)
    with pytest.raises(ModelError, match=r"holds a 'semantic\.paper' model"):
        AndOrGraph.load(path, LAYOUT)
