"""A folder of pictures of one camera, and the labels that a person gives them, as rows that trainings read."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from bracket_cell.learned.hands.records import FrameRow, HandRow
from bracket_cell.learned.records import (
    UNKNOWN,
    Hole,
    PartRow,
    PlateRow,
    StillRow,
    TrayRow,
    holes_of,
    one_of,
    read_image,
    read_rows,
)
from bracket_ground.errors import InputError
from bracket_ground.files.data_folder import DataFolder
from bracket_ground.files.files import MANIFEST, whole_folder, write_whole
from bracket_ground.files.model import Model
from bracket_ground.interfaces.bench import Bench, CameraSetup
from bracket_ground.interfaces.frame import Frame
from bracket_ground.interfaces.observation import Image
from bracket_ground.interfaces.pose import Array, Pose
from bracket_ground.interfaces.product import Product
from bracket_lab.pictures.sources import Source, camera_pose

FRAMES, IMAGES = "frames", "images"
ROWS: Mapping[str, Mapping[str, type[Any]]] = {
    "overhead": {"plates": PlateRow, "hands": FrameRow},
    "wrist": {"objects": TrayRow},
}
BORDER = (110, 110, 110)  # grey, as regions of hands have it beyond an image
HAND, HOLE, EMPTY, COVERED = "hand", "hole ", "empty", "covered"  # categories in files of other programs
PIECE = 20  # pictures of a stream that are of one recording: kept for the scores together, or learned from together


Size = tuple[int, int]  # (width, height) in pixels


def categories(product: Product) -> tuple[str, ...]:
    """All categories of boxes in files of other programs: parts, hands, and what a hole holds."""
    parts = (*product.parts, UNKNOWN)
    return (*parts, HAND, *(f"{HOLE}{name}" for name in (EMPTY, COVERED, *product.parts)))


class PictureLabels(Model):
    """What a person says of one picture.

    Attributes:
        holes: all of the plate, or none where the picture is not to be learned from for holes.
        hands: none says that there is none.
    """

    holes: tuple[Hole, ...] = ()
    hands: tuple[HandRow, ...] = ()
    parts: tuple[PartRow, ...] = ()


def record(source: Source, out: Path, camera: str, bench: Bench, every: int, most: int | None, command: str) -> int:
    """Write frames and the camera's calibration into a new folder; returns how many.

    Args:
        every: which frames are kept: one of so many.
        most: of frames that are kept; None for all.

    Raises:
        InputError: the folder is not new.
    """
    setup = bench.overhead if camera == "overhead" else bench.wrist
    pose, kept = camera_pose(bench, camera), 0
    with whole_folder(out) as partial:
        folder = DataFolder(partial, command)
        for number, frame in enumerate(_chosen(source.frames, every, most)):
            title = source.title(frame.sequence)
            name = folder.image(f"{IMAGES}/{title}.png", fitted(frame.image, setup))
            log = title if source.files or source.single else f"{source.name}-{number // PIECE:03d}"
            size = frame.image.shape[1], frame.image.shape[0]
            bordered = {} if same_shape(size, (setup.width_px, setup.height_px)) else {"source_px": size}
            folder.row(FRAMES, {"file": name, "log": log, "camera": camera, **taken_by(setup, pose), **bordered})
            kept = number + 1
        folder.close({})
    return kept


def taken_by(setup: CameraSetup, pose: Pose) -> dict[str, Any]:
    """The camera of a row as it is calibrated."""
    fields = {"position_m": pose.position_m, "quaternion_wxyz": pose.quaternion_wxyz}
    lens = {name: value for name, value in asdict(setup.model).items() if not name.startswith(("width", "height"))}
    return {"world_from_camera": fields, "true_camera": {**fields, **lens}}


def fit_of(source_px: Size, wanted_px: Size) -> tuple[float, Array]:
    """By how much a picture is scaled, and how far aside (2,) it lies then, whole and in the middle of another size."""
    scale = min(wanted_px[0] / source_px[0], wanted_px[1] / source_px[1])
    return scale, (np.array(wanted_px) - scale * np.array(source_px)) / 2


def fitted(image: Image, setup: CameraSetup) -> Image:
    """The image in the size of the camera's; one of another shape has borders, and no calibration."""
    height, width = image.shape[:2]
    wanted = setup.width_px, setup.height_px
    if (width, height) == wanted:
        return image
    if same_shape((width, height), wanted):
        return np.asarray(cv2.resize(image, wanted, interpolation=cv2.INTER_AREA), np.uint8)
    scale, shift = fit_of((width, height), wanted)
    size = max(1, round(width * scale)), max(1, round(height * scale))
    small = cv2.resize(image, size, interpolation=cv2.INTER_AREA)
    left, top = (round(float(value)) for value in shift)
    room = wanted[1] - size[1] - top, wanted[0] - size[0] - left
    bordered = cv2.copyMakeBorder(small, top, room[0], left, room[1], cv2.BORDER_CONSTANT, value=BORDER)
    return np.asarray(bordered, np.uint8)


def same_shape(one_px: Size, other_px: Size) -> bool:
    """Whether a camera may have taken both: one is only larger."""
    return abs(one_px[0] * other_px[1] / (one_px[1] * other_px[0]) - 1) <= 0.01


def _chosen(frames: Iterator[Frame], every: int, most: int | None) -> Iterator[Frame]:
    for number, frame in enumerate(frames):
        if most is not None and number >= every * most:
            return
        if number % every == 0:
            yield frame


class LabelFolder:
    """Pictures of one camera and their labels.

    Attributes:
        pictures: how each was taken, in order.
        labels: by file, of those that a person has looked at.

    Raises:
        InputError: it is no folder of `cell record`, or its rows are wrong; with file and line.
    """

    def __init__(self, path: Path, product: Product) -> None:
        self.path, self.product = path, product
        how = "make one with: cell record SOURCE --out DIR"
        self.pictures = read_rows(path / f"{FRAMES}.jsonl", StillRow, _same, header=f"cell.{FRAMES}", how=how)
        cameras = {row.camera for row in self.pictures}
        if len(cameras) != 1 or not cameras <= set(ROWS):
            raise InputError(f"{path / FRAMES}.jsonl: must hold pictures of one camera, {' or '.join(ROWS)}")
        self.camera = cameras.pop()
        self.labels: dict[str, PictureLabels] = {}
        for name, row in ROWS[self.camera].items():
            if (path / f"{name}.jsonl").exists():
                read_rows(path / f"{name}.jsonl", row, self._keep, header=f"cell.{name}")

    def _keep(self, row: Any) -> None:
        own = self.labels.get(row.file, PictureLabels())
        given = {name: getattr(row, name) for name in PictureLabels.model_fields if hasattr(row, name)}
        labels = own.model_copy(update=given)
        self.check(labels)
        self.labels[row.file] = labels

    def image(self, row: StillRow) -> Image:
        """A picture, in RGB."""
        return read_image(self.path / row.file)

    def size_px(self, row: StillRow) -> Size:
        """(width, height) of a picture."""
        height, width = self.image(row).shape[:2]
        return width, height

    def check(self, labels: PictureLabels) -> None:
        """Raises ValueError where labels do not fit the product or the camera."""
        for name, given, camera in (("holes", labels.holes, "overhead"), ("hands", labels.hands, "overhead"),
                                    ("parts", labels.parts, "wrist")):  # fmt: skip
            if given and camera != self.camera:
                raise ValueError(
                    f"{name}: go with pictures of the {camera} camera; these are of the {self.camera} camera"
                )
        if labels.holes:
            holes_of(labels.holes, self.product)
        types = tuple(self.product.parts)
        for number, part in enumerate(labels.parts):
            one_of(f"parts.{number}: no part", part.part, (*types, UNKNOWN))
        for number, hand in enumerate(labels.hands):
            if hand.held_part is not None:
                one_of(f"hands.{number}: no part", hand.held_part, types)
        boxes = [hand.box_px for hand in labels.hands] + [part.whole_box_px for part in labels.parts]
        for box in boxes:
            if box is None or box[0] >= box[2] or box[1] >= box[3]:
                raise ValueError(f"a box of {box}: must be left, top, right, bottom, with right and bottom larger")

    def save(self, file: str, labels: PictureLabels) -> None:
        """Keep the labels of a picture, and write the rows of all.

        Raises:
            ValueError: they do not fit.
            InputError: a file cannot be written.
        """
        self.check(labels)
        if labels.holes and any(picture.file == file and picture.source_px for picture in self.pictures):
            raise ValueError("holes: are known by the camera's calibration, and this picture is of another camera")
        self.labels[file] = labels
        for name in ROWS[self.camera]:
            rows = [
                self._row(name, picture, self.labels[picture.file])
                for picture in self.pictures
                if picture.file in self.labels
            ]
            header = {"format": f"cell.{name}", "version": 1, "source": "cell label"}
            lines = [header, *(row for row in rows if row is not None)]
            write_whole(self.path / f"{name}.jsonl", "".join(json.dumps(line) + "\n" for line in lines).encode())
        facts = {"format": "cell.training_data", "version": 1, "made_by": "cell label", "labelled": len(self.labels)}
        write_whole(self.path / MANIFEST, (json.dumps(facts) + "\n").encode())

    def _row(self, name: str, picture: StillRow, labels: PictureLabels) -> dict[str, Any] | None:
        given: Sequence[Model] = {"plates": labels.holes, "hands": labels.hands, "objects": labels.parts}[name]
        if name == "plates" and not given:
            return None
        key = {"plates": "holes", "hands": "hands", "objects": "parts"}[name]
        rows = [model.model_dump(mode="json", exclude_unset=True) for model in given]
        return picture.model_dump(mode="json") | {key: rows}


def _same(row: StillRow) -> StillRow:
    return row
