"""What is made to learn actions from: recordings with painted parts, and some with parts of bare steel."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from bracket_cell.commands.main import main
from bracket_cell.commands.options import seeds_of
from bracket_lab.commands.training import networks, shares
from bracket_lab.commands.training.weights import Training
from bracket_lab.evaluations.actions import Tally


def test_some_recordings_to_learn_from_have_steel_parts_and_those_for_the_scores_have_none(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    made: dict[Path, dict[str, Any]] = {}

    def make(_what: str, folder: Path, options: dict[str, Any], *flags: str) -> None:
        made[folder] = options | {"flags": flags}

    monkeypatch.setattr(shares, "make_data", make)
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    network = tmp_path / "cell" / "mediapipe" / "landmark_lite.onnx"
    network.parent.mkdir(parents=True)
    network.touch()
    folders, validation = networks.recordings(Training(kind="slim"), tmp_path / "actions_slim.onnx", 4200.0)
    count, by_physics, spent_s = 0, 0, 0.0
    for folder in folders:
        recordings, flags = len(seeds_of(made[folder]["--seeds"])), made[folder]["flags"]
        count, by_physics = count + recordings, by_physics + recordings * ("--physics" in flags)
        each_s = networks.ACTION_PHYSICS_S if "--physics" in flags else networks.ACTION_S
        spent_s += recordings * (networks.ACTION_TRACKED_S if "--tracker=mediapipe" in flags else each_s)
    assert len(set(folders)) == len(folders)
    assert by_physics / count == pytest.approx(0.42, abs=0.01)
    assert spent_s == pytest.approx(networks.ACTION_DATA * 4200, rel=0.02)
    assert {made[folder]["--steel-share"] for folder in folders} == {networks.STEEL_SHARE}
    assert 0 < networks.STEEL_SHARE < 1
    assert "--steel-share" not in made[validation]


@pytest.mark.slow
def test_steel_changes_what_is_seen_and_not_what_is_done(tmp_path: Path) -> None:
    words = ["lab", "data", "actions", "--look", "nominal", "--seeds", "3:4", "--thin"]
    found = {}
    for share in ("0", "1"):
        out = tmp_path / share
        assert main([*words, "--steel-share", share, "--out", str(out)]) == 0
        header, *rows = (json.loads(line) for line in (out / "segments.jsonl").read_text().splitlines())
        held = [row["hole_crop"] for row in rows if row["truth"]["kind"] == "assembly" and row["hole_crop"]]
        found[share] = header["source"], rows, max(_colour(out / name) for name in held)
    assert found["0"][1] == found["1"][1]
    assert "--steel-share 1" in found["1"][0]
    assert "--steel-share" not in found["0"][0]
    assert found["1"][2] < 0.8 * found["0"][2]


def _colour(path: Path) -> float:
    """How far apart the colour channels of an image are, where most."""
    image = cv2.imread(str(path))
    assert image is not None
    return float(np.quantile(np.ptp(image, axis=2), 0.98))


@pytest.mark.parametrize(
    ("words", "told"),
    [
        (["lab", "train", "actions", "--kind", "vgg"], "--kind vgg: unknown kind of actions; legal: slim, paper"),
        (["lab", "train", "actions", "--out", "."], "--out"),
        (["lab", "train", "actions", "--data", "d", "--validation", "d"], "is --data, too"),
        (
            ["lab", "train", "actions", "--data", "a", "--data", "b", "--validation", "c"],
            "made from copied.mcap, as --data b",
        ),
        (["lab", "eval", "actions", "--confusions", "there.json"], "there.json: exists already"),
        (
            ["lab", "eval", "actions", "--kind", "classical", "--weights", "x.onnx"],
            "they go with --kind slim",
        ),
        (["lab", "eval", "actions", "--confusions", "nowhere.txt"], "must end in .json"),
    ],
)
def test_what_cannot_end_well_is_told_before_it_begins(
    words: list[str], told: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(shares, "make_data", lambda *_: pytest.fail("recordings are made"))
    (tmp_path / "there.json").write_text("mine")
    for name, log, content in (("a", "sunday.mcap", "0a"), ("b", "monday.mcap", "1b"), ("c", "copied.mcap", "1b")):
        (tmp_path / name).mkdir()
        manifest = {"format": "cell.training_data", "logs": [{"files": {log: content}}]}
        (tmp_path / name / "manifest.json").write_text(json.dumps(manifest))
    assert main(words) == 2
    assert told in " ".join(capsys.readouterr().err.split())
    assert (tmp_path / "there.json").read_text() == "mine"


def test_an_interrupted_evaluation_tells_what_is_done_and_that_it_is_not_all(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    most = 0

    def watch(_: object, __: object, ___: object, seeds: list[int], **____: object) -> dict[str, Tally]:
        [seed] = seeds
        if seed >= 900_000 + most:
            raise KeyboardInterrupt
        return {"slim": Tally(rows=[(0, 0, False)], latency_s=[0.01])}

    monkeypatch.setattr("bracket_lab.evaluations.actions.evaluate_actions", watch)
    words = ["--kind", "slim", "--seeds", "900000:900003", "--json", "--out", str(tmp_path / "rows.jsonl")]
    for most, status in ((0, 1), (2, 1), (3, 0)):
        assert main(["lab", "eval", "actions", *words]) == status
        told = capsys.readouterr()
        assert ("interrupted after" in told.err) == bool(status)
        lines = [json.loads(line) for line in told.out.splitlines()]
        assert [line["recordings"] for line in lines] == [most] * bool(most)
    assert len((tmp_path / "rows.jsonl").read_text().splitlines()) == 1 + 3
