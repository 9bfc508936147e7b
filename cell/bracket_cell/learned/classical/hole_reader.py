"""Reads which part stands in which hole, and keeps what it saw last while hand or arm are in the way."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from bracket_cell.learned.classical.box_model import View
from bracket_cell.learned.classical.colour import BACKGROUND, ColourModel, Labels
from bracket_cell.learned.classical.part_fit import ShapeFit, ShapeFitter
from bracket_cell.learned.classical.settings import PerceptionSettings
from bracket_cell.learned.classical.silhouette import top_areas_m2
from bracket_ground.interfaces.bench import Bench
from bracket_ground.interfaces.frame import Frame
from bracket_ground.interfaces.perception import HandSample, HoleView
from bracket_ground.interfaces.places import BenchPlace, Mount, spot_name
from bracket_ground.interfaces.pose import Array
from bracket_ground.interfaces.product import Product


class PlaceReader:
    """What stands at each spot of the places that are `seen`; each place is a plate with a hole for each spot."""

    def __init__(self, bench: Bench, product: Product, settings: PerceptionSettings) -> None:
        seen = {name: place for name, place in bench.places.items() if place.known_by == "seen"}
        colours = ColourModel(product, settings.skin_rgb) if seen else None
        self._readers = [
            ClassicalHoleReader(_standing_at(bench, place), _as_plate(product, name, place), settings, colours)
            for name, place in seen.items()
            if colours is not None
        ]

    def read(self, frame: Frame, hand: HandSample | None) -> Mapping[str, HoleView]:
        """By name of the spot, as far as ever seen unobstructed."""
        return {name: view for reader in self._readers for name, view in reader.read(frame, hand).items()}


def _standing_at(bench: Bench, place: BenchPlace) -> Bench:
    """The bench as if its bracket were the place."""
    mount = Mount(position_m=place.position_m, quaternion_wxyz=place.quaternion_wxyz)
    return bench.model_copy(update={"bracket": mount})


def _as_plate(product: Product, name: str, place: BenchPlace) -> Product:
    """A product whose bracket has the spots of a place for holes; types stay in their order, as colours know them."""
    held = [part for part in product.parts if place.takes(part)]
    without = {"quantity", "made_of", "built_at"}
    parts = {
        part: {**kind.model_dump(exclude=without), **({} if part in held else {"quantity": 0})}
        for part, kind in product.parts.items()
    }
    holes = {spot_name(name, number): at for number, at in enumerate(place.spots_m)}
    plate = {**product.bracket.model_dump(exclude={"plates"}), "holes_m": holes}
    goals = {"any": {next(iter(holes)): held}}
    return Product.model_validate({"name": name, "parts": parts, "bracket": plate, "goals": goals})


DARK = 0.55  # of the plate's brightness: what the inside of a hole stays below
PLATE_RANGE = (0.75, 1.3)
LEAST_DARK = 0.9
LEAST_PLATE = 0.85
DISC = 0.65  # radii of the hole: its inside, and the ring of plate around it
RING = (1.5, 2.1)
SKIN_GAP_M = 0.013  # a hand this close to a part may still hold it
LEAST_SUPPORT = 0.85
LEAST_SHARE = 0.5  # of a body's top that must show before it is looked at closely
SAME_PX = 0.7  # a blob that moved and changed less than this was judged before
SAME_AREA = 0.06
BELONGS_M = 0.035

Pixels = tuple[NDArray[np.intp], ...]


@dataclass(frozen=True)
class Reading:
    """What one frame shows at one hole."""

    part: str | None
    upright: bool = True
    confidence: float = 1.0

    def same(self, other: Reading) -> bool:
        """Whether it says the same, whatever the confidence."""
        return self.part == other.part and self.upright == other.upright


@dataclass(frozen=True)
class _Blob:
    """A piece of one type's colour: its label, pixels, and box (left, top, right, bottom)."""

    label: int
    area: float
    centroid_px: tuple[float, float]
    box_px: tuple[int, int, int, int]
    index: int


class ClassicalHoleReader:
    """Looks for dark holes and for standing parts on the plate (HoleReader)."""

    def __init__(self, bench: Bench, product: Product, settings: PerceptionSettings, colours: ColourModel) -> None:
        self._product = product
        self._settings = settings
        self._colours = colours
        self._view = View(bench.overhead.model, bench.overhead.mount.pose)
        bracket = bench.bracket.pose
        self._plate_m = bench.bracket.position_m[2]
        holes = np.array([[*xy, 0.0] for xy in product.bracket.holes_m.values()])
        self._holes_m = dict(zip(product.positions, bracket.transform(holes)[:, :2], strict=True))
        self._scale = self._view.pixels_per_m(bench.bracket.position_m)
        self._radius_px = product.hole_radius_m * self._scale
        self._tops_m2 = top_areas_m2(list(product.parts.values()))
        self._window = self._plate_window(bracket.transform(_plate_corners(product)))
        self._masks = {position: self._hole_masks(position) for position in product.positions}
        self._legal = {position: _labels_in_stack(product, position) for position in product.positions}
        self._judged: dict[str, tuple[_Blob, Reading | None]] = {}
        self._candidates: dict[str, tuple[Reading, int]] = {}
        self._views: dict[str, HoleView] = {}

    def read(self, frame: Frame, hand: HandSample | None) -> Mapping[str, HoleView]:
        """Holes by position name, as far as ever seen; the skin in the frame counts, not the hand's box."""
        del hand
        labels = self._colours.label(frame.image)
        left, top, right, bottom = self._window
        crop = labels[top:bottom, left:right]
        grey = frame.image[top:bottom, left:right].mean(axis=2)
        blobs, pieces = self._blobs(crop)
        for position in self._product.positions:
            blob = self._blob_at(position, blobs)
            if blob is None and (below := self._product.carried_by.get(position)) is not None:
                carrying = self._blob_at(below, blobs)
                clear = carrying is not None and not self._touched(carrying, labels)
                reading = Reading(None, confidence=1.0) if clear else self._empty(below, crop, grey)
            elif blob is None:
                reading = self._empty(position, crop, grey)
            else:
                reading = self._standing(position, blob, labels, pieces[blob.label])
            self._settle(position, reading, frame.time_s)
        return {position: self._views[position] for position in self._product.positions if position in self._views}

    def _foot_m(self, position: str) -> float:
        """Height of the bottom of a part that stands in a slot."""
        return self._plate_m + self._product.height_m(position)

    def _plate_window(self, corners_m: Array) -> tuple[int, int, int, int]:
        """The part of the image where plate and standing parts can be seen."""
        tallest_m = max(part.size_m[2] for part in self._product.parts.values())
        pixels = np.concatenate(
            [self._view.pixels(corners_m + np.array([0.0, 0.0, height])) for height in (0.0, tallest_m)]
        )
        model = self._view.model
        low = np.clip(np.floor(pixels.min(axis=0)), 0, None).astype(int)
        high = np.minimum(np.ceil(pixels.max(axis=0)).astype(int) + 1, (model.width_px, model.height_px))
        return int(low[0]), int(low[1]), int(high[0]), int(high[1])

    def _hole_masks(self, position: str) -> tuple[Pixels, Pixels]:
        """Pixels in the window inside a hole, and on the ring of plate around it."""
        left, top, right, bottom = self._window
        centre = self._view.pixels(np.array([[*self._holes_m[position], self._plate_m]]))[0] - (left, top)
        rows, columns = np.ogrid[: bottom - top, : right - left]
        radii = np.hypot(rows - centre[1], columns - centre[0]) / self._radius_px
        return np.nonzero(radii < DISC), np.nonzero((radii > RING[0]) & (radii < RING[1]))

    def _blobs(self, crop: Labels) -> tuple[list[_Blob], dict[int, NDArray[np.int32]]]:
        """Pieces of part colour around the plate, large enough for a part, and their maps by label."""
        left, top, _, _ = self._window
        blobs: list[_Blob] = []
        pieces: dict[int, NDArray[np.int32]] = {}
        for label, top_m2 in enumerate(self._tops_m2, start=1):
            count, pieces[label], stats, middles = cv2.connectedComponentsWithStats((crop == label).astype(np.uint8))
            least = LEAST_SHARE * top_m2 * self._scale**2
            for index in range(1, count):
                x, y, width, height, area = (int(value) for value in stats[index])
                if area > least:
                    middle = (float(middles[index][0]) + left, float(middles[index][1]) + top)
                    box = (x + left, y + top, x + left + width, y + top + height)
                    blobs.append(_Blob(label, float(area), middle, box, index))
        return blobs, pieces

    def _blob_at(self, position: str, blobs: list[_Blob]) -> _Blob | None:
        """The blob whose body would stand nearest to a hole, if near enough."""
        best: tuple[float, _Blob] | None = None
        parts = list(self._product.parts.values())
        legal = self._legal[position]
        for blob in (candidate for candidate in blobs if legal is None or candidate.label in legal):
            middle_m = self._foot_m(position) + parts[blob.label - 1].size_m[2] / 2
            place = self._view.on_plane(np.array([blob.centroid_px]), middle_m)[0]
            distance_m = float(np.linalg.norm(place - self._holes_m[position]))
            if distance_m < BELONGS_M and (best is None or distance_m < best[0]):
                best = (distance_m, blob)
        return None if best is None else best[1]

    def _empty(self, position: str, crop: Labels, grey: Array) -> Reading | None:
        """An empty hole: dark inside, bare plate all around."""
        disc, ring = self._masks[position]
        plate = float(np.median(grey[ring]))
        low, high = PLATE_RANGE
        bare = (grey[ring] > low * plate) & (grey[ring] < high * plate) & (crop[ring] == BACKGROUND)
        dark = (grey[disc] < DARK * plate) & (crop[disc] == BACKGROUND)
        if float(dark.mean()) < LEAST_DARK or float(bare.mean()) < LEAST_PLATE:
            return None
        return Reading(None, confidence=float(min(dark.mean(), bare.mean())))

    def _standing(self, position: str, blob: _Blob, labels: Labels, pieces: NDArray[np.int32]) -> Reading | None:
        """A standing part: its whole outline is seen, no hand is near it, and its middle is over the hole."""
        if self._touched(blob, labels):
            return None
        known = self._judged.get(position)
        if known is not None and _alike(known[0], blob):
            return known[1]
        reading = self._judge(position, blob, labels, pieces)
        self._judged[position] = (blob, reading)
        return reading

    def _touched(self, blob: _Blob, labels: Labels) -> bool:
        gap = math.ceil(SKIN_GAP_M * self._scale)
        left, top, right, bottom = blob.box_px
        around = labels[max(top - gap, 0) : bottom + gap, max(left - gap, 0) : right + gap]
        # a red part's blurred rim may look like skin, but is a single pixel wide
        skin = cv2.erode((around == self._colours.skin).astype(np.uint8), np.ones((3, 3), np.uint8))
        return cv2.countNonZero(skin) > 0

    def _judge(self, position: str, blob: _Blob, labels: Labels, pieces: NDArray[np.int32]) -> Reading | None:
        name = list(self._product.parts)[blob.label - 1]
        left, top, right, bottom = self._window
        own = np.zeros(labels.shape, np.uint8)
        own[top:bottom, left:right] = pieces == blob.index
        hidden = ((labels != BACKGROUND) & (labels != blob.label)).astype(np.uint8)
        fitter = ShapeFitter(self._view, self._product.parts[name], self._foot_m(position))
        fit = fitter.refine([self._seed(position, own, name)], own, hidden)[0]
        if fit.support < LEAST_SUPPORT:
            return None
        offset_m = float(np.linalg.norm(np.array([fit.x_m, fit.y_m]) - self._holes_m[position]))
        return Reading(name, offset_m < self._settings.upright_tolerance_m, fit.support)

    def _seed(self, position: str, own: Labels, name: str) -> ShapeFit:
        """The part in the middle of its hole, turned as its blob lies in the image."""
        rows, columns = np.nonzero(own)
        height_m = self._foot_m(position) + self._product.parts[name].size_m[2]
        places = self._view.on_plane(np.column_stack([columns, rows]), height_m)
        spread = np.cov(places.T)
        axis = np.linalg.eigh(spread)[1][:, 1]
        x_m, y_m = self._holes_m[position]
        return ShapeFit(float(x_m), float(y_m), math.atan2(axis[1], axis[0]))

    def _settle(self, position: str, reading: Reading | None, time_s: float) -> None:
        """Take a reading over once it stood for some frames; one that agrees with the view refreshes it."""
        if reading is None:
            self._candidates.pop(position, None)
            return
        candidate, count = self._candidates.get(position, (reading, 0))
        count = count + 1 if candidate.same(reading) else 1
        self._candidates[position] = (reading, count)
        if count >= self._settings.settle_frames:
            self._views[position] = HoleView(reading.part, reading.confidence, time_s, reading.upright)


def _alike(known: _Blob, blob: _Blob) -> bool:
    moved = math.dist(known.centroid_px, blob.centroid_px)
    return known.label == blob.label and moved < SAME_PX and abs(known.area - blob.area) < SAME_AREA * known.area


def _labels_in_stack(product: Product, position: str) -> frozenset[int] | None:
    """Colour labels of the parts that may stand in a slot which carries another one or is carried; None for all."""
    if position not in product.carried_by and position not in product.carried_by.values():
        return None
    return frozenset(number for number, part in enumerate(product.parts, 1) if part in product.types_at(position))


def _plate_corners(product: Product) -> Array:
    """Corners (4, 3) of the plate in the bracket's frame."""
    holes = np.array(list(product.bracket.holes_m.values()))
    margin = product.bracket.margin_m
    (x0, y0), (x1, y1) = holes.min(axis=0) - margin, holes.max(axis=0) + margin
    return np.array([[x0, y0, 0.0], [x1, y0, 0.0], [x1, y1, 0.0], [x0, y1, 0.0]])
