"""`cell train --all` covers all shipped weights, goes on where it stopped, and writes over nothing of anybody's."""

from __future__ import annotations

import re
import shutil
import time
from pathlib import Path

import pytest

from bracket_cell.commands.main import main
from bracket_cell.configuration import load_configuration
from bracket_cell.kinds import WEIGHTS
from bracket_ground.files.files import shipped
from bracket_lab.commands.training import shipped as training
from bracket_lab.commands.training.made_data import Children
from bracket_lab.commands.training.shipped import ROWS, steps_of_shipped

MOST_S = 2.5 * 3600


@pytest.fixture
def trained(monkeypatch: pytest.MonkeyPatch) -> list[list[str]]:
    """Trainings that copy the shipped files; what they were called with."""
    calls: list[list[str]] = []

    def copy(_: Children, words: list[str], __: object) -> int:
        calls.append(words)
        out = Path(words[words.index("--out") + 1])
        out.parent.mkdir(parents=True, exist_ok=True)
        step = next(step for step in steps_of_shipped() if step.files[0] == out.name)
        for name in step.files:
            shutil.copy(WEIGHTS / name, out.parent / name)
        return 0

    monkeypatch.setattr(Children, "run", copy)
    monkeypatch.setattr(training, "_note_latencies", lambda *_: None)
    return calls


def test_every_shipped_file_is_made_by_one_step() -> None:
    steps = steps_of_shipped()
    files = [name for step in steps for name in step.files]
    assert sorted(files) == sorted(path.name for path in WEIGHTS.glob("*.onnx"))
    for step in steps:
        assert step.files[0].startswith(step.words[0])
        assert all(name.startswith(step.words[0]) for name in step.files)


def test_it_says_what_it_would_do_and_makes_nothing(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["train", "--all", "--plan", "--out", str(tmp_path / "new"), "--budget", "10m"]) == 0
    told = capsys.readouterr().err
    assert "cell lab train holes --budget" in told
    assert not (tmp_path / "new").exists()


def test_the_longest_comes_first_and_two_at_a_time_take_hours(capsys: pytest.CaptureFixture[str]) -> None:
    seconds = [step.seconds for step in steps_of_shipped()]
    assert seconds == sorted(seconds, reverse=True)
    assert main(["train", "--all", "--plan", "--out", "none/such"]) == 0
    told = " ".join(capsys.readouterr().err.split())
    whole, two = re.search(r"about (\d+) minutes of one CPU core, (\d+) minutes with --jobs 2", told).groups()  # type: ignore[union-attr]
    assert float(whole) == pytest.approx(sum(seconds) / 60, abs=1)
    assert float(two) * 60 <= MOST_S
    assert max(seconds[0] / 60, 0.5 * float(whole)) - 1 <= float(two) <= 0.6 * float(whole)


@pytest.mark.usefixtures("trained")
def test_the_plan_tells_what_is_left(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out = tmp_path / "new"
    assert main(["train", "--all", "--out", str(out), "--only", "holes"]) == 0
    capsys.readouterr()
    assert main(["train", "--all", "--out", str(out), "--only", "holes", "--only", "semantic", "--plan"]) == 0
    told = " ".join(capsys.readouterr().err.split())
    assert "(made before): holes_plate.onnx" in told
    assert "about 2 minutes of one CPU core" in told
    assert main(["train", "--all", "--out", str(out), "--only", "holes", "--plan"]) == 0
    assert "nothing is left" in capsys.readouterr().err


def test_interrupted_it_goes_on_with_the_next_training(tmp_path: Path, trained: list[list[str]]) -> None:
    out = tmp_path / "new"
    assert main(["train", "--all", "--out", str(out), "--only", "holes"]) == 0
    assert len(trained) == 1
    assert main(["train", "--all", "--out", str(out)]) == 0
    assert len(trained) == len(steps_of_shipped())  # the holes only once
    assert main(["train", "--all", "--out", str(out)]) == 0
    assert len(trained) == len(steps_of_shipped())
    (out / "holes_plate.onnx").unlink()
    assert main(["train", "--all", "--out", str(out)]) == 0
    assert trained[-1][-1].endswith("holes_plate.onnx")
    assert all("--overwrite" in words for words in trained)  # what an interrupted one left in the folder


def test_ctrl_c_ends_it_with_a_word_on_how_to_go_on(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def interrupted(*_: object) -> int:
        raise KeyboardInterrupt

    monkeypatch.setattr(Children, "run", interrupted)
    assert main(["train", "--all", "--out", str(tmp_path / "new")]) == 1
    told = capsys.readouterr().err
    assert "the same command goes on with what is not made yet" in told
    assert told.rstrip().endswith("cell: interrupted")


def test_two_at_a_time_make_the_same_files(tmp_path: Path, trained: list[list[str]]) -> None:
    assert main(["train", "--all", "--out", str(tmp_path / "new"), "--jobs", "2"]) == 0
    assert len(trained) == len(steps_of_shipped())
    for path in WEIGHTS.glob("*.onnx"):
        assert (tmp_path / "new" / path.name).read_bytes() == path.read_bytes()


def test_when_one_of_two_fails_no_other_begins(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    begun: list[list[str]] = []

    def failing(_: Children, words: list[str], __: object) -> int:
        begun.append(words)
        time.sleep(0.1)  # a training takes longer than it takes to hear of the other's end
        return 3

    monkeypatch.setattr(Children, "run", failing)
    assert main(["train", "--all", "--out", str(tmp_path / "new"), "--jobs", "2"]) == 2
    told = " ".join(capsys.readouterr().err.split())
    assert "ended with status 3 (see" in told
    assert len(begun) < len(steps_of_shipped())


@pytest.mark.usefixtures("trained")
def test_the_lines_that_it_ends_with_take_the_folder_into_use(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    for name in ("cell.yaml", "sim.yaml", "products.yaml"):
        (tmp_path / name).write_text(shipped("bracket_cell.config", name).read_text())
    config = tmp_path / "cell.yaml"
    assert main(["train", "--all", "--out", str(tmp_path / "new"), "--config", str(config)]) == 0
    told = capsys.readouterr().err.splitlines()
    line = next(line for line in told if line.startswith("perception:"))
    text = config.read_text()
    assert "\nperception:" in text
    own = text[: text.index("\nperception:")] + "\n" + line + "\nplanners:" + text.split("\nplanners:", 1)[1]
    config.write_text(own)
    read = load_configuration(config)
    assert read.perception.weights("holes") == tmp_path / "new" / "holes_plate.onnx"
    assert set(read.perception.files("hands").values()) <= set((tmp_path / "new").iterdir())


@pytest.mark.usefixtures("trained")
def test_what_it_did_not_make_is_not_written_over(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    before = {path.name: path.read_bytes() for path in WEIGHTS.glob("*.onnx")}
    assert main(["train", "--all", "--out", str(WEIGHTS)]) == 2
    assert "shipped weights" in capsys.readouterr().err
    assert {path.name: path.read_bytes() for path in WEIGHTS.glob("*.onnx")} == before
    (tmp_path / "holes_plate.onnx").write_text("mine")
    assert main(["train", "--all", "--out", str(tmp_path)]) == 2
    told = capsys.readouterr().err
    assert "not empty" in told
    assert "cell lab train" not in told.replace("`cell train --all`", "")  # no plan that is not carried out
    assert (tmp_path / "holes_plate.onnx").read_text() == "mine"


@pytest.mark.usefixtures("trained")
def test_a_folder_of_another_product_is_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out = tmp_path / "new"
    assert main(["train", "--all", "--out", str(out), "--only", "holes"]) == 0
    rows = (out / ROWS).read_text().splitlines()
    (out / ROWS).write_text(rows[0].replace('"made_for": "', '"made_for": "0') + "\n" + "\n".join(rows[1:]))
    assert main(["train", "--all", "--out", str(out)]) == 2
    assert "was made for another product or bench, or its" in " ".join(capsys.readouterr().err.split())


def test_wrong_names_and_folders_are_told(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "notes.txt").write_text("mine")
    for words, told in (
        (["train", "--only", "arms"], "legal: hands, actions"),
        (["train", "--all", "--budget", "soon"], "90s, 30m or 2h"),
        (["train", "--all", "--budget", "0s", "--plan"], "more than 0, like 90s"),
        (["train", "--all", "--out", str(tmp_path / "notes.txt")], "notes.txt is a file; name a folder"),
        (
            ["train", "--all", "--out", str(tmp_path / "notes.txt" / "in"), "--plan"],
            "notes.txt is a file; name a folder",
        ),
    ):
        assert main(words) == 2
        assert told in " ".join(capsys.readouterr().err.split())
    assert (tmp_path / "notes.txt").read_text() == "mine"


@pytest.mark.usefixtures("trained")
def test_of_a_part_of_them_only_what_is_there_is_told(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "config").mkdir()
    for name in ("cell.yaml", "sim.yaml", "products.yaml"):
        (tmp_path / "config" / name).write_text(shipped("bracket_cell.config", name).read_text())
    config = tmp_path / "config" / "cell.yaml"
    assert main(["train", "--all", "--out", str(tmp_path / "new"), "--config", str(config), "--only", "holes"]) == 0
    told = capsys.readouterr().err
    assert "perception:\n  holes: {kind: plate, weights: ../new/holes_plate.onnx}\n" in told
    assert "planners:" not in told
