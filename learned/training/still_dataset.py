"""Labelled images of `cell lab data`: JSON lines beside the images, the first line about all of them."""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any, TypeVar

import cv2
import numpy as np
from numpy.typing import NDArray

from cell.interfaces.camera_model import CameraModel
from cell.interfaces.pose import Pose
from learned.training.json_lines import labelled_rows


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
        what: the command `cell lab data WHAT` that made them, and the name of their file.
        labelled: adds the labels of a row.

    Raises:
        InputError: a file is missing or wrong; the message names file and line.
    """
    stills: list[OneStill] = []
    for folder in folders:
        stills += labelled_rows(folder, what, partial(_labelled_still, folder, labelled))
    return stills


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
    """The pose of a row."""
    x, y, z = entry["position_m"]
    w, a, b, c = entry["quaternion_wxyz"]
    return Pose((x, y, z), (w, a, b, c))


def _labelled_still(
    folder: Path, labelled: Callable[[Still, dict[str, Any]], OneStill], row: dict[str, Any]
) -> OneStill:
    return labelled(_still(folder, row), row)


def _still(folder: Path, row: dict[str, Any]) -> Still:
    read = cv2.imread(str(folder / row["file"]), cv2.IMREAD_COLOR)
    if read is None:
        raise ValueError(f"{folder / row['file']} is not an image")
    image = np.ascontiguousarray(read[..., ::-1], np.uint8)
    true = row["true_camera"]
    lens = true["focal_px"], true["distortion_k1"], true["distortion_k2"]
    camera = CameraModel(image.shape[1], image.shape[0], *lens)
    return Still(row["log"], image, camera, pose_of(true), pose_of(row["world_from_camera"]))
