"""Scores are those of the weights that the configuration names, whether one by one or as a folder."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest

from cell.commands.main import main
from cell.evaluating import things
from cell.interfaces.files import shipped

COMMANDS = {
    "actions": (["actions", "--quick"], "slim"),
    "hands": (["hands"], "slim"),
    "holes": (["holes"], "plate"),
    "parts": (["parts"], "centre"),
}


def configured(folder: Path, perception: str) -> Path:
    (folder / "products.yaml").write_text(shipped("config", "products.yaml").read_text())
    text = shipped("config", "cell.yaml").read_text()
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
    assert main(["eval", *words, "--recordings", "1", "--first-seed", "900000", "--config", str(config)]) == 2
    told = "".join(capsys.readouterr().err.split())
    assert f"{tmp_path}/mine" in told
    assert "cannotreadtheweights" in told


@pytest.mark.parametrize("detector", ["holes", "parts"])
def test_a_kind_that_is_not_there_is_told_before_anything_is_rendered(
    detector: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(things, "write_plates", None)
    monkeypatch.setattr(things, "write_objects", None)
    assert main(["eval", detector, "--kind", "bogus"]) == 2
    assert f"perception.{detector}: no detector of kind 'bogus'; legal: classical," in capsys.readouterr().err


def test_a_tracker_that_is_chosen_by_name_has_the_configured_weights(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    config, image = configured(tmp_path, "{kind: learned, hands: {kind: slim, weights: mine.onnx}}"), tmp_path / "a.png"
    cv2.imwrite(str(image), np.zeros((360, 480, 3), np.uint8))
    assert main(["see", str(image), "--hands", "slim", "--config", str(config), "--out", str(tmp_path / "b.png")]) == 2
    assert f"{tmp_path}/mine_finder.onnx" in "".join(capsys.readouterr().err.split())


def test_photographs_without_networks_say_how_to_get_them(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    cv2.imwrite(str(tmp_path / "a.png"), np.zeros((36, 48, 3), np.uint8))
    truth = tmp_path / "truth.json"
    truth.write_text('{"a.png": []}')
    assert main(["eval", "hands", "--photos", str(tmp_path), "--truth", str(truth)]) == 2
    assert "cell hands fetch" in capsys.readouterr().err
