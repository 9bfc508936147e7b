"""What photographs are made into rows of hands.jsonl with: where they go, and the frames that they are laid onto."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from bracket_cell.learned.hands.mediapipe.hands import MediaPipeHands
from bracket_cell.learned.hands.records import HandRow
from bracket_ground.files.data_folder import DataFolder
from bracket_ground.interfaces.bench import CameraSetup
from bracket_ground.interfaces.observation import Image
from bracket_lab.learned.hands.data import LabelledFrame


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

    def write(self, name: str, log: str, image: Image, hands: Sequence[HandRow], **more: object) -> None:
        """An image and its row, with further fields of it."""
        file = self.folder.image(f"images/{name}.jpg", image)
        told = [one.model_dump(mode="json", exclude_unset=True) for one in hands]
        self.folder.row("hands", {"file": file, "log": log, "hands": told, **more})
