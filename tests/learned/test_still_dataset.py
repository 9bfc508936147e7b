"""Labelled images: what is no file of them is told with its name and line."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from bracket_cell.configuration import load_configuration, load_product
from bracket_ground.errors import InputError
from bracket_lab.learned.holes.evaluate import load_plates
from bracket_lab.learned.parts.data import load_scenes

PRODUCT = load_product(load_configuration())
POSE: dict[str, Any] = {"position_m": [0.0, 0.0, 1.0], "quaternion_wxyz": [0.0, 1.0, 0.0, 0.0]}
TAKEN = {"file": "a.png", "log": "one", "true_camera": {**POSE, "focal_px": 400.0}, "world_from_camera": POSE}
HOLES: list[dict[str, Any]] = [{"position": name, "part": None} for name in PRODUCT.positions]
PART = {"part": "o1", "posture": "lying", "world_from_part": POSE | {"position_m": [0, 0, 0]}, "visible_px": 5}
Change = Callable[[dict[str, Any]], object]


def written(folder: Path, what: str, *rows: object) -> Path:
    cv2.imwrite(str(folder / "a.png"), np.zeros((60, 80, 3), np.uint8))
    lines = [json.dumps({"format": f"cell.{what}", "version": 1}), *(json.dumps(row) for row in rows)]
    (folder / f"{what}.jsonl").write_text("\n".join(lines) + "\n")
    return folder


def refused(folder: Path, load: Callable[[], object]) -> str:
    with pytest.raises(InputError) as told:
        load()
    assert str(told.value).startswith(str(folder))
    return str(told.value)


@pytest.mark.parametrize("content", [b"\xff\xfe\x00\x01", b"\x89PNG\r\n\x1a\n\x00\x80"])
def test_a_binary_file_is_told_by_its_name(tmp_path: Path, content: bytes) -> None:
    (tmp_path / "plates.jsonl").write_bytes(content)
    with pytest.raises(InputError, match=r"plates\.jsonl.*cell label DIR"):
        load_plates([tmp_path], PRODUCT)


def test_a_missing_file_says_how_it_is_made(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="cell label DIR, or cell lab data objects --out DIR"):
        load_scenes([tmp_path], PRODUCT)


@pytest.mark.parametrize("line", ["{", "[]", '{"log": "a"}', json.dumps(TAKEN | {"file": "nothing.png", "holes": []})])
def test_a_wrong_row_is_told_by_its_line(tmp_path: Path, line: str) -> None:
    folder = written(tmp_path, "plates", TAKEN | {"holes": HOLES})
    with (folder / "plates.jsonl").open("a") as file:
        file.write(line + "\n")
    with pytest.raises(InputError, match=r"plates\.jsonl:3"):
        load_plates([folder], PRODUCT)


@pytest.mark.parametrize(
    ("change", "told"),
    [
        (lambda holes: holes[0].update(part="valve"), "p1: no part 'valve'; legal: o1, o2, o3"),
        (lambda holes: holes[5].update(position="p9"), "no position 'p9'"),
        (lambda holes: holes.pop(), "p6 missing"),
        (lambda holes: holes[1].update(position="p1"), "p1 stands there twice"),
        (lambda holes: holes[0].update(covered=7), r"holes\.0\.covered"),
        (lambda holes: holes[0].update(upright="no"), r"holes\.0\.upright"),
        (lambda holes: holes[0].update(colour="red"), r"holes\.0\.colour"),
    ],
)
def test_every_wrong_label_of_a_hole_is_told(
    tmp_path: Path, change: Callable[[list[dict[str, Any]]], object], told: str
) -> None:
    holes = json.loads(json.dumps(HOLES))
    change(holes)
    with pytest.raises(InputError, match=rf"plates\.jsonl:2: .*{told}"):
        load_plates([written(tmp_path, "plates", TAKEN | {"holes": holes})], PRODUCT)


def test_a_hole_is_found_by_its_name(tmp_path: Path) -> None:
    holes = [hole | {"part": "o2" if hole["position"] == "p2" else None} for hole in HOLES]
    for number, given in enumerate((holes, holes[::-1])):
        (tmp_path / str(number)).mkdir()
        [plate] = load_plates([written(tmp_path / str(number), "plates", TAKEN | {"holes": given})], PRODUCT)
        assert [hole.part for hole in plate.holes] == [None, "o2", None, None, None, None]


@pytest.mark.parametrize(
    ("change", "told"),
    [
        ({"posture": "standing"}, r"parts\.0\.posture"),
        ({"visible_px": -5}, r"parts\.0\.visible_px"),
        ({"part": "valve"}, r"parts\.0: no part 'valve'; legal: o1, o2, o3, unknown"),
        ({"world_from_part": POSE | {"position_m": [0, 0, 1.5]}}, "behind the camera"),
        ({"whole_box_px": [9, 9, 3, 20]}, r"parts\.0\.whole_box_px"),
        ({"on": [4]}, r"parts\.0\.on"),
    ],
)
def test_every_wrong_label_of_a_part_is_told(tmp_path: Path, change: dict[str, Any], told: str) -> None:
    row = TAKEN | {"parts": [PART | {"whole_box_px": [3, 3, 20, 20]} | change]}
    with pytest.raises(InputError, match=rf"objects\.jsonl:2: .*{told}"):
        load_scenes([written(tmp_path, "objects", row)], PRODUCT)


def test_a_type_and_a_box_are_enough(tmp_path: Path) -> None:
    row = TAKEN | {"parts": [{"part": "o1", "whole_box_px": [3, 5, 21, 25]}]}
    [scene] = load_scenes([written(tmp_path, "objects", row)], PRODUCT)
    [label] = scene.labels
    assert label.pose is None
    assert label.upright is None
    assert label.centre_px.tolist() == [12, 15]
    assert label.shown == 1
