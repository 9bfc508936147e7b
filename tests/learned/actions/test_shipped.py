"""The shipped weights: what they answer on a recording that nothing was trained on, without torch."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

from bracket_cell.configuration import load_configuration, load_product, simulated
from bracket_cell.kinds import WEIGHTS
from bracket_cell.learned.actions.segments import SegmentReader
from bracket_cell.learned.actions.settings import Classes
from bracket_cell.learned.inference.onnx_model import OnnxModel
from bracket_ground.files.data_folder import DataFolder
from bracket_ground.interfaces.planning import weights_file
from bracket_lab.drawing.actions import write_segments
from bracket_lab.drawing.recording import Source, record
from bracket_lab.learned.actions.data import load_segments
from bracket_lab.learned.actions.evaluate import answers, class_scores, confusion
from bracket_sim.scene.settings import settings_of

LOOKS = simulated(load_configuration(), "nominal", "varied")
SHIPPED = WEIGHTS / weights_file("actions", "slim")
TEST_SEEDS = 900_500, 900_501


def test_most_segments_of_unseen_recordings_are_named_right(tmp_path: Path) -> None:
    product, bench = load_product(LOOKS), LOOKS.bench
    for seed in TEST_SEEDS:
        assembly = record(product, bench, settings_of(LOOKS.devices.simulation), seed)
        write_segments(Source(assembly, product, bench), DataFolder(tmp_path / f"{seed}", "test"), thin=True)
    classes, reader = Classes.of(product), SegmentReader(bench, product)
    segments = load_segments([tmp_path / f"{seed}" for seed in TEST_SEEDS], classes)
    network = OnnxModel.load(SHIPPED, "actions.slim")
    posterior, released = answers(network, segments, reader)
    scores = class_scores(segments, posterior, classes)
    assert scores["accuracy_outside_guard"] > 0.85
    assert scores["assembly_accuracy"] > 0.85
    placing = (segments.classes < classes.assemblies) & ~segments.guarded
    assert ((released > 0.5) == segments.released)[placing].mean() > 0.8
    assert confusion(segments, posterior, classes).sum() == int((~segments.guarded).sum())
    blank = class_scores(segments, answers(network, segments, reader, blank=True, noise_seed=0)[0], classes)
    shuffled = class_scores(segments, answers(network, segments, reader, shuffle_seed=0)[0], classes)
    assert blank["assembly_part"] < 0.9  # controls: crops tell the part, as a tracker errs; order the rest
    assert shuffled["accuracy"] < scores["accuracy"]


def test_the_shipped_file_is_small_and_needs_no_torch() -> None:
    assert SHIPPED.stat().st_size < 2_000_000
    program = (
        "import sys; from bracket_cell.kinds import WEIGHTS;"
        "from bracket_cell.configuration import load_configuration, load_product;"
        "from bracket_cell.learned.actions.model import load_actions; c = load_configuration();"
        "load_actions(c.bench, load_product(c), WEIGHTS / 'actions_slim.onnx');"
        "assert not {'torch', 'bracket_sim.scene.world', 'mujoco'} & set(sys.modules)"
    )
    assert subprocess.run([sys.executable, "-c", program], check=False).returncode == 0
