"""The shipped hole reader on rendered stills: what is bare is read, and hardly a filled hole is called empty."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from bracket_cell.configuration import load_configuration, load_product, simulated
from bracket_cell.kinds import WEIGHTS
from bracket_cell.learned.holes.model import KIND, HoleNetwork, Reading
from bracket_cell.learned.inference.onnx_model import OnnxModel
from bracket_ground.files.data_folder import DataFolder
from bracket_lab.drawing.plates import write_plates
from bracket_lab.learned.holes.evaluate import HoleFindings, Plate, evaluate_holes, load_plates
from bracket_sim.scene.settings import settings_of

CONFIGURATION = simulated(load_configuration(), "nominal")
BENCH, PRODUCT = CONFIGURATION.bench, load_product(CONFIGURATION)
SEED = 820_000


def test_bare_holes_are_read_and_filled_ones_are_not_called_empty(tmp_path: Path) -> None:
    folder = DataFolder(tmp_path / "new", "test")
    look = settings_of(CONFIGURATION.devices.simulation)
    write_plates(PRODUCT, BENCH, look, SEED, folder, 20, lambda *_: np.array(BENCH.arm_park_rad))
    network = HoleNetwork(BENCH, PRODUCT, OnnxModel.load(WEIGHTS / "holes_plate.onnx", KIND))

    def read(frames: Sequence[Plate]) -> dict[str, Reading | None]:
        return network.read(*(network.answer(plate.image, BENCH.overhead.mount.pose) for plate in frames))

    findings = HoleFindings()
    for plate in load_plates([tmp_path / "new"], PRODUCT):
        evaluate_holes([plate], read, findings)
    scores = findings.scores()
    assert scores["holes"] > 60
    assert scores["said"] > 0.95
    assert scores["right_where_said"] > 0.98
    assert findings.called_empty == 0
