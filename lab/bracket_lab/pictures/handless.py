"""Photographs without hands, as rows that the tracker learns from: whole, and pieces of them laid onto frames.

A tracker that learned from drawn benches alone has seen no stone, tool or animal. Those that it takes for hands are
shown to it most: places where the tracker that is there reads one are named.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from bracket_cell.learned.hands.mediapipe.hands import MediaPipeHands
from bracket_cell.learned.hands.reading import HandReader
from bracket_cell.learned.hands.records import HandRow
from bracket_cell.learned.records import read_image
from bracket_ground.files.data_folder import DataFolder
from bracket_ground.interfaces.bench import CameraSetup
from bracket_ground.interfaces.observation import Image
from bracket_ground.interfaces.pose import Array
from bracket_lab.learned.hands.data import LabelledFrame
from bracket_lab.pictures.origins import Photograph


@dataclass(frozen=True, eq=False)
class Compositor:
    """Lays photographs onto frames of the bench, and writes what comes of it.

    Attributes:
        teacher: finds the hands in photographs.
        setup: of the camera that would have taken the images.
        onto: frames of the bench; none for photographs alone.
        copies: images of each hand, and of each photograph without.
    """

    teacher: MediaPipeHands
    setup: CameraSetup
    folder: DataFolder
    onto: Sequence[LabelledFrame]
    copies: int
    seed: int

    def frame(self, share: float, rng: np.random.Generator) -> LabelledFrame | None:
        """A frame for this share of the images, where there are frames; None for the others."""
        if not self.onto or rng.random() >= share:
            return None
        return self.onto[int(rng.integers(len(self.onto)))]

    def write(
        self, log: str, which: str, photograph: Photograph, image: Image, hands: Sequence[HandRow], **more: object
    ) -> None:
        """One of the images of a photograph and its row, with further fields of it."""
        file = self.folder.image(f"images/{log}{which}.jpg", image)
        rows = [hand.model_dump(mode="json", exclude_unset=True) for hand in hands]
        origin = {"source": photograph.source, "licence": photograph.licence}
        self.folder.row("hands", {"file": file, "log": log, "hands": rows, **origin, **more})


NEARER = 2.5  # so much larger than to fill the image a photograph is shown, at most
LAID_SHARE = 0.4  # of images in which pieces lie on a frame, where there are frames
PIECES, PIECE_PX = (1, 4), (25.0, 75.0)  # of each such image, and half their width
CORNERS, UNEVEN = 9, 0.35  # of a piece's outline, and how much their distances from its middle vary


def filling(image: Image, setup: CameraSetup, rng: np.random.Generator) -> Image:
    """A part of a photograph, as large as the camera's images; turned and mirrored at random."""
    size = np.array([setup.width_px, setup.height_px], float)
    if rng.random() < 0.5:
        image = np.ascontiguousarray(image[:, ::-1])
    for _ in range(int(rng.integers(4))):
        image = np.ascontiguousarray(np.rot90(image))
    there = np.array(image.shape[1::-1], float)
    scale = float((size / there).max()) * math.exp(rng.uniform(0.0, math.log(NEARER)))
    soft = image if scale >= 1 else cv2.GaussianBlur(image, (0, 0), 0.35 / scale)
    corner = -rng.uniform(0.0, 1.0, 2) * np.maximum(there * scale - size, 0.0)
    move = np.array([[scale, 0.0, corner[0]], [0.0, scale, corner[1]]])
    return np.asarray(cv2.warpAffine(soft, move, (setup.width_px, setup.height_px), borderMode=cv2.BORDER_REFLECT))


def piece(size: tuple[int, int], rng: np.random.Generator) -> tuple[NDArray[np.float32], Array]:
    """Share of each pixel (height, width) that a thing of some outline covers, and its middle (column, row)."""
    middle = rng.uniform((0.0, 0.0), size)
    around = np.sort(rng.uniform(0.0, 2 * np.pi, CORNERS))
    away = rng.uniform(*PIECE_PX) * np.exp(rng.normal(0.0, UNEVEN, CORNERS))
    longer = np.array([[math.exp(rng.normal(0.0, 0.4)), 0.0], [0.0, 1.0]])
    turn = rng.uniform(0.0, np.pi)
    turning = np.array([[math.cos(turn), -math.sin(turn)], [math.sin(turn), math.cos(turn)]])
    outline = middle + (np.column_stack([np.cos(around), np.sin(around)]) * away[:, np.newaxis]) @ longer @ turning.T
    mask = np.zeros(size[::-1], np.float32)
    cv2.fillPoly(mask, [outline.round().astype(np.int32)], 1.0)
    return np.asarray(cv2.GaussianBlur(mask, (0, 0), 1.0), np.float32), middle


def lay(
    photograph: Image, frame: Image, hands: Sequence[HandRow], setup: CameraSetup, rng: np.random.Generator
) -> tuple[Image, list[tuple[float, float]]]:
    """Pieces of a photograph on a frame, beside its hands, and where they are."""
    image, places = frame.astype(np.float32), list[tuple[float, float]]()
    for _ in range(int(rng.integers(*PIECES))):
        mask, middle = piece((setup.width_px, setup.height_px), rng)
        for hand in hands:
            left, top, right, bottom = (max(0, round(value)) for value in hand.box_px)
            mask[top : bottom + 1, left : right + 1] = 0.0  # what hides a hand would make it another one
        share = mask[..., np.newaxis]
        image = image * (1 - share) + filling(photograph, setup, rng).astype(np.float32) * share
        places.append((float(middle[0]), float(middle[1])))
    return np.clip(image, 0, 255).astype(np.uint8), places


def write_handless(photographs: Sequence[Photograph], tracker: HandReader, compositor: Compositor) -> list[Photograph]:
    """Rows of hands.jsonl; returns the photographs but those that are left out, because the teacher sees a hand there.

    Args:
        tracker: what it takes for a hand is named in the rows.
    """
    setup, used = compositor.setup, list[Photograph]()
    for number, photograph in enumerate(photographs):
        rng, shown = np.random.default_rng([compositor.seed, 1, number]), read_image(photograph.file)
        if compositor.teacher.picture(shown):
            continue
        used.append(photograph)
        for copy in range(compositor.copies):
            frame = compositor.frame(LAID_SHARE, rng)
            hands = () if frame is None else frame.row.hands
            if frame is None:
                image, places = filling(shown, setup, rng), list[tuple[float, float]]()
            else:
                image, places = lay(shown, read_image(frame.file), hands, setup, rng)
            taken = [reading.centre_px for reading in tracker.read(image, ())]
            decoys = [*((float(x), float(y)) for x, y in taken), *places]
            compositor.write(f"without-{number:05d}", f"-{copy}", photograph, image, hands, decoys_px=decoys)
    return used
