"""Semantic planners as the controller sees them: exact posterior, shipped weights, relabelling, bad files."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import permutations
from pathlib import Path

import numpy as np
import onnx
import pytest
from onnx import numpy_helper

from bracket_cell.learned.inference.onnx_model import OnnxModel, save_onnx
from bracket_cell.learned.semantic.graph import Ints, Layout, one_hot
from bracket_cell.learned.semantic.posterior import BayesPosterior, Noise
from bracket_ground.errors import ModelError
from bracket_ground.interfaces.planning import UNKNOWN_GOAL, AssemblyState, SemanticPlanner
from bracket_ground.interfaces.product import Product
from bracket_lab.learned.semantic.evaluate import evaluate_semantic
from bracket_lab.learned.semantic.misdetection import misdetect
from bracket_lab.learned.semantic.paper_planner import load_semantic_planner
from bracket_lab.learned.semantic.scenarios import consistent, scenarios
from tests.learned.products import DEFAULT, HARDER, relabelled, with_goals

WEIGHTS = Path("learned/weights")
LAYOUT = Layout.of(DEFAULT)
STATES = [LAYOUT.state(row) for row in scenarios(LAYOUT, 0).seen]
KINDS = ("paper", "factored", "bayes")


def shipped(kind: str) -> SemanticPlanner:
    return load_semantic_planner(kind, WEIGHTS / f"semantic_{kind}.onnx", DEFAULT)


def ways(types: Ints, seen: list[tuple[int, int]], noise: Noise) -> Iterator[tuple[set[int], float]]:
    """Every choice and order of slots that the reports may stem from: the positions filled, and its probability."""
    slots = [(int(part), position) for position, part in enumerate(types)]
    wrong = noise.wrong[len(seen)]
    right = wrong + noise.excess[len(seen)]
    for chosen in permutations(slots, len(seen)):
        share = np.prod([right if slot == report else wrong for slot, report in zip(chosen, seen, strict=True)])
        yield {position for _, position in chosen}, float(share)


def test_the_posterior_is_that_of_listing_all_ways() -> None:
    small = with_goals("111223", "211312")
    layout = Layout.of(small)
    noise = Noise.of(layout, 0.1)
    goals = {tuple(row) for row in layout.types.tolist()}
    others = [types for types in set(permutations([0, 0, 0, 1, 1, 2])) if types not in goals]
    builds = [(np.array(types), 0.4) for types in layout.types] + [(np.array(t), 0.2 / len(others)) for t in others]
    for seen in ([(0, 0)], [(2, 3)], [(0, 1), (1, 0)], [(2, 0), (2, 1), (1, 2)], [(0, 0), (0, 1), (0, 2), (0, 3)]):
        edges = np.zeros((3, 6), np.float32)
        edges[tuple(zip(*seen, strict=True))] = 1.0
        joint, placements = [], np.zeros((3, 6))
        for types, prior in builds:
            all_ways = list(ways(types, seen, noise))
            joint.append(prior * sum(share for _, share in all_ways))
            for filled, share in all_ways:
                still = [i for i in range(6) if i not in filled and not edges[:, i].any()]
                placements[types[still], still] += prior * share
        joint = [*joint[:2], sum(joint[2:])]
        found = BayesPosterior(layout, error=0.1, unknown=0.2)(edges)
        assert np.allclose(found.belief, np.array(joint) / sum(joint))
        assert np.allclose(found.placements, placements / np.maximum(placements.sum(axis=0), 1e-12))


def test_no_unknown_goal_is_left_where_all_arrangements_are_goals() -> None:
    parts = {name: {**DEFAULT.parts[name].model_dump(), "quantity": 1} for name in ("o1", "o2")}
    bracket = {**DEFAULT.bracket.model_dump(), "holes_m": {"p1": (0.0, 0.0), "p2": (0.0, 0.1)}}
    goals = {"ahead": ("o1", "o2"), "back": ("o2", "o1")}
    both = Product.model_validate(
        {**DEFAULT.model_dump(), "parts": parts, "bracket": bracket, "goals": goals, "goal_titles": {}}
    )
    assert load_semantic_planner("bayes", None, both).plan(AssemblyState({})).goal_belief[UNKNOWN_GOAL] == 0.0


@pytest.mark.parametrize("kind", KINDS)
def test_answers_are_plans_for_what_is_open(kind: str) -> None:
    planner = shipped(kind)
    for state in [AssemblyState({}), *STATES]:
        plan = planner.plan(state)
        assert np.isclose(sum(plan.goal_belief.values()), 1.0)
        open_positions = set(DEFAULT.positions) - set(state.placed)
        assert {position for _, position in plan.next_belief} <= open_positions
        assert sum(plan.next_belief.values()) <= len(open_positions) + 1e-5
        assert plan.next_part in DEFAULT.parts
        assert set(plan.guidance) == set(DEFAULT.parts)


@pytest.mark.parametrize("kind", KINDS)
def test_nothing_remains_of_a_finished_product(kind: str) -> None:
    for goal in DEFAULT.goals:
        plan = shipped(kind).plan(AssemblyState(DEFAULT.goal_placements(goal)))
        assert plan.next_part is None
        assert not plan.next_belief
        assert plan.goal == goal


@pytest.mark.parametrize("kind", KINDS)
def test_noise_breaks_no_planner(kind: str) -> None:
    planner = shipped(kind)
    for row in misdetect(LAYOUT, scenarios(LAYOUT, 0), np.random.default_rng(0), 0.5).seen:
        assert np.isclose(sum(planner.plan(LAYOUT.state(row)).goal_belief.values()), 1.0)


@pytest.mark.parametrize("kind", ["factored", "bayes"])
def test_some_type_is_right_for_every_open_position(kind: str) -> None:
    for state in STATES:
        plan = shipped(kind).plan(state)
        for position in set(DEFAULT.positions) - set(state.placed):
            assert np.isclose(sum(plan.next_belief.get((part, position), 0.0) for part in DEFAULT.parts), 1.0)


def test_relabelling_parts_and_positions_changes_no_answer_of_the_reference() -> None:
    there = load_semantic_planner("bayes", None, relabelled(DEFAULT, [2, 0, 1], [3, 5, 0, 1, 4, 2]))
    here = shipped("bayes")
    for state in STATES:
        one, other = here.plan(state), there.plan(state)
        assert np.allclose([one.goal_belief[goal] for goal in other.goal_belief], list(other.goal_belief.values()))
        assert one.next_belief.keys() == other.next_belief.keys()
        if one.goal == other.goal:
            assert {part: set(there) for part, there in one.guidance.items()} == {
                part: set(there) for part, there in other.guidance.items()
            }


@pytest.mark.parametrize("kind", KINDS)
def test_clean_unambiguous_states_get_the_right_plan(kind: str) -> None:
    """What the README says of the shipped weights: all scenarios that one goal fits are solved, held out or not."""
    scores = evaluate_semantic(shipped(kind), DEFAULT, 1)
    assert scores["unique_success_all"] == 1.0
    assert scores["unique_success_held_out"] == 1.0
    assert scores["consistent_success_all"] == 1.0
    assert np.isclose(scores["success_all"], 183 / 186)
    assert scores["noisy_goal_accuracy_5"] >= 0.985
    assert scores["wrong_at_0.9"] <= 0.01


@pytest.mark.parametrize("kind", ["paper", "factored"])
def test_the_card_holds_the_scores_that_evaluation_finds(kind: str) -> None:
    card = OnnxModel.load(WEIGHTS / f"semantic_{kind}.onnx", f"semantic.{kind}").card
    scores = evaluate_semantic(shipped(kind), DEFAULT, card.seed)
    assert scores.keys() >= card.scores.keys()
    assert np.allclose([scores[name] for name in card.scores], list(card.scores.values()), atol=0.01)
    assert card.data_sha256 == scenarios(LAYOUT, card.seed).sha256


@pytest.mark.parametrize("kind", ["factored", "bayes"])
def test_a_goal_never_demonstrated_is_told_from_the_others(kind: str) -> None:
    planner = shipped(kind)
    strange = AssemblyState({"p1": "o3", "p2": "o2", "p3": "o1", "p4": "o2"})
    assert planner.plan(strange).goal == UNKNOWN_GOAL
    usual = AssemblyState({"p1": "o1", "p2": "o2", "p3": "o3", "p4": "o1"})
    assert planner.plan(usual).goal_belief[UNKNOWN_GOAL] < 0.02


def test_shipped_weights_fit_the_default_product_only() -> None:
    for kind in ("paper", "factored"):
        with pytest.raises(ModelError, match=r"g1: o2 o1 o2 o1 o3 o1.*g1: o1 o1 o2 o1 o3 o2"):
            load_semantic_planner(kind, WEIGHTS / f"semantic_{kind}.onnx", HARDER)


def test_weights_of_another_kind_are_refused() -> None:
    with pytest.raises(ModelError, match=r"'semantic\.paper'.*'semantic\.factored'"):
        load_semantic_planner("factored", WEIGHTS / "semantic_paper.onnx", DEFAULT)


def test_a_network_that_went_wrong_raises_instead_of_answering(tmp_path: Path) -> None:
    for kind in ("paper", "factored"):
        path = WEIGHTS / f"semantic_{kind}.onnx"
        model = onnx.load(path)
        for weights in model.graph.initializer:
            values = numpy_helper.to_array(weights)
            if np.issubdtype(values.dtype, np.floating):
                weights.CopyFrom(numpy_helper.from_array(np.full_like(values, np.nan), weights.name))
        broken = tmp_path / path.name
        save_onnx(model, broken, OnnxModel.load(path, f"semantic.{kind}").card)
        with pytest.raises(ModelError, match="not finite"):
            load_semantic_planner(kind, broken, DEFAULT).plan(AssemblyState({"p1": "o1"}))


def test_a_state_in_words_of_another_product() -> None:
    for state in ({"p9": "o1"}, {"p1": "o9"}):
        with pytest.raises(ModelError, match=r"parts: o1, o2, o3; positions: p1, p2"):
            shipped("factored").plan(AssemblyState(state))


def test_one_hot_edges_and_label_sets_agree() -> None:
    seen = scenarios(LAYOUT, 0).seen
    agreeing = np.einsum("bop,gop->bg", one_hot(seen, 3), LAYOUT.wanted)
    assert ((agreeing == (seen >= 0).sum(axis=1)[:, None]) == consistent(LAYOUT, seen)).all()


def test_shipped_weights_are_small() -> None:
    assert sum(path.stat().st_size for path in WEIGHTS.glob("semantic_*.onnx")) < 1_000_000
