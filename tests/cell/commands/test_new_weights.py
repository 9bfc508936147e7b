"""Where no weights can be written is told before a training, not after it."""

from __future__ import annotations

from pathlib import Path

import pytest

from cell.commands.main import main

pytestmark = pytest.mark.torch

TRAININGS = {
    "hands": "hands.onnx",
    "holes": "holes.onnx",
    "parts": "parts.onnx",
    "parts --kind rcnn": "parts.pt",
    "grasp": "grasp.onnx",
    "semantic": "semantic.onnx",
    "semantic --kind and_or": "semantic.json",
}


@pytest.mark.parametrize("training", TRAININGS)
def test_no_training_begins_that_could_not_be_kept(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], training: str
) -> None:
    name = TRAININGS[training]
    (tmp_path / "folder" / name).mkdir(parents=True)
    (tmp_path / "notes.txt").write_text("mine")
    wrong = {
        tmp_path / "folder" / name: "is a folder",
        tmp_path / "notes.txt": f"must end in {Path(name).suffix}",
        tmp_path / "notes.txt" / name: "cannot be written",
    }
    for out, why in wrong.items():
        assert main(["train", *training.split(), "--out", str(out)]) == 2
        assert f"--out {out}: {why}" in capsys.readouterr().err
    assert (tmp_path / "notes.txt").read_text() == "mine"
    assert sorted(file.name for file in tmp_path.rglob("*")) == sorted(["folder", name, "notes.txt"])
