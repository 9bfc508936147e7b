"""Labelled images of `cell data`: JSON lines beside the images, the first line about all of them."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeVar

import cv2
import numpy as np
from numpy.typing import NDArray

from cell.interfaces.camera_model import CameraModel
from cell.interfaces.errors import InputError
from cell.interfaces.pose import Pose


@dataclass(frozen=True)
class Still:
    """An image and how it was taken.

    Attributes:
        log: the recording or tray that it shows; images of one belong together.
        image: (height, width, 3) RGB.
        camera, world_from_camera: the true lens, and where it truly was.
        believed: world_from_camera as the controller was told.
    """

    log: str
    image: NDArray[np.uint8]
    camera: CameraModel
    world_from_camera: Pose
    believed: Pose


OneStill = TypeVar("OneStill", bound=Still)


def load_stills(
    folders: Sequence[Path], what: str, labelled: Callable[[Still, dict[str, Any]], OneStill]
) -> list[OneStill]:
    """All images of some folders.

    Args:
        what: the command `cell data WHAT` that made them, and the name of their file.
        labelled: adds the labels of a row.

    Raises:
        InputError: a file is missing or wrong; the message names file and line.
    """
    return [still for folder in folders for still in _load(folder, what, labelled)]


def data_hash(stills: Sequence[Still]) -> str:
    """Hash of images and labels."""
    told = hashlib.sha256()
    for still in stills:
        told.update(still.image.tobytes())
        told.update(repr([value for name, value in vars(still).items() if name != "image"]).encode())
    return told.hexdigest()


def split(stills: Sequence[OneStill], share: float, seed: int) -> tuple[list[OneStill], list[OneStill]]:
    """Images to learn from and images kept apart; a recording is on one side."""
    logs = sorted({still.log for still in stills})
    chosen = np.random.default_rng([seed, 3]).permutation(len(logs))[: max(1, round(share * len(logs)))]
    apart = {logs[index] for index in chosen}
    return [one for one in stills if one.log not in apart], [one for one in stills if one.log in apart]


def pose_of(entry: dict[str, Any]) -> Pose:
    """The pose that a row tells."""
    x, y, z = entry["position_m"]
    w, a, b, c = entry["quaternion_wxyz"]
    return Pose((x, y, z), (w, a, b, c))


def _load(folder: Path, what: str, labelled: Callable[[Still, dict[str, Any]], OneStill]) -> list[OneStill]:
    path = folder / f"{what}.jsonl"
    try:
        lines = path.read_text(encoding="utf-8").splitlines()
    except OSError as error:
        raise InputError(f"{path}: cannot be read: {error.strerror or error}") from None
    stills = []
    for number, line in enumerate(lines[1:], start=2):
        try:
            row = json.loads(line)
            stills.append(labelled(_still(folder, row), row))
        except (KeyError, TypeError, ValueError) as error:
            wrong = f"no {error} in it" if isinstance(error, KeyError) else str(error)
            raise InputError(f"{path}:{number}: not a row of `cell data {what}`: {wrong}") from None
    return stills


def _still(folder: Path, row: dict[str, Any]) -> Still:
    read = cv2.imread(str(folder / row["file"]), cv2.IMREAD_COLOR)
    if read is None:
        raise ValueError(f"{folder / row['file']} is no image")
    image = np.ascontiguousarray(read[..., ::-1], np.uint8)
    true = row["true_camera"]
    lens = true["focal_px"], true["distortion_k1"], true["distortion_k2"]
    camera = CameraModel(image.shape[1], image.shape[0], *lens)
    return Still(row["log"], image, camera, pose_of(true), pose_of(row["world_from_camera"]))
