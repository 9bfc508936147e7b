"""Training data that a training makes for itself: once, and anew where it was interrupted."""

from __future__ import annotations

import json
import signal
import sys
from pathlib import Path
from subprocess import PIPE, Popen

import pytest

from bracket_cell.commands.main import main
from bracket_ground.errors import InputError
from bracket_ground.files.data_folder import DataFolder, DataPiece
from bracket_ground.files.files import UNFINISHED, shipped
from bracket_ground.interfaces.bench import Bench
from bracket_ground.interfaces.product import Product
from bracket_lab.commands.training.made_data import Children, make_data
from bracket_lab.drawing.objects import write_objects
from bracket_lab.drawing.recording import Assembly, record
from bracket_sim.scene.settings import SimSettings


@pytest.mark.long
def test_data_are_made_once_what_was_interrupted_anew_and_of_other_options_or_another_product_not(
    tmp_path: Path,
) -> None:
    config = tmp_path / "cell.yaml"
    for name in ("cell.yaml", "sim.yaml", "products.yaml"):
        (tmp_path / name).write_text(shipped("bracket_cell.config", name).read_text())
    folder, mine = tmp_path / "some", tmp_path / "some.unfinished" / "notes.txt"
    (folder / UNFINISHED).mkdir(parents=True)
    (folder / UNFINISHED / "half.jsonl").write_text("{")
    mine.parent.mkdir()
    mine.write_text("mine")
    options = {"--look": "nominal", "--seeds": "3", "--config": config}
    make_data("actions", folder, options, "--thin")
    assert (folder / "manifest.json").exists()
    assert not (folder / UNFINISHED).exists()
    assert not (folder / "half.jsonl").exists()
    assert mine.read_text() == "mine"
    made = (folder / "manifest.json").stat().st_mtime_ns
    make_data("actions", folder, options, "--thin")
    assert (folder / "manifest.json").stat().st_mtime_ns == made
    with pytest.raises(InputError, match=r"other settings \(--seeds\); remove the folder"):
        make_data("actions", folder, {**options, "--seeds": "3:5"}, "--thin")
    products = tmp_path / "products.yaml"
    products.write_text(products.read_text().replace("mass_kg: 0.08", "mass_kg: 0.09"))
    with pytest.raises(InputError, match="product or bench"):
        make_data("actions", folder, options, "--thin")


@pytest.mark.long
@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGINT])
def test_data_are_not_made_on_by_a_process_that_its_training_left_behind(tmp_path: Path, number: int) -> None:
    """The signal goes to the training alone; its output ends when nobody writes to it any more."""
    maker = tmp_path / "maker"
    waits = "import threading; print('begun', flush=True); threading.Event().wait(20); print('went on')"
    maker.write_text(f"#!{sys.executable}\n{waits}\n")
    maker.chmod(0o755)
    makes = f"""
import signal, sys
from pathlib import Path
from bracket_lab.commands.training.made_data import Children
from bracket_lab.commands.training.made_data import make_data
signal.signal(signal.SIGINT, signal.default_int_handler)  # the tests may run where a shell has it ignored
sys.executable = {str(maker)!r}
make_data("hands", Path({str(tmp_path / "some")!r}), {{}})
"""
    with Popen([sys.executable, "-c", makes], stdout=PIPE, stderr=PIPE, text=True) as training:
        assert training.stdout is not None
        while training.stdout.readline() != "begun\n":
            assert training.poll() is None
        training.send_signal(number)
        assert "went on" not in training.communicate()[0]


@pytest.mark.long
def test_recordings_whose_physics_diverged_are_left_out_and_counted(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def half_of_them(product: Product, bench: Bench, settings: SimSettings, seed: int, *, physics: bool) -> Assembly:
        assert physics
        assembly = record(product, bench, settings, seed)
        assembly.world.diverged = seed % 2 == 0
        return assembly

    monkeypatch.setattr("bracket_lab.drawing.recording.record", half_of_them)
    words = ["lab", "data", "actions", "--thin", "--physics", "--look", "nominal", "--seeds", "3:5"]
    assert main([*words, "--out", str(tmp_path / "some")]) == 0
    manifest = json.loads((tmp_path / "some" / "manifest.json").read_text())
    assert manifest["left_out_seeds"] == [4]
    assert "left out: physics diverged" in capsys.readouterr().err
    _, *rows = map(json.loads, (tmp_path / "some" / "segments.jsonl").read_text().splitlines())
    assert {row["log"] for row in rows} == {"seed000003"}


def test_what_another_process_left_out_counts_too(tmp_path: Path) -> None:
    folder, piece = DataFolder(tmp_path / "some", "test"), DataPiece()
    piece.left_out.append(7)
    folder.add(piece)
    assert folder.close({})["left_out_seeds"] == [7]


def test_what_the_command_said_is_told(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="no look 'moonlight'"):
        make_data("hands", tmp_path / "some", {"--look": "moonlight"})


@pytest.mark.long
def test_a_folder_without_hands_is_told_before_any_frames_are_made(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "empty").mkdir()
    words = ["lab", "train", "hands", "--data", str(tmp_path / "empty"), "--out", str(tmp_path / "hands.onnx")]
    assert main(words) == 2
    assert "hands.jsonl: cannot be read" in " ".join(capsys.readouterr().err.split())
    assert [path.name for path in tmp_path.iterdir()] == ["empty"]


def test_a_share_of_lying_parts_without_mixed_trays_is_refused_instead_of_passed_over(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["lab", "data", "objects", "--lying-share", "0.5", "--seeds", "0", "--out", str(tmp_path / "new")]) == 2
    assert "--lying-share is for trays of --mixed" in capsys.readouterr().err
    assert not (tmp_path / "new").exists()


@pytest.mark.long
@pytest.mark.parametrize(
    ("training", "folder"),
    [
        ("holes", "q.data/nominal"),
        ("parts", "q.data/nominal"),
        ("hands", "q.data/nominal"),
        ("actions", "q.data/nominal-physics-000000"),
    ],
)
def test_a_folder_of_somebody_is_told_before_any_data_are_made(
    training: str, folder: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(Children, "run", lambda *_: pytest.fail("data are made"))
    mine = tmp_path / folder / "notes.txt"
    mine.parent.mkdir(parents=True)
    mine.write_text("mine")
    assert main(["lab", "train", training, "--budget", "10m", "--out", str(tmp_path / "q.onnx")]) == 2
    assert f"{tmp_path / folder}: is not an empty folder; remove it, or choose another" in capsys.readouterr().err
    assert [path for path in tmp_path.rglob("*") if path.is_file()] == [mine]


def test_data_that_are_interrupted_leave_nothing_that_is_in_their_way(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    words = ["lab", "data", "objects", "--look", "nominal", "--seeds", "0:2", "--out", str(tmp_path / "new")]
    taken = 0

    def interrupted(*_: object) -> None:
        nonlocal taken
        taken += 1
        if taken == 2:
            raise KeyboardInterrupt
        write_objects(*_)  # type: ignore[arg-type]

    monkeypatch.setattr("bracket_lab.drawing.objects.write_objects", interrupted)
    assert main(words) == 1
    assert not list(tmp_path.iterdir())
    assert main(words) == 0
    assert json.loads((tmp_path / "new" / "manifest.json").read_text())["recordings"] == 2
