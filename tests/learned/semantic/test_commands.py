"""What `cell lab eval semantic` refuses."""

from __future__ import annotations

from pathlib import Path

import pytest

from bracket_cell.commands.main import main
from bracket_ground.files.files import shipped
from bracket_lab.commands.training.weights import new_weights


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["--kind", "magic"], "--kind magic: unknown kind; legal: factored, paper, htn, bayes, auto"),
    ],
)
def test_bad_options(arguments: list[str], words: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["lab", "eval", "semantic", *arguments]) == 2
    assert words in " ".join(capsys.readouterr().err.split())


def test_new_weights_are_written_beside_the_configuration_or_into_the_working_folder(tmp_path: Path) -> None:
    assert new_weights("semantic", "factored", tmp_path / "mine.yaml") == tmp_path / "semantic_factored.onnx"
    assert new_weights("grasp", "paper", shipped("bracket_cell.config", "cell.yaml")) == Path("grasp_paper.onnx")
