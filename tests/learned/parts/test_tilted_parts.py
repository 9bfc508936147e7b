"""Tilted parts touch the tray at their lowest point, and a detector is asked what it makes of them."""

from __future__ import annotations

import json
import math

import numpy as np
import pytest

from bracket_cell.commands.main import main
from bracket_cell.learned.parts.maps import surface_of
from bracket_lab.evaluations.holes_and_parts import Task, score_tilted, tilted
from tests.learned.classical.scenes import BENCH, CONFIGURATION, PRODUCT


@pytest.mark.parametrize("tilt_deg", [0, 17, 60, 90, 180])
def test_parts_are_tilted_by_as_much_as_asked_and_touch_the_tray(tilt_deg: float) -> None:
    drawn = list(tilted(PRODUCT, BENCH, math.radians(tilt_deg), np.random.default_rng(5)))
    assert sorted(name for name, _ in drawn) == sorted(PRODUCT.parts)
    for name, pose in drawn:
        assert pose.rotation[2, 2] == pytest.approx(math.cos(math.radians(tilt_deg)), abs=1e-9)
        lowest_m = pose.transform(surface_of(PRODUCT.parts[name]))[:, 2].min()
        assert lowest_m == pytest.approx(BENCH.tray.centre_m[2], abs=1e-9)


def test_directions_and_places_differ_from_seed_to_seed() -> None:
    first, second = (list(tilted(PRODUCT, BENCH, 0.5, np.random.default_rng(seed))) for seed in (1, 2))
    assert not any(one == other for one, other in zip(first, second, strict=True))


def test_parts_that_stand_are_found_and_parts_that_lie_do_not_stand() -> None:
    task = Task(CONFIGURATION, PRODUCT, "centre")
    upright, lying = (score_tilted(task, range(993_800, 993_803), tilt) for tilt in (0, 90))
    assert upright["found"]["share"] == upright["stands"]["share"] == 1  # type: ignore[index]
    assert lying["stands"]["share"] < 0.3  # type: ignore[index]
    assert lying["found"]["n"] == 9  # type: ignore[index]


def test_the_command_tells_shares_with_their_intervals(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["lab", "eval", "parts", "--tilt", "30", "--seeds", "993803", "--json"]) == 0
    found = json.loads(capsys.readouterr().out.splitlines()[-1])
    assert found["tilt_deg"] == 30
    assert 0 <= found["found"]["low"] <= found["found"]["share"] <= found["found"]["high"] <= 1
