"""Labels written for other programs: COCO, YOLO, Pascal VOC and CVAT for images, with the categories of the product."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path, PurePosixPath
from typing import Any
from xml.etree import ElementTree

import yaml

from bracket_cell.learned.hands.regions import POINTS
from bracket_cell.learned.records import Box
from bracket_ground.errors import InputError
from bracket_ground.files.files import write_new, write_whole
from bracket_lab.pictures.labels import COVERED, EMPTY, HAND, HOLE, IMAGES, LabelFolder, PictureLabels, Size, categories

HOLE_PX = 12.0  # half the side of the box that stands for a hole
VOC = "voc:"  # before a folder's name
SIDES, CVAT_SIDES = ("xmin", "ymin", "xmax", "ymax"), ("xtl", "ytl", "xbr", "ybr")
LEGAL_EXPORTS = f"FILE.json for COCO, FILE.xml for CVAT, a new folder for YOLO, {VOC}FOLDER for Pascal VOC"

HolesPx = Mapping[str, Mapping[str, tuple[float, float]]]


@dataclass(frozen=True)
class Labelled:
    """A picture with its boxes.

    Attributes:
        boxes: category, (left, top, right, bottom) [px], and keypoints as COCO has them, of each.
    """

    file: str
    size_px: Size
    boxes: tuple[tuple[str, Box, tuple[float, ...]], ...]


def write_labels(folder: LabelFolder, target: str, holes_px: HolesPx) -> int:
    """Write the labels of all pictures that have some; returns how many these are.

    Args:
        target: one of LEGAL_EXPORTS.
        holes_px: by file, where the holes are.

    Raises:
        InputError: the files cannot be written, or a folder holds them already.
    """
    pictures = [
        Labelled(row.file, folder.size_px(row), tuple(_boxes(labels, holes_px.get(row.file, {}))))
        for row in folder.pictures
        if (labels := folder.labels.get(row.file)) is not None
    ]
    names, path = categories(folder.product), Path(target.removeprefix(VOC))
    if not path.name:
        raise InputError(f"--export {target}: names no file or folder; legal: {LEGAL_EXPORTS}")
    if target.startswith(VOC):
        write_new(path, {f"Annotations/{Path(picture.file).stem}.xml": _voc(picture) for picture in pictures})
    elif path.suffix.lower() == ".json":
        write_whole(path, json.dumps(_coco(pictures, names)).encode())
    elif path.suffix.lower() == ".xml":
        write_whole(path, _cvat(pictures, names))
    else:
        fields = {"path": str(folder.path.resolve()), "train": IMAGES, "val": IMAGES, "names": dict(enumerate(names))}
        boxes = {f"labels/{Path(picture.file).stem}.txt": _yolo(picture, names) for picture in pictures}
        write_new(path, {"data.yaml": yaml.safe_dump(fields, sort_keys=False).encode(), **boxes})
    return len(pictures)


def _coco(pictures: Sequence[Labelled], names: Sequence[str]) -> dict[str, Any]:
    images, found = [], list[dict[str, Any]]()
    for number, picture in enumerate(pictures, 1):
        width, height = picture.size_px
        images.append({"id": number, "file_name": picture.file, "width": width, "height": height})
        for name, (left, top, right, bottom), points in picture.boxes:
            fields = {"bbox": [left, top, right - left, bottom - top], "area": (right - left) * (bottom - top)}
            key = {"keypoints": points, "num_keypoints": sum(value > 0 for value in points[2::3])} if points else {}
            of = {"id": len(found) + 1, "image_id": number, "category_id": names.index(name) + 1, "iscrowd": 0}
            found.append({**of, **fields, **key})
    named: list[dict[str, Any]] = [{"id": number, "name": name} for number, name in enumerate(names, 1)]
    named[names.index(HAND)]["keypoints"] = list(POINTS)
    return {"images": images, "categories": named, "annotations": found}


def _yolo(picture: Labelled, names: Sequence[str]) -> bytes:
    (width, height), lines = picture.size_px, []
    for name, (left, top, right, bottom), _ in picture.boxes:
        middle = (left + right) / 2 / width, (top + bottom) / 2 / height
        shares = (*middle, (right - left) / width, (bottom - top) / height)
        lines.append(f"{names.index(name)} " + " ".join(f"{share:.6f}" for share in shares))
    return "".join(f"{line}\n" for line in lines).encode()


def _voc(picture: Labelled) -> bytes:
    root = ElementTree.Element("annotation")
    _texts(root, filename=PurePosixPath(picture.file).name)
    _texts(ElementTree.SubElement(root, "size"), width=picture.size_px[0], height=picture.size_px[1], depth=3)
    for name, box, _ in picture.boxes:
        thing = ElementTree.SubElement(root, "object")
        _texts(thing, name=name, pose="Unspecified", truncated=0, difficult=0)
        _texts(
            ElementTree.SubElement(thing, "bndbox"), **{side: f"{at:.2f}" for side, at in zip(SIDES, box, strict=True)}
        )
    return _xml(root)


def _cvat(pictures: Sequence[Labelled], names: Sequence[str]) -> bytes:
    root = ElementTree.Element("annotations")
    _texts(root, version="1.1")
    task = ElementTree.SubElement(ElementTree.SubElement(root, "meta"), "task")
    labels = ElementTree.SubElement(task, "labels")
    for name in names:
        _texts(ElementTree.SubElement(labels, "label"), name=name)
    for number, picture in enumerate(pictures):
        size = {"width": str(picture.size_px[0]), "height": str(picture.size_px[1])}
        fields = {"id": str(number), "name": PurePosixPath(picture.file).name, **size}
        image = ElementTree.SubElement(root, "image", fields)
        for name, box, _ in picture.boxes:
            sides = {side: f"{at:.2f}" for side, at in zip(CVAT_SIDES, box, strict=True)}
            ElementTree.SubElement(image, "box", {"label": name, "occluded": "0", **sides, "z_order": "0"})
    return _xml(root)


def _texts(parent: ElementTree.Element, **texts: object) -> None:
    for tag, text in texts.items():
        ElementTree.SubElement(parent, tag).text = str(text)


def _xml(root: ElementTree.Element) -> bytes:
    ElementTree.indent(root)
    return bytes(ElementTree.tostring(root, encoding="utf-8", xml_declaration=True))


def _boxes(
    labels: PictureLabels, holes_px: Mapping[str, tuple[float, float]]
) -> Iterator[tuple[str, Box, tuple[float, ...]]]:
    for part in labels.parts:
        if part.whole_box_px is not None:
            yield part.part, part.whole_box_px, ()
    for hand in labels.hands:
        points = [hand.points_px.get(name) for name in POINTS]
        flat = tuple(value for at in points for value in ((*at, 2.0) if at is not None else (0.0, 0.0, 0.0)))
        yield HAND, hand.box_px, flat if hand.points_px else ()
    for hole in labels.holes:
        x, y = holes_px[hole.position]
        name = COVERED if hole.covered > 0.5 else hole.part or EMPTY
        yield f"{HOLE}{name}", (x - HOLE_PX, y - HOLE_PX, x + HOLE_PX, y + HOLE_PX), ()
