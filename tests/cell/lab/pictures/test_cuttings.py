"""Photographs of parts on a plain sheet become pictures with boxes, and what cannot be cut out is told."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest

from bracket_cell.commands.main import main
from bracket_cell.configuration import load_configuration, load_product
from bracket_ground.errors import InputError
from bracket_lab.learned.parts.data import load_scenes
from bracket_lab.pictures.cuttings import cut, cuttings_of

PRODUCT = load_product(load_configuration())
RGB = {"o1": (190, 60, 40), "o2": (40, 90, 190), "o3": (40, 150, 70)}
SIZE = 320, 240


def sheet(file: Path, colour: tuple[int, int, int], seed: int, *, parts: int = 1, at_edge: bool = False) -> None:
    """A part of two sides on a white sheet with a gradient and noise."""
    rng = np.random.default_rng(seed)
    image = np.full((SIZE[1], SIZE[0], 3), 225.0) - np.linspace(0, 12, SIZE[0])[np.newaxis, :, np.newaxis]
    for number in range(parts):
        middle = (2.0, 120.0) if at_edge else (100.0 + 120 * number, 120.0)
        corners = cv2.boxPoints((middle, (70.0, 40.0), float(rng.uniform(0, 180)))).astype(np.int32)
        cv2.fillPoly(image, [corners], colour)
    noisy = image + rng.normal(0, 2, image.shape)
    file.parent.mkdir(parents=True, exist_ok=True)
    cv2.imwrite(str(file), np.clip(noisy, 0, 255).astype(np.uint8)[..., ::-1])


@pytest.fixture
def sheets(tmp_path: Path) -> Path:
    for part in PRODUCT.parts:
        for number in range(3):
            sheet(tmp_path / "sheets" / part / f"{number}.jpg", RGB[part], number)
    return tmp_path / "sheets"


def test_the_part_alone_is_cut_out(sheets: Path) -> None:
    one = cut(sheets / "o1" / "0.jpg")
    covered = one.mask > 0.5
    assert covered.sum() == pytest.approx(70 * 40, rel=0.05)
    assert np.abs(np.median(one.image[covered], axis=0) - RGB["o1"]).max() < 8


@pytest.mark.parametrize(
    ("wrong", "told"),
    [({"parts": 0}, "no part stands out"), ({"parts": 2}, "several things"), ({"at_edge": True}, "reaches the edge")],
)
def test_what_cannot_be_cut_out_is_told(tmp_path: Path, wrong: dict[str, int], told: str) -> None:
    sheet(tmp_path / "one.png", RGB["o1"], 1, **wrong)  # type: ignore[arg-type]
    with pytest.raises(InputError, match=told):
        cut(tmp_path / "one.png")


def test_a_type_without_photographs_is_named(sheets: Path) -> None:
    for file in (sheets / "o2").iterdir():
        file.unlink()
    with pytest.raises(
        InputError, match=r"nothing could be cut out for o2; legal: a folder for each type \(o1, o2, o3"
    ):
        cuttings_of(sheets, PRODUCT)


def test_pasted_parts_lie_where_their_boxes_say_and_groups_of_photographs_stay_apart(
    sheets: Path, tmp_path: Path
) -> None:
    sheet(sheets / "o1" / "two.jpg", RGB["o1"], 9, parts=2)
    out = tmp_path / "pasted"
    assert main(["lab", "data", "sheets", str(sheets), "--out", str(out), "--count", "9"]) == 0
    scenes = load_scenes([out], PRODUCT)
    assert len(scenes) == 9
    assert {scene.log for scene in scenes} == {"sheet-0", "sheet-1", "sheet-2"}
    labels = [(scene, label) for scene in scenes for label in scene.labels]
    assert len(labels) >= 12
    alike = 0
    for scene, label in labels:
        column, row = label.centre_px.round().astype(int)
        if 3 < row < scene.image.shape[0] - 3 and 3 < column < scene.image.shape[1] - 3:
            seen = scene.image[row, column].astype(float)
            wanted = np.array(RGB[label.part], float)
            alike += float(seen @ wanted / np.linalg.norm(seen) / np.linalg.norm(wanted)) > 0.97
        else:
            alike += 1
    assert alike >= 0.8 * len(labels), "others may cover a middle"
