"""A product with a fourth part type, of another shape and colour: one command trains detectors that know it."""

from __future__ import annotations

from pathlib import Path

import pytest
import yaml

from bracket_cell.commands.main import main
from bracket_cell.configuration import load_configuration, load_product
from bracket_cell.wiring.detectors import detectors_for
from bracket_ground.files.files import shipped

pytestmark = pytest.mark.slow  # torch is only in the processes that it starts
ELBOW = {
    "title": "pipe elbow",
    "quantity": 1,
    "size_m": [0.056, 0.040, 0.034],
    "peg_diameter_m": 0.022,
    "peg_length_m": 0.012,
    "colour_rgb": [0.85, 0.45, 0.05],
    "mass_kg": 0.12,
    "shape": [
        {"solid": "cylinder", "size_m": [0.056, 0.024, 0.024], "centre_m": [0.0, 0.0, 0.012], "axis": "x"},
        {"solid": "box", "size_m": [0.006, 0.040, 0.030], "centre_m": [0.025, 0.0, 0.015]},
        {"solid": "cylinder", "size_m": [0.022, 0.022, 0.034], "centre_m": [-0.012, 0.0, 0.017]},
    ],
}


def cell_with_an_elbow(folder: Path) -> Path:
    """Files of a cell whose product has an elbow in the place of one gate valve; returns the configuration's."""
    products, cell = (
        yaml.safe_load(shipped("bracket_cell.config", name).read_text()) for name in ("products.yaml", "cell.yaml")
    )
    products["parts"]["o1"]["quantity"] = 2
    products["parts"]["elbow"] = ELBOW
    products["goals"] = {"g0": ["o1", "elbow", "o1", "o2", "o2", "o3"], "g1": ["o2", "o1", "o2", "o1", "o3", "elbow"]}
    cell["bench"]["bins_m"]["elbow"] = [1.02, -0.28, 0.004]
    cell["planners"]["semantic"]["kind"] = "bayes"
    sim = yaml.safe_load(shipped("bracket_cell.config", "sim.yaml").read_text())
    for name, content in (("products.yaml", products), ("sim.yaml", sim), ("cell.yaml", cell)):
        (folder / name).write_text(yaml.safe_dump(content, sort_keys=False))
    return folder / "cell.yaml"


def test_one_command_trains_what_knows_a_fourth_part_type(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    config, out = cell_with_an_elbow(tmp_path), tmp_path / "trained"
    before = load_configuration(config)
    product = load_product(before, config)
    assert detectors_for(before.perception, product)[0].kind == "classical"
    words = ["train", "--config", str(config), "--out", str(out), "--budget", "40s"]
    detectors = [word for name in ("hands", "actions", "holes", "parts") for word in ("--only", name)]
    assert main([*words, *detectors]) == 0
    line = next(line for line in capsys.readouterr().err.splitlines() if line.startswith("perception:"))
    config.write_text(yaml.safe_dump(yaml.safe_load(config.read_text()) | yaml.safe_load(line), sort_keys=False))
    after = load_configuration(config)
    assert detectors_for(after.perception, product) == (after.perception, "")
