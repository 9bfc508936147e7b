"""`cell lab eval knobs`: one value of the look is turned; what is no knob is said before anything runs."""

from __future__ import annotations

import json
from pathlib import Path

import cv2
import pytest

from bracket_cell.commands.main import main
from bracket_cell.configuration import load_configuration, simulated
from bracket_lab.evaluations.knobs import SCORED, at
from bracket_sim.scene.settings import settings_of

HOLES = ["lab", "eval", "knobs", "holes", "--seeds", "807100:807101"]


@pytest.mark.parametrize("detector", SCORED)
def test_each_knob_that_is_turned_by_default_turns_that_and_nothing_else(detector: str) -> None:
    configuration = simulated(load_configuration(), "nominal", "varied")
    before = settings_of(configuration.devices.simulation)
    for knob, values in SCORED[detector].knobs.items():
        for value in values:
            after = settings_of(at(configuration, knob, value).devices.simulation)
            if knob == "pace":
                assert after.person.pace == (value, value)
                assert after.look == before.look
                continue
            section, name = knob.split(".")
            look = before.look.draw(3)
            changed = getattr(look, section).model_copy(update={name: value})
            assert after.look.draw(3) == look.model_copy(update={section: changed})
            assert after.person == before.person


def test_values_are_scored_once_and_drawn(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out, plot = tmp_path / "rows.jsonl", tmp_path / "plot.png"
    words = [*HOLES, "--out", str(out), "--plot", str(plot), "--json"]
    assert main([*words, "--knob", "camera.noise_levels=2"]) == 0
    first = json.loads(capsys.readouterr().out.splitlines()[-1])["rows"]
    assert main([*words, "--knob", "camera.noise_levels=2", "--knob", "camera.brightness_ev=4"]) == 0
    rows = json.loads(capsys.readouterr().out.splitlines()[-1])["rows"]
    assert rows[0] == first[0]
    assert [(row["knob"], row["value"]) for row in rows] == [
        ("camera.noise_levels", 2),
        ("camera.brightness_ev", 4),
    ]
    assert all(row["low"] <= row["share"] <= row["high"] for row in rows)
    assert rows[0]["share"] > rows[1]["share"]  # four stops too bright: all is white
    assert len(out.read_text().splitlines()) == 3
    drawn = cv2.imread(str(plot))
    assert drawn is not None
    assert drawn.shape[1] > 300


@pytest.mark.slow
def test_hands_are_scored_by_rule_where_that_is_asked_for(capsys: pytest.CaptureFixture[str]) -> None:
    words = ["lab", "eval", "knobs", "hands", "--seeds", "807100:807101", "--no-physics", "--json"]
    assert main([*words, "--knob", "camera.brightness_ev=0"]) == 0
    told = json.loads(capsys.readouterr().out.splitlines()[-1])
    (row,) = told["rows"]
    assert told["physics"] is False
    assert row["n"] > 20
    assert row["share"] > 0.9


@pytest.mark.parametrize(
    ("words", "told"),
    [
        (["lab", "eval", "knobs", "feet"], "legal: actions, hands, holes, parts"),
        ([*HOLES, "--knob", "light.ambiance=1"], "legal: light.ambient, "),
        ([*HOLES, "--knob", "rain=1"], "legal: camera.blue_gain, "),
        ([*HOLES, "--knob", "light.ambient=7"], "less than or equal to 1, not 7"),
        ([*HOLES, "--knob", "light.ambient=dark"], "not 'dark'"),
        ([*HOLES, "--knob", "light.ambient"], "as in --knob light.ambient=0.1,0.5"),
        ([*HOLES, "--knob", "pace=quick"], "pace"),
        ([*HOLES, "--knob", "pace=0"], "pace"),
        ([*HOLES, "--plot", "nowhere/plot.png"], "there is no folder nowhere"),
    ],
)
def test_what_is_no_knob_is_said_at_once(words: list[str], told: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(words) == 2
    assert told in capsys.readouterr().err
