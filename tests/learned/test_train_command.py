"""`cell train`: says what it does, trains what the product needs, and names the lines for the configuration."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest
import yaml

from bracket_cell.commands.main import main
from bracket_cell.learned.inference.onnx_model import OnnxModel
from bracket_cell.learned.semantic.graph import Layout
from bracket_cell.learned.semantic.model import BayesPlanner, FactoredPlanner
from bracket_cell.learned.semantic.records import save_demonstrations
from bracket_ground.files.files import shipped
from bracket_lab.commands.training.weights import shipped_weights
from bracket_lab.learned.semantic.paper_planner import load_semantic_planner
from bracket_lab.learned.semantic.scenarios import scenarios
from tests.learned.products import DEFAULT, HARDER
from tests.learned.semantic.demonstrated import demonstrations_of


@pytest.fixture
def config(tmp_path: Path) -> Path:
    for name in ("cell.yaml", "sim.yaml", "products.yaml"):
        (tmp_path / name).write_text(shipped("bracket_cell.config", name).read_text())
    return tmp_path / "cell.yaml"


@pytest.fixture
def short(monkeypatch: pytest.MonkeyPatch) -> None:
    """Training of a second instead of a minute."""
    from bracket_cell.learned.grasp.settings import PairwiseSettings
    from bracket_lab.learned.grasp import train

    settings = PairwiseSettings(scenes=10, test_scenes=8, epochs=2, hidden=8, members=1)
    whole = train.train_grasp
    monkeypatch.setattr(train, "train_grasp", lambda *args, **more: whole(*args, settings=settings, **more))


def lines(told: str) -> Any:
    """The configuration that the command prints at its end."""
    return yaml.safe_load(told[told.index("planners:") :])


@pytest.mark.long
@pytest.mark.torch
@pytest.mark.usefixtures("short")
def test_without_recordings_the_grasp_planner_is_trained_and_bayes_chosen(
    config: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    before = shipped_weights("grasp", "pairwise").read_bytes()
    made = config.with_name("grasp_pairwise.onnx")
    made.write_bytes(b"mine")
    assert main(["train", "--config", str(config)]) == 2
    assert f"{made}: exists already; choose another --config, or add --overwrite" in capsys.readouterr().err
    assert made.read_bytes() == b"mine"
    assert main(["train", "--config", str(config), "--overwrite"]) == 0
    told = capsys.readouterr().err
    assert "about 1 minute" in told
    assert lines(told)["planners"] == {
        "semantic": {"kind": "bayes"},
        "grasp": {"kind": "pairwise", "weights": "grasp_pairwise.onnx"},
    }
    OnnxModel.load(made, "grasp.pairwise")
    assert shipped_weights("grasp", "pairwise").read_bytes() == before


@pytest.mark.slow
@pytest.mark.torch
@pytest.mark.usefixtures("short")
def test_recorded_assemblies_train_the_semantic_planner_too(config: Path, capsys: pytest.CaptureFixture[str]) -> None:
    recorded = config.with_name("recorded")
    layout = Layout.of(DEFAULT)
    shown = demonstrations_of(layout, scenarios(layout, 0))
    save_demonstrations(recorded / "demonstrations.jsonl", DEFAULT, shown, "a test")
    assert main(["train", "--config", str(config), "--recorded", str(recorded)]) == 0
    told = capsys.readouterr().err
    assert lines(told)["planners"]["semantic"] == {"kind": "factored", "weights": "semantic_factored.onnx"}
    OnnxModel.load(config.with_name("semantic_factored.onnx"), "semantic.factored")


def test_a_folder_without_recordings_is_refused(config: Path, capsys: pytest.CaptureFixture[str]) -> None:
    for folder in (config.parent, config.with_name("nowhere")):
        assert main(["train", "--config", str(config), "--recorded", str(folder)]) == 2
        assert f"--recorded {folder}: holds no data of `cell log export --to training`" in capsys.readouterr().err


def test_a_plan_trains_nothing(config: Path, capsys: pytest.CaptureFixture[str]) -> None:
    before = sorted(config.parent.iterdir())
    assert main(["train", "--plan", "--config", str(config)]) == 0
    assert "grasp planner `pairwise`" in capsys.readouterr().err
    assert sorted(config.parent.iterdir()) == before
    assert main(["train", "--budget", "1h", "--config", str(config)]) == 2
    assert "go with --all or --only" in capsys.readouterr().err


@pytest.mark.long
@pytest.mark.torch
def test_training_leaves_the_shipped_weights_alone_and_nothing_that_torch_says_reaches_the_user(config: Path) -> None:
    words = ["lab", "train", "semantic", "--kind", "factored", "--config", str(config), "--seed", "3", "--json"]
    before = shipped_weights("semantic", "factored").read_bytes()
    briefly = (
        "import sys; from bracket_lab.learned.semantic import train;"
        "from bracket_cell.learned.semantic.settings import FactoredSettings;"
        "train.FactoredSettings = lambda: FactoredSettings(steps=3);"
        "from bracket_cell.commands.main import main; sys.exit(main(sys.argv[1:]))"
    )
    command = [sys.executable, "-c", briefly, *words]
    found = subprocess.run(command, capture_output=True, text=True, check=True, timeout=500)
    for word in ("triton", "torchvision", "initializer", "Warning", "torch.onnx"):
        assert word not in found.stderr
    assert OnnxModel.load(config.with_name("semantic_factored.onnx"), "semantic.factored").card.seed == 3
    assert shipped_weights("semantic", "factored").read_bytes() == before


def test_auto_is_the_learned_planner_where_its_weights_fit_and_exact_inference_elsewhere() -> None:
    weights = shipped_weights("semantic", "auto")
    assert weights == shipped_weights("semantic", "factored")
    assert isinstance(load_semantic_planner("auto", weights, DEFAULT), FactoredPlanner)
    assert isinstance(load_semantic_planner("auto", weights, HARDER), BayesPlanner)


@pytest.mark.parametrize(
    ("words", "told"),
    [
        (["holes"], "learns from your own pictures, --data DIR of `cell label`"),
        (["feet", "--data", "own"], "legal: hands, holes, parts, actions"),
        (["grasp"], "cell train --only grasp"),
        (["--data", "own"], "name the network to train"),
        (["holes", "--data", "own", "--plan"], "do not go with --data"),
        (["holes", "--data", "own", "--epochs", "1"], "plates.jsonl: cannot be read"),
    ],
)
def test_what_own_pictures_need_is_told(
    words: list[str], told: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    assert main(["train", *words]) == 2
    assert told in capsys.readouterr().err
