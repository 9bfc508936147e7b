"""Reaches are counted and told by what they are for; a log tells the same as the truth it was made from."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from bracket_cell.commands.main import main
from bracket_cell.configuration import load_configuration, load_product, simulated
from bracket_ground.errors import InputError
from bracket_ground.interfaces.perception import Action, BenchView
from bracket_lab.drawing.recording import record
from bracket_lab.evaluations.reaches import ABOVE_M, BEHIND_M, HandWay, ergonomics, summary
from bracket_sim.scene.settings import settings_of
from tests import ROOT

CONFIGURATION = simulated(load_configuration(), "nominal", "careful")
BENCH, PRODUCT = CONFIGURATION.bench, load_product(CONFIGURATION)
REST = np.array(BENCH.hand_rest_m)
RATE_HZ = 15


def way(*stops: tuple[float, float, float], rests_s: float = 0.6) -> HandWay:
    """A palm that goes from stop to stop in half a second each, fingertips where it is."""
    palm: list[np.ndarray] = []
    for here, there in zip(stops, stops[1:] + stops[-1:], strict=True):
        palm += [np.array(here)] * round(rests_s * RATE_HZ)
        palm += [np.array(here) + (np.array(there) - here) * share for share in np.linspace(0, 1, RATE_HZ // 2)]
    return HandWay(np.arange(len(palm)) / RATE_HZ, np.array(palm), np.array(palm)[:, :2])


def test_reaches_are_counted_by_what_they_are_for() -> None:
    hole = tuple(BENCH.bracket.pose.transform(np.array([[*PRODUCT.bracket.holes_m["p1"], 0.05]]))[0])
    found = ergonomics(way(tuple(REST), BENCH.bins_m["o1"], hole, tuple(REST)), BENCH, PRODUCT)
    assert found["places"] == {"bin of o1": 1, "bracket": 1, "rest": 1}
    assert found["reaches"] == 3
    shoulder = REST + np.array([BEHIND_M, 0, ABOVE_M - REST[2]])
    assert found["farthest_m"] == pytest.approx(np.linalg.norm(np.array(hole) - shoulder), abs=0.001)
    assert found["above_shoulder"] == 0


def test_a_hand_that_trembles_or_shifts_a_little_reaches_for_nothing() -> None:
    near = tuple(REST + np.array([0.05, 0.05, 0]))
    assert ergonomics(way(tuple(REST), near, tuple(REST), near), BENCH, PRODUCT)["reaches"] == 0


def test_a_short_stop_on_the_way_is_one_reach() -> None:
    on_the_way = tuple((REST + BENCH.bins_m["o3"]) / 2)
    assert len(way(tuple(REST), on_the_way, BENCH.bins_m["o3"], rests_s=0.05).reaches()) == 1


def test_a_hand_above_the_shoulder_counts_by_its_time() -> None:
    high = (REST[0], REST[1], ABOVE_M + 0.2)
    assert 0.3 < ergonomics(way(tuple(REST), high), BENCH, PRODUCT)["above_shoulder"] < 0.7


def test_without_a_hand_of_known_height_nothing_is_told() -> None:
    with pytest.raises(InputError, match="no hand of known height was seen"):
        HandWay.of_views([BenchView(0, 0.0, None, {}, Action("idle", 1.0))])


def test_a_person_alone_reaches_for_each_part_and_for_each_hole() -> None:
    assembly = record(PRODUCT, BENCH, settings_of(CONFIGURATION.devices.simulation), 992_100)
    found = ergonomics(HandWay.of_recording(assembly), BENCH, PRODUCT)
    places = found["places"]
    assert sum(count for name, count in places.items() if name.startswith("bin")) >= 6
    assert places["bracket"] >= 6
    assert 0.4 < found["farthest_m"] < 1.2


def test_a_log_tells_its_reaches(capsys: pytest.CaptureFixture[str]) -> None:
    log = ROOT / "tests" / "cases" / "assembly-g0-seed5.mcap"
    assert main(["lab", "reaches", str(log), "--json"]) == 0
    found = json.loads(capsys.readouterr().out.splitlines()[-1])
    assert found["log"] == str(log)
    assert found["places"]["bracket"] >= 3  # of what the person placed
    assert main(["lab", "reaches", str(Path(log).with_name("none.mcap"))]) == 2


def test_what_the_robot_spares_has_its_interval() -> None:
    one = {"time_s": 40.0, "reaches": 14, "reach_m": 0.5, "farthest_m": 0.8, "way_m": 9.0, "above_shoulder": 0.0}
    rows = [
        {"alone": {**one, "places": {"rest": 2}}, "beside": {**one, "reaches": count, "places": {"rest": 1}}}
        for count in (8, 10)
    ]
    found = summary(rows)
    assert (found["n"], found["reaches_alone"], found["reaches_beside"], found["reaches_spared"]) == (2, 14, 9, 5)
    assert found["reaches_spared_low"] < 5 < found["reaches_spared_high"]
    assert found["places_alone"] == {"rest": 4}
