"""Scores are those of the weights that the configuration names, whether one by one or as a folder."""

from __future__ import annotations

import re
from pathlib import Path

import cv2
import numpy as np
import pytest

from bracket_cell.commands.main import main
from bracket_cell.kinds import WEIGHTS
from bracket_ground.files.files import shipped
from bracket_ground.interfaces.planning import weights_file
from bracket_lab.evaluations import holes_and_parts as things

COMMANDS = {
    "actions": (["actions", "--quick"], "slim"),
    "hands": (["hands"], "slim"),
    "holes": (["holes"], "plate"),
    "parts": (["parts"], "centre"),
}


def configured(folder: Path, perception: str) -> Path:
    for name in ("products.yaml", "sim.yaml"):
        (folder / name).write_text(shipped("bracket_cell.config", name).read_text())
    text = shipped("bracket_cell.config", "cell.yaml").read_text()
    begin, end = text.index("\nperception:"), text.index("\nplanners:")
    path = folder / "cell.yaml"
    path.write_text(f"{text[:begin]}\nperception: {perception}\n{text[end:]}")
    return path


@pytest.mark.parametrize("detector", COMMANDS)
@pytest.mark.parametrize("whole", [True, False])
def test_configured_weights_are_scored(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], detector: str, whole: bool
) -> None:
    """Weights that are not there: those of the configuration are asked for, before anything is rendered."""
    words, kind = COMMANDS[detector]
    own = f"{{kind: learned, {detector}: {{kind: {kind}, weights: mine.onnx}}}}"
    config = configured(tmp_path, "{kind: learned, folder: mine}" if whole else own)
    assert main(["lab", "eval", *words, "--seeds", "900000:900001", "--config", str(config)]) == 2
    told = "".join(capsys.readouterr().err.split())
    assert f"{tmp_path}/mine" in told
    assert "cannotreadtheweights" in told


@pytest.mark.parametrize("detector", ["holes", "parts"])
def test_a_kind_that_is_not_there_is_told_before_anything_is_rendered(
    detector: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(things, "write_plates", None)
    monkeypatch.setattr(things, "tray_scenes", None)
    legal = {"holes": "plate, classical", "parts": "centre, classical, rcnn"}[detector]
    assert main(["lab", "eval", detector, "--kind", "bogus"]) == 2
    assert f"--kind bogus: unknown kind; legal: {legal}\n" in capsys.readouterr().err


@pytest.mark.parametrize("words", [["holes", "--kind"], ["parts", "--kind"], ["hands", "--kind"]])
def test_weights_that_nothing_reads_are_refused(words: list[str], capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["lab", "eval", *words, "classical", "--weights", "x.onnx"]) == 2
    assert "--weights x.onnx: nothing reads them: " in capsys.readouterr().err


@pytest.mark.parametrize("detector", COMMANDS)
def test_weights_of_another_product_are_not_scored(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], detector: str
) -> None:
    words, kind = COMMANDS[detector]
    config = configured(tmp_path, "{kind: classical}")
    for file in (config, tmp_path / "products.yaml"):
        file.write_text(re.sub(r"\bo1\b", "ball", file.read_text()))
    own = ["--weights", str(WEIGHTS / weights_file(detector, kind)), "--config", str(config)]
    chosen = ["--kind", kind] if detector == "actions" else []
    assert main(["lab", "eval", *words, *chosen, *own, "--seeds", "900000"]) == 2
    assert "trained for parts [o1; o2; o3], but the product has [ball; o2; o3]" in capsys.readouterr().err


def test_weights_of_another_detector_are_told_as_what_they_are(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """The finder beside them was missed first."""
    weights = tmp_path / "hi.onnx"
    weights.write_bytes((WEIGHTS / "holes_plate.onnx").read_bytes())
    assert main(["lab", "eval", "hands", "--weights", str(weights)]) == 2
    assert "hi.onnx: holds a 'holes.plate' model, but a 'hands.slim' model is needed" in capsys.readouterr().err


def test_a_tracker_that_is_chosen_by_name_has_the_configured_weights(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    config, image = configured(tmp_path, "{kind: learned, hands: {kind: slim, weights: mine.onnx}}"), tmp_path / "a.png"
    cv2.imwrite(str(image), np.zeros((360, 480, 3), np.uint8))
    assert (
        main(["lab", "see", str(image), "--hands", "slim", "--config", str(config), "--out", str(tmp_path / "b.png")])
        == 2
    )
    assert f"{tmp_path}/mine.onnx" in "".join(capsys.readouterr().err.split())


def test_trackers_without_mediapipes_networks_say_how_to_get_them(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    for kind in ("both", "mediapipe"):
        assert main(["lab", "eval", "hands", "--kind", kind]) == 2
        assert "cell lab hands" in capsys.readouterr().err
