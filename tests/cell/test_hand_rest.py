"""Advice on where the person's hand rests: told where it is in the arm's way, and nowhere else."""

from __future__ import annotations

import re

import pytest

from bracket_cell.runs.bench_view import BenchView
from bracket_cell.skills.motion.planner import MotionPlanner
from bracket_ground.files.units import Point
from bracket_ground.interfaces.bench import Obstacle
from tests.integration.cell_rig import BENCH, PRODUCT, motion_planner

IN_THE_WAY = (0.95, 0.24, 0.1)


def advice(rest_m: Point, *obstacles: Obstacle) -> str:
    bench = BENCH.model_copy(update={"hand_rest_m": rest_m, "obstacles": obstacles})
    return BenchView(bench, PRODUCT, MotionPlanner(PRODUCT, bench, motion_planner().settings)).rest_advice


def test_a_hand_in_the_arms_way_is_told_where_it_would_better_rest() -> None:
    told = advice(IN_THE_WAY)
    found = re.fullmatch(r"a hand that rests at \[(.+)\] spares (\d\.\d) s of each part: bench.hand_rest_m", told)
    assert found, told
    x, _, z = (float(value) for value in found[1].split(", "))
    assert x > 0.95, "farther back, towards the person"
    assert z == 0.1
    assert float(found[2]) >= 0.5, "it lay over the way from the tray to the bracket"


def test_nobody_is_told_to_rest_a_hand_in_a_post() -> None:
    place = x, y, z = re.findall(r"[\d.]+", advice(IN_THE_WAY))[:3]
    post = Obstacle(name="the post", position_m=(float(x), float(y), float(z)), cylinder_m=(0.05, 0.4))
    assert re.findall(r"[\d.]+", advice(IN_THE_WAY, post))[:3] != place


def cost_s(bracket_y_m: float) -> float:
    """Of a part's ways, as they are told, with the bracket elsewhere."""
    x, _, z = BENCH.bracket.position_m
    bracket = BENCH.bracket.model_copy(update={"position_m": (x, bracket_y_m, z)})
    bench = BENCH.model_copy(update={"bracket": bracket})
    told = " ".join(BenchView(bench, PRODUCT, MotionPlanner(PRODUCT, bench, motion_planner().settings)).remarks)
    whole, *legs = map(float, re.findall(r"[\d.]+(?= s)", told[told.index("a part costs") :])[:4])
    assert whole == pytest.approx(sum(legs), abs=0.11)
    return whole


def test_a_bracket_far_from_the_tray_costs_more_of_each_part() -> None:
    assert cost_s(0.4) > cost_s(0.0) + 0.3


def test_a_hand_far_from_the_arms_ways_is_told_nothing() -> None:
    assert not advice((1.12, 0.9, 0.1))
