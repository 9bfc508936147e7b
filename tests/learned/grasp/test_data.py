"""Data sets of scenes: what is written is read, and what is wrong is named with its line."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from bracket_cell.learned.grasp.records import DetectionRecord, SceneRecord, write_records
from bracket_ground.errors import InputError
from bracket_lab.learned.grasp.data import read_scenes, write_scenes
from bracket_lab.learned.grasp.scenes import data_hash, draw_scenes
from tests.learned.grasp.layouts import PRODUCT, chain, walled

SOURCE = "a test"


@pytest.fixture
def file(tmp_path: Path) -> Path:
    path = tmp_path / "scenes.jsonl"
    write_scenes(path, draw_scenes(PRODUCT, 3, 5, "train"), PRODUCT, SOURCE)
    return path


def change(path: Path, line: int, text: str) -> None:
    lines = path.read_text().splitlines()
    lines[line - 1] = text
    path.write_text("\n".join(lines) + "\n")


def changed_scene(path: Path, line: int, **values: object) -> str:
    return json.dumps(json.loads(path.read_text().splitlines()[line - 1]) | values)


def test_what_is_written_is_read(file: Path) -> None:
    drawn, read = list(draw_scenes(PRODUCT, 3, 5, "train")), read_scenes(file, PRODUCT)
    assert data_hash(read) == data_hash(drawn)
    assert [part.box_px for scene in read for part in scene.parts] == [p.box_px for s in drawn for p in s.parts]
    assert read[0].noise == drawn[0].noise


def test_missing_labels_come_from_the_truth(file: Path) -> None:
    labelled = read_scenes(file, PRODUCT)
    for line in range(2, 7):
        change(file, line, changed_scene(file, line, blockers=None))
    assert all(np.array_equal(a.blocks, b.blocks) for a, b in zip(labelled, read_scenes(file, PRODUCT), strict=True))


def test_labels_without_truth_are_enough(tmp_path: Path) -> None:
    detections = tuple(DetectionRecord.of(part) for part in chain())
    record = SceneRecord(detections=detections, blockers=({"width": (1,)}, {"width": (2,)}, {"width": ()}))
    path = tmp_path / "recorded.jsonl"
    write_records(path, [record], PRODUCT, SOURCE)
    (scene,) = read_scenes(path, PRODUCT)
    assert scene.solution(0).text == "move c and b"


def test_scenes_without_truth_or_labels_are_read_but_not_for_training(tmp_path: Path) -> None:
    path = tmp_path / "recorded.jsonl"
    record = SceneRecord(detections=tuple(DetectionRecord.of(part) for part in walled("o1", "o3")))
    write_records(path, [record], PRODUCT, SOURCE)
    read = SceneRecord.model_validate_json(path.read_text().splitlines()[1])
    assert tuple(detection.detection() for detection in read.detections) == walled("o1", "o3")
    with pytest.raises(InputError, match=r"recorded.jsonl:2: no truth and no blockers"):
        read_scenes(path, PRODUCT)


def test_every_mistake_is_named_with_its_line(file: Path) -> None:
    change(file, 2, "{broken")
    change(file, 3, changed_scene(file, 3, colour="red"))
    change(file, 4, changed_scene(file, 4, truth=[]))
    change(file, 5, changed_scene(file, 5, blockers=[{"width": [99]}]))
    with pytest.raises(InputError) as caught:
        read_scenes(file, PRODUCT)
    message = str(caught.value)
    for expected in (":2: Invalid JSON", ":3: colour: Extra", ":4: 0 entries of 'truth'", "; part 0, width: [99]"):
        assert expected in message
    assert ":6:" not in message


def test_other_files_and_other_products_are_refused(file: Path, tmp_path: Path) -> None:
    with pytest.raises(InputError, match="cannot be read"):
        read_scenes(tmp_path / "nothing.jsonl", PRODUCT)
    other = tmp_path / "other.jsonl"
    other.write_text('{"format": "cell.grasp.scenes", "version": 2, "parts": [], "source": ""}\n')
    with pytest.raises(InputError, match=r"other.jsonl:1: version"):
        read_scenes(other, PRODUCT)
    change(file, 1, changed_scene(file, 1, parts=["x1"]))
    with pytest.raises(InputError, match=r":1: scenes of part types x1; the product has o1, o2, o3"):
        read_scenes(file, PRODUCT)


def test_a_file_without_scenes_is_refused(file: Path) -> None:
    file.write_text(file.read_text().splitlines()[0] + "\n")
    with pytest.raises(InputError, match="holds no scenes"):
        read_scenes(file, PRODUCT)


@pytest.mark.torch
def test_scenes_of_one_run_stay_together() -> None:
    from bracket_lab.learned.grasp.train import split_by_run

    drawn = list(draw_scenes(PRODUCT, 9, 30, "train"))
    recorded = [replace(scene, run=f"run {number // 6}") for number, scene in enumerate(drawn)]
    learned, kept = split_by_run(recorded, 0)
    assert {scene.run for scene in learned}.isdisjoint({scene.run for scene in kept})
    assert (len(learned), len(kept)) == (24, 6)
    assert len(split_by_run(drawn, 0)[1]) == 6
    with pytest.raises(InputError, match="12 scenes of 2 runs are too few"):
        split_by_run(recorded[:12], 0)


def test_the_run_of_a_scene_survives_the_file(tmp_path: Path) -> None:
    drawn = [replace(scene, run="monday") for scene in draw_scenes(PRODUCT, 9, 2, "train")]
    write_scenes(tmp_path / "scenes.jsonl", drawn, PRODUCT, "a test")
    assert [scene.run for scene in read_scenes(tmp_path / "scenes.jsonl", PRODUCT)] == ["monday", "monday"]
