"""What detectors say of a picture, as labels that a person only has to correct."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from bracket_cell.learned.hands.mediapipe.hands import MediaPipeHands, model_folder
from bracket_cell.learned.hands.mediapipe.tracker import MediaPipeReader
from bracket_cell.learned.hands.records import HandRow
from bracket_cell.learned.holes.model import VOTES
from bracket_cell.learned.records import Hole, PartRow, StillRow
from bracket_cell.settings import Perception
from bracket_cell.wiring.detectors import Detectors
from bracket_ground.errors import ModelError, SettingError
from bracket_ground.interfaces.bench import Bench
from bracket_ground.interfaces.frame import Frame
from bracket_ground.interfaces.observation import Image
from bracket_ground.interfaces.perception import HandSample, HoleReader, HoleView
from bracket_ground.interfaces.pose import Array
from bracket_ground.interfaces.product import Product
from bracket_lab.pictures.labels import PictureLabels


class Often:
    """Reads the holes of single pictures: it looks at each as often as a reader wants to see a hole (HoleReader)."""

    def __init__(self, reader: HoleReader, looks: int) -> None:
        self._reader, self._looks = reader, looks

    def read(self, frame: Frame, hand: HandSample | None) -> Mapping[str, HoleView]:
        """Holes by position name, as far as this frame shows them."""
        for _ in range(self._looks - 1):
            self._reader.read(frame, hand)
        return self._reader.read(frame, hand)


class Suggester:
    """Looks at pictures with what is there: MediaPipe's networks where they were fetched, else the cell's detectors.

    Attributes:
        by: what looks for hands, holes or parts, for people.
    """

    def __init__(self, bench: Bench, product: Product, perception: Perception) -> None:
        self._bench, self._product, self._perception = bench, product, perception
        self.by: dict[str, str] = {}

    def labels(self, row: StillRow, image: Image) -> PictureLabels:
        """What is seen in a picture."""
        frame = Frame(row.camera, 0, 0.0, image, row.world_from_camera.pose)
        if row.camera == "wrist":
            found = self._detector("parts").detect(frame)
            seen = [(part.part, "upright" if part.upright else "lying", part.box_px) for part in found]
            return PictureLabels(parts=tuple(PartRow(part=a, posture=b, whole_box_px=c) for a, b, c in seen))  # type: ignore[arg-type]
        return PictureLabels(holes=self._holes(frame), hands=self._hands(image, frame))

    def holes_px(self, row: StillRow) -> dict[str, tuple[float, float]]:
        """Where the holes are, by the plate's pose."""
        holes = self._product.bracket.holes_m
        places = self._bench.bracket.pose.transform(np.array([[*xy, 0.0] for xy in holes.values()]))
        pixels: Array = self._bench.overhead.model.project(row.true_camera.pose, places)
        return {name: (float(x), float(y)) for name, (x, y) in zip(holes, pixels, strict=True)}

    def _holes(self, frame: Frame) -> tuple[Hole, ...]:
        looks = max(VOTES, self._perception.classical.settle_frames)
        views = Often(self._detector("holes"), looks).read(frame, None)
        return tuple(
            Hole(position=name, part=views[name].part, upright=views[name].upright)
            if name in views
            else Hole(position=name, part=None, covered=1.0)
            for name in self._product.positions
        )

    def _hands(self, image: Image, frame: Frame) -> tuple[HandRow, ...]:
        height, width = image.shape[:2]
        for size in ("full", "lite"):
            try:
                reader = MediaPipeReader(self._bench.overhead, MediaPipeHands(model_folder(), size))
            except ModelError:
                continue
            self.by["hands"] = f"mediapipe {size}"
            return tuple(
                HandRow(
                    side="left" if reading.left > 0.5 else "right",
                    box_px=_inside(reading.box_px, width, height),
                    points_px={name: (float(x), float(y)) for name, (x, y) in reading.points_px.items()},
                    known=False,
                )
                for reading in reader.read(image)
            )
        hand = self._detector("hands").track(frame)
        if hand is None:
            return ()
        return (HandRow(side=hand.side, box_px=_inside(hand.box_px, width, height), known=False),)

    def _detector(self, task: str) -> Any:
        """A new one for each picture: pictures do not follow each other; the classical one where weights do not fit."""
        for kind in (None, "classical"):
            perception = self._perception if kind is None else self._perception.with_detector(task, kind)
            try:
                made = Detectors(self._bench, self._product, perception).make(task)
            except (SettingError, ModelError):
                if kind is not None:
                    raise
                continue
            self.by[task] = perception.chosen(task).kind
            return made
        return None


def _inside(box: tuple[float, ...], width: int, height: int) -> tuple[float, float, float, float]:
    left, top, right, bottom = (float(value) for value in box)
    return max(0.0, left), max(0.0, top), min(float(width), right), min(float(height), bottom)
