"""Labelled images: JSON lines beside the images, of `cell lab data` or of `cell label`."""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Sequence
from dataclasses import dataclass, fields
from pathlib import Path
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from bracket_cell.learned.records import StillRow, read_image, read_rows
from bracket_ground.errors import InputError
from bracket_ground.interfaces.camera_model import CameraModel
from bracket_ground.interfaces.pose import Pose


@dataclass(frozen=True, eq=False)
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


AnyStillRow = TypeVar("AnyStillRow", bound=StillRow)
OneStill = TypeVar("OneStill", bound=Still)


def load_stills(
    folders: Sequence[Path], what: str, row: type[AnyStillRow], labelled: Callable[[Still, AnyStillRow], OneStill]
) -> list[OneStill]:
    """All images of some folders.

    Args:
        what: the name of their file, and of the data set of `cell lab data`.
        labelled: adds the labels of a row; raises ValueError for those that do not fit the product.

    Raises:
        InputError: a file is missing or wrong; the message names file and line.
    """
    how = f"make it with: cell label DIR, or cell lab data {what} --out DIR"
    stills: list[OneStill] = []
    for folder in folders:

        def made(row: AnyStillRow, folder: Path = folder) -> OneStill:
            return labelled(_still(folder, row), row)

        stills += read_rows(folder / f"{what}.jsonl", row, made, header=f"cell.{what}", how=how)
    return stills


def data_hash(stills: Sequence[Still]) -> str:
    """Hash of images and labels."""
    digest = hashlib.sha256()
    for still in stills:
        digest.update(still.image.tobytes())
        digest.update(repr([value for name, value in vars(still).items() if name != "image"]).encode())
    return digest.hexdigest()


def split(stills: Sequence[OneStill], share: float, seed: int) -> tuple[list[OneStill], list[OneStill]]:
    """Images to learn from and images kept apart; a recording is on one side.

    Raises:
        InputError: all are of one recording.
    """
    logs = sorted({still.log for still in stills})
    if len(logs) < 2:
        raise InputError(f"{len(stills)} images of {len(logs)} recordings; 2 are needed: one is kept for scores")
    chosen = np.random.default_rng([seed, 3]).permutation(len(logs))[: max(1, round(share * len(logs)))]
    apart = {logs[index] for index in chosen}
    return [still for still in stills if still.log not in apart], [still for still in stills if still.log in apart]


def _still(folder: Path, row: StillRow) -> Still:
    image, true = read_image(folder / row.file), row.true_camera
    lens = true.model_dump(include={field.name for field in fields(CameraModel)})
    camera = CameraModel(width_px=image.shape[1], height_px=image.shape[0], **lens)
    return Still(row.log, image, camera, true.pose, row.world_from_camera.pose)
