"""Fastenings are noted by the seen action at their slots, or by a tool's report; the guard waits for what precedes."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

from bracket_cell.trees.guard import Guard, GuardSettings
from bracket_cell.trees.nodes.fastening import NoteFastenings
from bracket_cell.trees.nodes.people import hole_on_bench_m
from bracket_ground.interfaces.operator import OperatorOrder, OperatorState
from bracket_ground.interfaces.perception import Action
from bracket_ground.interfaces.planning import AssemblyState
from bracket_ground.interfaces.product import Product
from btxml.testing import alone
from tests.trees.nodes.rig import EMPTY_HOLES, PRODUCT, SURE, hand_at, see, services

FAMILY = Product.model_validate(
    {
        **PRODUCT.model_dump(),
        "fastenings": {"seen": {"at": ["p1"]}, "reported": {"at": ["p2"], "torque_nm": 8.0}},
        "before": [["seen", "p3"], ["reported", "p4"]],
    }
)
SCREW = Action("screw", 0.9)


def noted(placed: dict[str, str], fastened: tuple[str, ...] = ()) -> tuple[Any, Any]:
    at = services(product=FAMILY)
    return at, alone(NoteFastenings("note"), at, state=AssemblyState(placed, fastened=fastened))


def said(at: Any, value: str, time_s: float) -> None:
    operator = OperatorState(said=(OperatorOrder("fastened", value, time_s=time_s),))
    at.now.observation = replace(at.now.observation, operator=operator)


def test_a_screw_at_its_slot_is_a_fastening_and_elsewhere_is_none() -> None:
    at, node = noted({"p1": "o1"})
    away, there = hole_on_bench_m(at, "p5"), hole_on_bench_m(at, "p1")
    see(at, 1.0, action=SCREW, hand=hand_at(float(away[0]), float(away[1])))
    node.update()
    assert node.state.get().fastened == ()
    see(at, 2.0, action=SCREW, hand=hand_at(float(there[0]), float(there[1])))
    node.update()
    assert node.state.get().fastened == ("seen",)


def test_a_tool_reports_with_enough_torque_once_the_part_stands() -> None:
    at, node = noted({"p1": "o1"})
    said(at, "reported 8.1", 1.0)
    see(at, 1.0)
    node.update()
    assert node.state.get().fastened == ()
    node.state.set(AssemblyState({"p1": "o1", "p2": "o2"}))
    node.update()
    assert node.state.get().fastened == ("reported",)
    at, node = noted({"p2": "o2"})
    said(at, "reported 5.0", 1.0)
    see(at, 1.0)
    node.update()
    assert node.state.get().fastened == ()


def test_a_part_that_was_taken_out_is_fastened_no_longer() -> None:
    at, node = noted({}, ("seen",))
    see(at, 1.0)
    node.update()
    assert node.state.get().fastened == ()


def test_the_guard_waits_for_what_comes_before_a_placement() -> None:
    guard, state = Guard(FAMILY, GuardSettings()), AssemblyState({"p1": "o1"})
    verdict = guard.judge(replace(SURE, next_belief={("o1", "p3"): 1.0}), state, EMPTY_HOLES, "o1", "p3", True)
    assert (verdict.decision, str(verdict.reason)) == ("wait", "seen comes before p3")
    after = replace(state, fastened=("seen",))
    verdict = guard.judge(replace(SURE, next_belief={("o1", "p3"): 1.0}), after, EMPTY_HOLES, "o1", "p3", True)
    assert verdict.decision == "act"
