"""Labels as COCO has them: a category for each type of part, for hands, and for what a hole holds."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from pydantic import ConfigDict, ValidationError

from bracket_cell.learned.hands.records import HandRow
from bracket_cell.learned.hands.regions import POINTS
from bracket_cell.learned.holes.records import Hole
from bracket_cell.learned.parts.records import UNKNOWN, PartRow
from bracket_cell.learned.records import mistakes
from bracket_cell.pictures.labels import LabelFolder, PictureLabels
from bracket_ground.errors import InputError, Place, Problem
from bracket_ground.files.files import read_text, write_whole
from bracket_ground.files.model import Model
from bracket_ground.interfaces.product import Product

HAND, HOLE, EMPTY, COVERED = "hand", "hole ", "empty", "covered"
NEAREST_PX = 12.0  # from the middle of a box to the hole that it is of
HOLE_PX = 12.0  # half the side of the box that stands for a hole


class _Some(Model):
    """Keys that COCO has besides are passed over."""

    model_config = ConfigDict(extra="ignore")


class Picture(_Some):
    """An image of the file."""

    id: int
    file_name: str


class Category(_Some):
    """A name for some boxes."""

    id: int
    name: str


class Annotation(_Some):
    """A box (left, top, width, height), and where there are any the key points of a hand."""

    id: int = 0
    image_id: int
    category_id: int
    bbox: tuple[float, float, float, float]
    keypoints: tuple[float, ...] = ()


class CocoFile(_Some):
    """The file."""

    images: tuple[Picture, ...]
    categories: tuple[Category, ...]
    annotations: tuple[Annotation, ...]


def categories(product: Product) -> tuple[str, ...]:
    """All names, the first with the number 1."""
    parts = (*product.parts, UNKNOWN)
    return (*parts, HAND, *(f"{HOLE}{name}" for name in (EMPTY, COVERED, *product.parts)))


def write_coco(folder: LabelFolder, path: Path, holes_px: Mapping[str, Mapping[str, tuple[float, float]]]) -> int:
    """Write the labels of all pictures that have some; returns how many these are.

    Args:
        holes_px: by file, where the holes are.
    """
    names = categories(folder.product)
    images, found = [], list[dict[str, Any]]()
    for number, row in enumerate(folder.pictures, 1):
        if (labels := folder.labels.get(row.file)) is None:
            continue
        height, width = folder.image(row).shape[:2]
        images.append({"id": number, "file_name": row.file, "width": width, "height": height})
        for name, box, points in _boxes(labels, holes_px.get(row.file, {})):
            left, top, right, bottom = box
            told = {"bbox": [left, top, right - left, bottom - top], "area": (right - left) * (bottom - top)}
            key = {"keypoints": points, "num_keypoints": sum(value > 0 for value in points[2::3])} if points else {}
            of = {"id": len(found) + 1, "image_id": number, "category_id": names.index(name) + 1, "iscrowd": 0}
            found.append({**of, **told, **key})
    named = [{"id": number, "name": name} for number, name in enumerate(names, 1)]
    named[names.index(HAND)]["keypoints"] = list(POINTS)
    content = {"images": images, "categories": named, "annotations": found}
    write_whole(path, json.dumps(content).encode())
    return len(images)


def read_coco(
    folder: LabelFolder, path: Path, holes_px: Mapping[str, Mapping[str, tuple[float, float]]]
) -> dict[str, PictureLabels]:
    """The labels of a file, by picture of the folder; files are known by their names alone, wherever they lie.

    Raises:
        InputError: it is no such file, or names pictures or categories that nobody knows.
    """
    try:
        read = CocoFile.model_validate_json(read_text(path))
    except ValidationError as error:
        raise InputError(*(Problem(Place(path), what) for what in mistakes(error)[:20])) from None
    files = {Path(row.file).name: row.file for row in folder.pictures}
    image_of = {one.id: files.get(Path(one.file_name).name) for one in read.images}
    name_of = {one.id: one.name for one in read.categories}
    legal, problems = categories(folder.product), list[str]()
    given: dict[str, list[tuple[str, Annotation]]] = {file: [] for file in image_of.values() if file is not None}
    problems += [f"images: no picture {one.file_name} in {folder.path}" for one in read.images if not image_of[one.id]]
    for one in read.annotations:
        name, file = name_of.get(one.category_id, ""), image_of.get(one.image_id)
        if name not in legal:
            problems.append(f"annotation {one.id}: no category {name or one.category_id!r}; legal: {', '.join(legal)}")
        elif file is not None:
            given[file].append((name, one))
    found = {}
    for file, some in given.items():
        try:
            found[file] = _labels(some, holes_px.get(file, {}))
            folder.check(found[file])
        except ValueError as error:
            problems += [f"{file}: {what}" for what in mistakes(error)]
    if problems:
        raise InputError(*(Problem(Place(path), what) for what in problems[:20]))
    return found


def _boxes(
    labels: PictureLabels, holes_px: Mapping[str, tuple[float, float]]
) -> Iterator[tuple[str, tuple[float, ...], list[float]]]:
    for part in labels.parts:
        if part.whole_box_px is not None:
            yield part.part, part.whole_box_px, []
    for hand in labels.hands:
        points = [hand.points_px.get(name) for name in POINTS]
        flat = [value for at in points for value in ((*at, 2.0) if at is not None else (0.0, 0.0, 0.0))]
        yield HAND, hand.box_px, flat if hand.points_px else []
    for hole in labels.holes:
        x, y = holes_px[hole.position]
        name = COVERED if hole.covered > 0.5 else hole.part or EMPTY
        yield f"{HOLE}{name}", (x - HOLE_PX, y - HOLE_PX, x + HOLE_PX, y + HOLE_PX), []


def _labels(given: Sequence[tuple[str, Annotation]], holes_px: Mapping[str, tuple[float, float]]) -> PictureLabels:
    holes, hands, parts = [], [], []
    for name, one in given:
        left, top, width, height = one.bbox
        box = (left, top, left + width, top + height)
        if name == HAND:
            points = np.array(one.keypoints).reshape(-1, 3)[: len(POINTS)]
            known = {name: (x, y) for name, (x, y, shown) in zip(POINTS, points.tolist(), strict=False) if shown > 0}
            hands.append(HandRow(box_px=box, points_px=known, known=False))
        elif name.startswith(HOLE):
            holes.append(_hole(name.removeprefix(HOLE), (left + width / 2, top + height / 2), holes_px, one.id))
        else:
            parts.append(PartRow(part=name, whole_box_px=box))
    return PictureLabels(holes=tuple(holes), hands=tuple(hands), parts=tuple(parts))


def _hole(what: str, middle: tuple[float, float], holes_px: Mapping[str, tuple[float, float]], number: int) -> Hole:
    away = {name: float(np.hypot(x - middle[0], y - middle[1])) for name, (x, y) in holes_px.items()}
    nearest = min(away, key=lambda name: away[name])
    if away[nearest] > NEAREST_PX:
        raise ValueError(f"annotation {number}: is {away[nearest]:.0f} px from the nearest hole, {nearest}")
    if what in (EMPTY, COVERED):
        return Hole(position=nearest, part=None, covered=float(what == COVERED))
    return Hole(position=nearest, part=what)
