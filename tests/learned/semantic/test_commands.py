"""`cell lab data semantic` and what `cell lab eval semantic` refuses."""

from __future__ import annotations

from pathlib import Path

import pytest

from bracket_cell.commands.main import main
from bracket_cell.learned.semantic.records import load_demonstrations
from bracket_ground.files.files import shipped
from bracket_lab.commands.training.weights import new_weights
from tests.learned.products import DEFAULT


def test_generated_demonstrations_are_written(tmp_path: Path) -> None:
    path = tmp_path / "some.jsonl"
    assert main(["lab", "data", "semantic", "--out", str(path), "--count", "30", "--strength", "2", "--seed", "4"]) == 0
    assert len(load_demonstrations(path, DEFAULT)) == 30
    assert '"source":"cell lab data semantic --count 30 --strength 2 --seed 4"' in path.read_text().splitlines()[0]
    assert main(["lab", "data", "semantic", "--out", str(path), "--scenarios"]) == 2
    assert len(load_demonstrations(path, DEFAULT)) == 30
    path.unlink()
    assert main(["lab", "data", "semantic", "--out", str(path), "--scenarios"]) == 0
    assert len(load_demonstrations(path, DEFAULT)) == 186


def test_demonstrations_that_cannot_be_written(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "file").write_text("")
    assert main(["lab", "data", "semantic", "--out", str(tmp_path / "file" / "some.jsonl"), "--count", "1"]) == 2
    assert "some.jsonl: cannot be written" in " ".join(capsys.readouterr().err.split())


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["--experiment", "ratios"], "--experiment needs --page FILE"),
        (["--page", "page.md"], "--page is for --experiment"),
        (["--kind", "magic"], "--kind magic: unknown kind; legal: factored, paper, htn, bayes, auto"),
    ],
)
def test_bad_options(arguments: list[str], words: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["lab", "eval", "semantic", *arguments]) == 2
    assert words in " ".join(capsys.readouterr().err.split())


def test_new_weights_are_written_beside_the_configuration_or_into_the_working_folder(tmp_path: Path) -> None:
    assert new_weights("semantic", "factored", tmp_path / "mine.yaml") == tmp_path / "semantic_factored.onnx"
    assert new_weights("grasp", "paper", shipped("bracket_cell.config", "cell.yaml")) == Path("grasp_paper.onnx")
