"""Labelled stills of the plate (plates.jsonl of `cell data plates`)."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from cell.interfaces.camera_model import CameraModel
from cell.interfaces.errors import InputError
from cell.interfaces.pose import Pose

FILE = "plates.jsonl"


@dataclass(frozen=True)
class Hole:
    """What one hole holds.

    Attributes:
        part: type of the part in or on it; None where it is empty.
        covered: share of what is seen around it that hand, arm or a held part hides.
    """

    position: str
    part: str | None
    upright: bool
    covered: float


@dataclass(frozen=True)
class Plate:
    """One image of the plate.

    Attributes:
        log: the recording; its images are alike.
        image: (height, width, 3) RGB.
        camera, world_from_camera: the true lens, and where it truly was.
        believed: world_from_camera as the controller was told.
    """

    log: str
    image: NDArray[np.uint8]
    camera: CameraModel
    world_from_camera: Pose
    believed: Pose
    holes: tuple[Hole, ...]


def load_plates(folders: Sequence[Path]) -> list[Plate]:
    """All images of some folders.

    Raises:
        InputError: a file is missing or wrong; the message names file and line.
    """
    return [plate for folder in folders for plate in _load(folder)]


def data_hash(plates: Sequence[Plate]) -> str:
    """Hash of images and labels."""
    told = hashlib.sha256()
    for plate in plates:
        told.update(plate.image.tobytes())
        told.update(repr(plate.holes).encode())
    return told.hexdigest()


def _load(folder: Path) -> list[Plate]:
    path = folder / FILE
    try:
        lines = path.read_text(encoding="utf-8").splitlines()
    except OSError as error:
        raise InputError(f"{path}: cannot be read: {error.strerror or error}") from None
    plates = []
    for number, line in enumerate(lines[1:], start=2):
        try:
            plates.append(_plate(folder, json.loads(line)))
        except (KeyError, TypeError, ValueError) as error:
            what = f"no {error} in it" if isinstance(error, KeyError) else str(error)
            raise InputError(f"{path}:{number}: not a row of `cell data plates`: {what}") from None
    return plates


def _plate(folder: Path, row: dict[str, Any]) -> Plate:
    read = cv2.imread(str(folder / row["file"]), cv2.IMREAD_COLOR)
    if read is None:
        raise ValueError(f"{folder / row['file']} is no image")
    image = np.ascontiguousarray(read[..., ::-1], np.uint8)
    true = row["true_camera"]
    lens = true["focal_px"], true["distortion_k1"], true["distortion_k2"]
    camera = CameraModel(image.shape[1], image.shape[0], *lens)
    holes = tuple(Hole(hole["position"], hole["part"], hole["upright"], hole["covered"]) for hole in row["holes"])
    return Plate(row["log"], image, camera, _pose(true), _pose(row["world_from_camera"]), holes)


def _pose(entry: dict[str, Any]) -> Pose:
    x, y, z = entry["position_m"]
    w, a, b, c = entry["quaternion_wxyz"]
    return Pose((x, y, z), (w, a, b, c))
