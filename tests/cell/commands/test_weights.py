"""Trainings write over nothing that they did not begin themselves, and go on where they were interrupted."""

from __future__ import annotations

from pathlib import Path

import pytest

from bracket_ground.errors import InputError
from bracket_lab.commands.training.weights import writing


def train(*files: Path, error: BaseException | None = None, made: Path | None = None, overwrite: bool = False) -> None:
    """A training that makes one of its files before it ends, or ends by an error."""
    with writing(*files, overwrite=overwrite):
        if made is not None:
            made.write_text("weights")
        if error is not None:
            raise error


def test_an_interrupted_training_goes_on_and_one_that_is_done_is_not_written_over(tmp_path: Path) -> None:
    reader, finder = tmp_path / "hands.onnx", tmp_path / "hands_finder.onnx"
    with pytest.raises(KeyboardInterrupt):
        train(reader, finder, error=KeyboardInterrupt(), made=finder)
    train(reader, finder, made=reader)
    assert sorted(tmp_path.iterdir()) == [reader, finder]
    for _ in range(2):
        with pytest.raises(InputError, match=r"hands\.onnx: exists already; choose another --out, or add --overwrite"):
            train(reader, finder)
    train(reader, finder, overwrite=True)
    assert sorted(tmp_path.iterdir()) == [reader, finder]


def test_what_stands_beside_is_not_written_over_either(tmp_path: Path) -> None:
    (tmp_path / "mine_pose.onnx").write_text("mine")
    with pytest.raises(InputError, match=r"mine_pose\.onnx: exists already"):
        train(tmp_path / "mine.onnx", tmp_path / "mine_pose.onnx")


def test_a_training_that_fails_is_not_one_that_was_interrupted(tmp_path: Path) -> None:
    weights = tmp_path / "mine.onnx"
    wrong = InputError("no such look")
    with pytest.raises(InputError, match="no such look"):
        train(weights, error=wrong)
    assert not list(tmp_path.iterdir())
    with pytest.raises(KeyboardInterrupt):
        train(weights, error=KeyboardInterrupt(), made=weights)
    with pytest.raises(InputError, match="no such look"):
        train(weights, error=wrong)
    train(weights)  # it is still the one that was interrupted
    with pytest.raises(InputError, match="exists already"):
        train(weights)
