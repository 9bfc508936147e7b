"""Pictures of one's own: kept with their calibration, labelled as typed rows, exchanged as COCO."""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from bracket_cell.commands.main import main
from bracket_cell.learned.hands.records import HandRow
from bracket_cell.learned.records import Hole, PartRow
from bracket_ground.errors import InputError
from bracket_lab.learned.hands.data import frames_of
from bracket_lab.learned.holes.evaluate import load_plates
from bracket_lab.learned.parts.data import load_scenes
from bracket_lab.pictures.labels import LabelFolder, PictureLabels
from bracket_lab.pictures.scoring import apart, objection
from tests.cell.lab.pictures.drawn import BENCH, PRODUCT, photograph_plate, photograph_tray

HOLES = tuple(Hole(position=name, part="o1" if name == "p2" else None) for name in PRODUCT.positions)
HAND = HandRow(box_px=(10.0, 10.0, 60.0, 80.0), points_px={"palm": (30.0, 40.0), "pinch": (35.0, 60.0)}, known=False)


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    for seed in range(4):
        photograph_plate(tmp_path / "photos" / f"{seed}.jpg", seed)
    assert main(["record", str(tmp_path / "photos"), "--out", str(tmp_path / "own")]) == 0
    return tmp_path / "own"


def test_photographs_are_kept_in_the_camera_s_size_with_its_calibration(folder: Path) -> None:
    read = LabelFolder(folder, PRODUCT)
    assert len(read.pictures) == 4
    assert read.image(read.pictures[0]).shape == (BENCH.overhead.height_px, BENCH.overhead.width_px, 3)
    assert read.pictures[0].true_camera.focal_px == BENCH.overhead.focal_px
    assert len({row.log for row in read.pictures}) == 4  # photographs are of recordings of their own


def test_a_photograph_of_another_shape_gets_borders_and_labels_no_holes(tmp_path: Path) -> None:
    cv2.imwrite(str(tmp_path / "tall.png"), np.full((400, 100, 3), 200, np.uint8))
    assert main(["record", str(tmp_path / "tall.png"), "--out", str(tmp_path / "own")]) == 0
    read = LabelFolder(tmp_path / "own", PRODUCT)
    (row,) = read.pictures
    assert row.source_px == (100, 400)
    wide, high = BENCH.overhead.width_px, BENCH.overhead.height_px
    image = read.image(row)
    assert image.shape == (high, wide, 3)
    assert (image[:, wide // 2] == 200).all()  # all of its height shows, in the middle
    assert (image == 200).all(axis=2)[0].sum() == pytest.approx(high / 4, abs=1)
    read.save(row.file, PictureLabels(hands=(HAND,)))
    with pytest.raises(ValueError, match="of another camera"):
        read.save(row.file, PictureLabels(holes=HOLES))


def test_a_video_is_kept_in_pieces(tmp_path: Path) -> None:
    size = BENCH.overhead.width_px, BENCH.overhead.height_px
    writer = cv2.VideoWriter(str(tmp_path / "film.avi"), cv2.VideoWriter.fourcc(*"MJPG"), 15.0, size)
    for level in range(60):
        writer.write(np.full((size[1], size[0], 3), level, np.uint8))
    writer.release()
    assert main(["record", str(tmp_path / "film.avi"), "--every", "2", "--out", str(tmp_path / "own")]) == 0
    rows = LabelFolder(tmp_path / "own", PRODUCT).pictures
    assert [row.log for row in rows] == ["film-000"] * 20 + ["film-001"] * 10


def test_labels_are_rows_that_trainings_read(folder: Path) -> None:
    read = LabelFolder(folder, PRODUCT)
    first, second = (row.file for row in read.pictures[:2])
    read.save(first, PictureLabels(holes=HOLES, hands=(HAND,)))
    read.save(second, PictureLabels())  # neither plate nor hand
    [plate] = load_plates([folder], PRODUCT)
    assert [hole.part for hole in plate.holes] == [None, "o1", None, None, None, None]
    frames = frames_of(folder, tuple(PRODUCT.parts))
    assert [len(frame.row.hands) for frame in frames] == [1, 0]
    assert frames[0].row.hands[0] == HAND
    again = LabelFolder(folder, PRODUCT)
    assert again.labels == read.labels


@pytest.mark.parametrize(
    ("labels", "told"),
    [
        (PictureLabels(holes=HOLES[:5]), "p6 missing"),
        (
            PictureLabels(parts=(PartRow(part="o1", whole_box_px=(1, 1, 9, 9)),)),
            "parts: go with pictures of the wrist camera",
        ),
        (PictureLabels(hands=(HandRow(box_px=(9, 9, 1, 1)),)), "a box of"),
        (PictureLabels(hands=(HandRow(box_px=(1, 1, 9, 9), held_part="valve"),)), "no part 'valve'"),
    ],
)
def test_labels_that_do_not_fit_are_refused(folder: Path, labels: PictureLabels, told: str) -> None:
    read = LabelFolder(folder, PRODUCT)
    with pytest.raises(ValueError, match=told):
        read.save(read.pictures[0].file, labels)
    assert not (folder / "plates.jsonl").exists()


def test_coco_brings_back_what_it_was_given(folder: Path, tmp_path: Path) -> None:
    read, coco = LabelFolder(folder, PRODUCT), tmp_path / "coco.json"
    covered = (*HOLES[:5], Hole(position="p6", part=None, covered=1.0))
    read.save(read.pictures[0].file, PictureLabels(holes=covered, hands=(HAND,)))
    assert main(["label", str(folder), "--export", str(coco)]) == 0
    for name in ("plates.jsonl", "hands.jsonl"):
        (folder / name).unlink()
    assert main(["label", str(folder), "--import", str(coco)]) == 0
    labels = LabelFolder(folder, PRODUCT).labels[read.pictures[0].file]
    assert [(hole.part, hole.covered) for hole in labels.holes] == [(hole.part, hole.covered) for hole in covered]
    assert labels.hands == (HAND,)


@pytest.mark.parametrize(
    ("change", "told"),
    [
        ({"category_id": 99}, "annotation 1: no category 'number 99' .1 boxes.; legal: o1"),
        ({"bbox": [1, 1, 4, 4]}, "annotation 1: is .* px from the nearest hole"),
        ({"bbox": [1, 1]}, r"annotations\.0\.bbox"),
    ],
)
def test_what_is_wrong_in_a_coco_file_is_told(
    folder: Path, tmp_path: Path, change: dict[str, Any], told: str, capsys: pytest.CaptureFixture[str]
) -> None:
    read, coco = LabelFolder(folder, PRODUCT), tmp_path / "coco.json"
    read.save(read.pictures[0].file, PictureLabels(holes=HOLES))
    main(["label", str(folder), "--export", str(coco)])
    content = json.loads(coco.read_text())
    content["annotations"][0] |= change
    coco.write_text(json.dumps(content))
    capsys.readouterr()
    assert main(["label", str(folder), "--import", str(coco)]) == 2
    assert re.search(told, capsys.readouterr().err)


def test_boxes_of_parts_are_enough(tmp_path: Path) -> None:
    drawn = photograph_tray(tmp_path / "photos" / "1.png", 1)
    assert main(["record", str(tmp_path / "photos"), "--camera", "wrist", "--out", str(tmp_path / "own")]) == 0
    read = LabelFolder(tmp_path / "own", PRODUCT)
    parts = tuple(PartRow(part=name, whole_box_px=box) for name, box in drawn.parts)
    read.save(read.pictures[0].file, PictureLabels(parts=parts))
    [scene] = load_scenes([tmp_path / "own"], PRODUCT)
    assert [label.part for label in scene.labels] == [name for name, _ in drawn.parts]
    assert all(label.pose is None for label in scene.labels)


def test_weights_that_are_worth_nothing_are_not_recommended() -> None:
    assert objection({"right": 0.9, "right_classical": 0.8}) is None
    assert "the classical detector has 0.950" in str(objection({"right": 0.9, "right_classical": 0.95}))
    assert "the commonest answer has 0.600" in str(objection({"accuracy": 0.5, "accuracy_trivial": 0.6}))
    assert "answer nothing" in str(objection({"map_50": 0.0, "map_50_classical": 0.0}))
    assert "which is poor: label more pictures" in str(objection({"map_50": 0.04, "map_50_classical": 0.0}))
    assert "answer nothing" in str(objection({"validation_said": 0.0}))


def test_one_recording_alone_cannot_be_scored() -> None:
    assert len(apart(["a", "b", "c"], 0.2, 0)) == 1
    with pytest.raises(InputError, match="1 recording alone"):
        apart(["a", "a"], 0.2, 0)
