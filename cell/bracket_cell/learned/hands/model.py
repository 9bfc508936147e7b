"""The small hand tracker: one network finds hands in the whole image, one reads each, one takes a closer look at it."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path

import cv2
import numpy as np

from bracket_cell.learned.hands.height import PalmLength
from bracket_cell.learned.hands.reading import ApparentSize, Reading, over_table
from bracket_cell.learned.hands.refinement import Refinement
from bracket_cell.learned.hands.regions import POINTS, Image, Regions, planes
from bracket_cell.learned.hands.tracking import LEAST_CONFIDENCE, HandTracks
from bracket_cell.learned.inference.onnx_model import OnnxModel
from bracket_cell.learned.inference.prefetch import Prefetch
from bracket_ground.errors import ModelError
from bracket_ground.interfaces.bench import Bench, CameraSetup
from bracket_ground.interfaces.planning import weights_file
from bracket_ground.interfaces.pose import Array
from bracket_ground.interfaces.product import Product

DARK = 70.0  # mean of an image's levels; what is lighter stays as it is
BRIGHTEST = 99.5  # percentage of all levels that is to be no lighter than white
GAMMA = 0.6  # less than 1 lightens the dark most


def levelled(image: Image) -> Image:
    """An RGB image with the channels of one mean and the dark lightened; the same one where it is not dark."""
    levels = image[::2, ::2].reshape(-1, 3).astype(np.float32)
    means = np.maximum(1.0, levels.mean(axis=0))
    if means.mean() >= DARK:
        return image
    gains = means.mean() / means
    top = max(1.0, float(np.percentile(levels * gains, BRIGHTEST)))
    table = 255 * np.clip(np.arange(256)[:, np.newaxis] * gains / top, 0.0, 1.0) ** GAMMA
    return cv2.LUT(image, table.astype(np.uint8)[np.newaxis]).astype(np.uint8, copy=False)


FINDER_KIND, READER_KIND, REFINER_KIND = "hands.slim_finder", "hands.slim", "hands.slim_refiner"
LEAST_SCORE = 0.25  # of the finder: the reader has the last word
NEW_CONFIDENCE = 0.95  # of a hand that was not seen before: shadows that look like one have less
SAME_SHARE = 0.25  # of a region's side: centres that are nearer are of one hand
SURE = 0.95  # what is less sure is read again, about its own centre
NEAR_PX = 25.0  # of the finder's centre; what is read elsewhere is not what was found
MOST_REGIONS = 4
# Training boxes lie around the boxes of a hand's shapes: by so much of a region they are wider than what is seen.
SLACK = np.array([[0.04, 0.015], [-0.04, -0.015]])


def finder_file(path: Path) -> Path:
    """The finder's weights, beside those of the reader."""
    return path.with_name(f"{path.stem}_finder{path.suffix}")


def refiner_file(path: Path) -> Path:
    """The refiner's weights, beside those of the reader."""
    return path.with_name(f"{path.stem}_refiner{path.suffix}")


def slim_files(weights: Path | None, folder: Path) -> dict[str, Path]:
    """All files of the tracker; by default those of a folder."""
    reader = weights or folder / weights_file("hands", "slim")
    return {"hands": reader, "hands.finder": finder_file(reader), "hands.refiner": refiner_file(reader)}


def slim_tracker(bench: Bench, product: Product, weights: Path) -> HandTracks:
    """The tracker with the weights of a file.

    Raises:
        ModelError: the file, or the one beside it, cannot be used.
    """
    reader = SlimReader(bench.overhead, tuple(product.parts), weights)
    return HandTracks(bench, reader, reader.palm_length, NEW_CONFIDENCE)


class SlimReader:
    """Reads the hands of single images (HandReader).

    Args:
        types: of the product's parts; where the weights know others, what is held has no type.
    """

    def __init__(self, setup: CameraSetup, types: tuple[str, ...], path: Path) -> None:
        self._regions = Regions.of(setup)
        self._reader = OnnxModel.load(path, READER_KIND)
        if "around" not in self._reader.inputs:
            raise ModelError(f"{path}: an older version trained it; train it again with: cell train --only hands")
        self._finder = OnnxModel.load(finder_file(path), FINDER_KIND)
        self._seen = Prefetch(self._see)
        self._closer = Refinement(self._regions, OnnxModel.load(refiner_file(path), REFINER_KIND))
        known = self._reader.card.vocabulary.get("parts", ())
        self._types: tuple[str | None, ...] = known if known == types else (None,) * len(known)

    def read(self, image: Image, expected_px: Sequence[Array] = ()) -> list[Reading]:
        """All hands in an RGB image, surest first."""
        small, likely, found = self._seen(image)
        same_px = SAME_SHARE * self._regions.side_px
        missing = [at_px for at_px in expected_px if _apart(at_px, likely, same_px)]
        found = [*found, *self._closely(image, small, missing[: MOST_REGIONS - len(likely)])]
        best: list[Reading] = []
        for reading in sorted(found, key=lambda candidate: -candidate.confidence):
            if reading.confidence >= LEAST_CONFIDENCE and _apart(
                reading.centre_px, [better.centre_px for better in best], same_px
            ):
                best.append(reading)
        return best

    def read_at(self, image: Image, centres_px: Sequence[Array]) -> list[Reading]:
        """What is read around points (column, row) where others found hands; nothing where it sees none."""
        return self._closely(image, self._regions.small(image), centres_px)

    def prepare(self, image: Image) -> None:
        """Look for hands, and read them, before anybody asks."""
        self._seen.prepare(image)

    def _see(self, image: Image) -> tuple[Image, list[Array], list[Reading]]:
        """What follows from an image alone: it made small, centres of what may be hands, and what is read there."""
        small = self._regions.small(image)
        likely = self._find(small)[:MOST_REGIONS]
        return small, likely, self._closely(image, small, likely)

    def _closely(self, image: Image, small: Image, centres: Sequence[Array]) -> list[Reading]:
        """What is seen around points (column, row); what is doubtful is read again, about its own centre."""
        seen = self._read(image, small, centres)
        doubtful = [index for index, reading in enumerate(seen) if not _sure(reading, centres[index])]
        again = self._read(image, small, [seen[index].centre_px for index in doubtful])
        for index, reading in zip(doubtful, again, strict=True):
            seen[index] = reading if _sure(reading, centres[index]) else seen[index]
        return self._closer.refined(image, [reading for reading in seen if reading.confidence >= LEAST_CONFIDENCE])

    def _find(self, small: Image) -> list[Array]:
        """Centres (column, row) of what may be hands, likeliest first."""
        answer = self._finder.run({"image": planes(levelled(small)[np.newaxis])})
        score, offset = answer["score"][0, 0], answer["offset"][0]
        peaks = (score >= cv2.dilate(score, np.ones((3, 3), np.uint8))) & (score > LEAST_SCORE)
        cells = sorted(zip(*np.nonzero(peaks), strict=True), key=lambda cell: -float(score[cell]))
        shares = [(np.array(cell[::-1]) + offset[(slice(None), *cell)]) / score.shape[::-1] for cell in cells]
        return [share * self._regions.size_px - 0.5 for share in shares]

    def _read(self, image: Image, small: Image, centres: Sequence[Array]) -> list[Reading]:
        """What is seen around points (column, row)."""
        if not centres:
            return []
        regions = self._regions
        cuts = planes(np.stack([regions.cut(image, centre) for centre in centres]))
        around = planes(np.stack([regions.around(small, centre) for centre in centres]))
        places = np.stack([regions.place(centre) for centre in centres])
        answer = self._reader.run({"region": cuts, "around": around, "place": places.astype(np.float32)})
        return [
            self._reading(centre, {name: value[row] for name, value in answer.items()})
            for row, centre in enumerate(centres)
        ]

    def _reading(self, centre: Array, answer: dict[str, Array]) -> Reading:
        kind = int(answer["held"].argmax())
        names = POINTS if kind else tuple(name for name in POINTS if name != "held")
        shares = answer["points"].astype(float)[: len(names)]
        box = answer["box"].astype(float)
        points = dict(zip(names, self._regions.outside(shares, centre), strict=True))
        corners = self._regions.outside(box.reshape(2, 2) + SLACK, centre)
        left, top, right, bottom = (float(value) for value in corners.reshape(4))
        return Reading(
            confidence=float(answer["present"]),
            left=float(answer["left"]),
            acting=float(answer["acting"]),
            points_px=points,
            box_px=(left, top, right, bottom),
            heights_m=(over_table(float(answer["heights_m"][0])), over_table(float(answer["heights_m"][1]))),
            held_part=None if kind == 0 else self._types[kind - 1],
            size=ApparentSize(
                float(answer["log_angle"]),
                float(answer["angle_error"]),
                (float(answer["height_errors_m"][0]), float(answer["height_errors_m"][1])),
            ),
        )

    @property
    def palm_length(self) -> PalmLength:
        """What is known of a person's hand before it was seen: what training saw."""
        length_m, spread = (float(str(self._reader.card.config[name])) for name in ("palm_length_m", "palm_spread"))
        return PalmLength(math.log(length_m), spread**2)


def _apart(point: Array, others: Sequence[Array], least_px: float) -> bool:
    return all(float(np.linalg.norm(point - other)) >= least_px for other in others)


def _sure(reading: Reading, centre_px: Array) -> bool:
    return reading.confidence >= SURE and not _apart(reading.centre_px, [centre_px], NEAR_PX)
