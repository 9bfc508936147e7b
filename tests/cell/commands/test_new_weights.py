"""Where no weights can or may be written is told before a training, not after it."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from bracket_cell.commands.main import main
from bracket_lab.commands.training import networks
from bracket_lab.commands.training.shares import Share
from bracket_lab.commands.training.weights import Training, seconds

pytestmark = pytest.mark.torch

TRAININGS = {
    "actions": "actions.onnx",
    "hands": "hands.onnx",
    "holes": "holes.onnx",
    "parts": "parts.onnx",
    "parts --kind rcnn": "parts.onnx",
    "grasp": "grasp.onnx",
    "semantic": "semantic.onnx",
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
        assert main(["lab", "train", *training.split(), "--out", str(out)]) == 2
        assert f"--out {out}: {why}" in capsys.readouterr().err
    assert (tmp_path / "notes.txt").read_text() == "mine"
    assert sorted(file.name for file in tmp_path.rglob("*")) == sorted(["folder", name, "notes.txt"])


@pytest.mark.parametrize(
    ("training", "file"),
    [
        *((training, name) for training, name in TRAININGS.items()),
        ("actions", "actions_confusions.json"),
        ("hands", "hands_refiner.onnx"),
        ("parts", "parts_pose.onnx"),
        ("parts --kind rcnn", "parts_head.onnx"),
        ("grasp --kind paper", "grasp_crops.onnx"),
    ],
)
def test_no_training_writes_over_a_file_unasked(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], training: str, file: str
) -> None:
    (tmp_path / file).write_text("mine")
    out = tmp_path / TRAININGS.get(training, "grasp.onnx")
    assert main(["lab", "train", *training.split(), "--out", str(out)]) == 2
    assert f"{tmp_path / file}: exists already; choose another --out, or add --overwrite" in capsys.readouterr().err
    assert [path.name for path in tmp_path.iterdir()] == [file]
    assert (tmp_path / file).read_text() == "mine"


def test_an_interrupted_training_goes_on_without_being_told_to_overwrite(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    out = tmp_path / "mine.onnx"
    calls = []

    def train(_: object, path: Path, *__: object, **___: object) -> dict[str, float]:
        calls.append(path.exists())
        path.write_text("weights")
        if len(calls) == 1:
            raise KeyboardInterrupt
        return {}

    monkeypatch.setattr("bracket_lab.learned.semantic.train.train_semantic", train)
    statuses = [main(["lab", "train", "semantic", "--out", str(out), *more]) for more in ([], [], [], ["--overwrite"])]
    assert statuses == [1, 0, 2, 0]
    assert calls == [False, True, True]


def test_few_labelled_pictures_are_seen_as_often_as_a_training_may() -> None:
    from bracket_lab.learned.parts.settings import CentreTraining, PoseTraining

    for images in (1, 3, 30, 3000):
        epochs = networks.box_epochs(images)
        assert CentreTraining(epochs=epochs).epochs == PoseTraining(epochs=epochs).epochs >= networks.PART_EPOCHS


@pytest.mark.parametrize("words", [["train"], ["lab", "train"]])
@pytest.mark.parametrize("network", ["hands", "holes", "parts", "actions"])
def test_more_epochs_than_a_training_may_have_are_refused(
    words: list[str], network: str, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    assert main([*words, network, "--data", str(tmp_path), "--epochs", "1001"]) == 2
    assert "less than or equal to 1000" in capsys.readouterr().err


@pytest.mark.parametrize("budget", ["30m", "50m", "2h"])
def test_a_budget_leaves_time_to_learn_parts_and_stacks(budget: str) -> None:
    images = networks.TRAY_VIEWS * int(networks.PARTS_DATA * seconds(budget) / networks.TRAY_S)
    centre, stacked = networks.part_epochs(seconds(budget), images, 4 * images)
    assert centre >= 12
    assert stacked >= 9
    assert networks.part_epochs(1.0, images, 4 * images) == (1, 1)


@pytest.mark.parametrize(
    ("words", "fetched", "looks"),
    [
        ({}, True, {"people", "varied", "nominal", "bare"}),
        ({}, False, {"people", "varied", "nominal"}),
        ({"look": "bare", "tracker": "mediapipe"}, True, {"bare"}),
    ],
)
def test_action_detectors_learn_from_mediapipe_s_tracks_where_its_networks_are(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, words: dict[str, str], fetched: bool, looks: set[str]
) -> None:
    wanted: list[Share] = []

    def made(*given: Any, **_: object) -> object:
        wanted.extend(given[3])
        return [], tmp_path

    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    if fetched:
        file = tmp_path / "cell" / "mediapipe" / "landmark_lite.onnx"
        file.parent.mkdir(parents=True)
        file.touch()
    monkeypatch.setattr(networks, "made", made)
    networks.recordings(Training(kind="slim", **words), tmp_path / "a.onnx", 600.0)  # type: ignore[arg-type]
    assert {share.look for share in wanted} == looks
    assert {share.tracker for share in wanted if share.look == "bare"} <= {"mediapipe"}


@pytest.mark.parametrize(
    ("words", "told"),
    [("--tracker mediapipe", "--tracker goes with --look"), ("--tracker mediapipe --look bare", "make hands")],
)
def test_a_tracker_that_cannot_be_had_is_told_before_recordings_are_made(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], words: str, told: str
) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    out = tmp_path / "actions.onnx"
    assert main(["lab", "train", "actions", *words.split(), "--budget", "20s", "--out", str(out)]) == 2
    assert told in capsys.readouterr().err
    assert not out.exists()
