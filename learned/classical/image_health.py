"""Says whether an overhead image can be believed: light, colour, sharpness, life, and where the bracket's plate is.

Absolute limits find what no bench looks like, and a lens that is out of focus from the start; the rest is compared with
the first frames of the run.
"""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from cell.interfaces.bench import Bench
from cell.interfaces.perception import Edge, Frame
from cell.interfaces.pose import Array
from cell.interfaces.product import Product
from learned.classical.box_model import View
from learned.inference.prefetch import Prefetch

DARK, BRIGHT = 16.0, 235.0  # mean grey level of 255
LEAST_CONTRAST = 6.0  # standard deviation of grey levels
BASELINE_FRAMES = 8  # sound frames that the later ones are compared with
LIGHT_LOG, COLOUR_LOG = 0.30, 0.14  # change of mean light, and of median red or blue over green, as logarithms
LEAST_SHARPNESS = 0.5  # of the baseline's
FROZEN_FRAMES = 2  # a sensor's noise makes every image another one
MOVED_PX, SEARCH_PX = 7, 16  # how far the plate's edges may be off, and how far they are looked for
LEAST_STEP = 10.0  # grey levels across an edge of the plate
SAME_SHIFT_PX = 3
STEP_PX = 4  # across which an edge of the plate is measured
SOFT_REACH_PX, LEAST_STEEPNESS = 8, 0.54  # of a step, how much lies within STEP_PX: so much at a blur of 2.9 px
SOFT_FRAMES, LEAST_EDGES = 8, 2
SHIFT_FRAMES, LEAST_RESPONSE = 5, 0.1
MOVED_FRAMES, ASTRAY_FRAMES = 8, 45
SIDE_SAMPLES = 24
REACH_PX = np.arange(-SEARCH_PX + 2, SEARCH_PX - 1)  # where steps across an edge are looked for
STEEPEST = 4 * 255  # of what the Laplacian makes of grey levels
GRID = 4  # every fourth pixel is enough to tell two images apart, every eighth for light and colour
SHARP_ROWS = 4  # every fourth row is enough for sharpness


@dataclass(frozen=True)
class _Figures:
    """What an image is compared by."""

    light: float
    red: float
    blue: float
    sharpness: float


class ImageHealth:
    """Judges the frames of one camera in their order."""

    def __init__(self, bench: Bench, product: Product) -> None:
        view = View(bench.overhead.model, bench.overhead.mount.pose)
        self._edges = np.array([_across_px(view, edge) for edge in _edges_m(bench, product)])
        size_px = bench.overhead.model.width_px, bench.overhead.model.height_px
        inside = (self._edges >= 0) & (self._edges < size_px)
        self._in_view = np.array([one.all() for one in inside])
        self._baseline: list[_Figures] = []
        self._usual: _Figures | None = None
        self._before: NDArray[np.uint8] | None = None
        self._same = self._moved = self._astray = self._soft = 0
        self._first: NDArray[np.float32] | None = None
        self._frames, self._whole_px = 0, 0.0
        self._looked = Prefetch(_look)

    def judge(self, frame: Frame) -> str:
        """What is wrong with it, in words; empty for a sound image."""
        small, grey, figures = self._looked(frame.image)
        return self._frozen(small) or _absolute(small) or self._compared(figures) or self._by_plate(grey)

    def prepare(self, image: NDArray[np.uint8]) -> None:
        """Do before anybody asks what follows from the image alone."""
        self._looked.prepare(image)

    def _frozen(self, small: NDArray[np.uint8]) -> str:
        same = self._before is not None and np.array_equal(small, self._before)
        self._same, self._before = (self._same + 1 if same else 0), small
        return "frozen" if self._same + 1 >= FROZEN_FRAMES else ""

    def _compared(self, figures: _Figures) -> str:
        usual = self._usual
        if usual is None:
            self._baseline.append(figures)
            if len(self._baseline) == BASELINE_FRAMES:
                self._usual = _Figures(*np.median([tuple(vars(one).values()) for one in self._baseline], axis=0))
            return ""
        light = float(np.log(figures.light / usual.light))
        if abs(light) > LIGHT_LOG:
            return "brighter than before" if light > 0 else "darker than before"
        if max(abs(figures.red - usual.red), abs(figures.blue - usual.blue)) > COLOUR_LOG:
            return "discoloured"
        return "blurred" if figures.sharpness < LEAST_SHARPNESS * usual.sharpness else ""

    def _by_plate(self, grey: NDArray[np.uint8]) -> str:
        """What the edges of the plate tell."""
        x, y = self._edges[self._in_view, ..., 0], self._edges[self._in_view, ..., 1]
        profiles = _median(grey[y, x], axis=1)
        steepness = _steepness(profiles)
        soft = len(steepness) >= LEAST_EDGES and float(np.median(steepness)) < LEAST_STEEPNESS
        self._soft = self._soft + 1 if soft else 0
        return "blurred" if self._soft >= SOFT_FRAMES else self._shifted(profiles, grey)

    def _shifted(self, profiles: Array, grey: NDArray[np.uint8]) -> str:
        """Whether the plate stands elsewhere in the image than the calibration says."""
        found = iter(_offsets_px(profiles))
        offsets = [next(found) if seen else None for seen in self._in_view]
        shifts = [px for px in (_shift_px(*offsets[:2]), _shift_px(*offsets[2:])) if px is not None]
        near, whole_px = max(shifts, default=0.0), self._since_start_px(grey)
        self._moved = self._moved + 1 if near > MOVED_PX else 0
        self._astray = 0 if shifts and near <= MOVED_PX else self._astray + 1
        if self._moved >= MOVED_FRAMES:
            return f"moved: the bracket is seen {near:.0f} pixels off"
        far = self._astray >= ASTRAY_FRAMES and whole_px > MOVED_PX
        return f"moved: the bench is seen {whole_px:.0f} pixels off" if far else ""

    def _since_start_px(self, grey: NDArray[np.uint8]) -> float:
        """How far the whole image has shifted since the first frame, by its phase; asked only every few frames.

        An arm that covers much of the bench shifts it, too: it counts only where the plate is not found for long.
        """
        self._frames += 1
        if self._first is None:
            self._first = _small(grey)
            self._window = cv2.createHanningWindow(self._first.shape[::-1], cv2.CV_32F)
        elif self._frames % SHIFT_FRAMES == 0:
            (x, y), response = cv2.phaseCorrelate(self._first, _small(grey), self._window)
            self._whole_px = GRID * float(np.hypot(x, y)) if response > LEAST_RESPONSE else 0.0
        return self._whole_px


class TrackHealth:
    """Says whether no hand means that there is none, and how fast a hand moves.

    Attributes:
        left_by: edges by which the hand left the view, or may have; empty while one is seen.
    """

    def __init__(self, bench: Bench) -> None:
        camera = bench.overhead.model
        self._size = (camera.width_px, camera.height_px)
        self._fastest_px_s = HAND_M_S * camera.focal_px / (bench.overhead.mount.position_m[2] - HAND_M)
        self._seen: deque[tuple[float, tuple[float, float], tuple[int, int, int, int]]] = deque(maxlen=4)
        self._unknown = ""
        self.left_by: tuple[Edge, ...] = ()

    def unknown(self, time_s: float, palm_m: tuple[float, float] | None, box_px: tuple[int, int, int, int]) -> str:
        """Why it is not known where the hand is; empty where it is seen, or left by the edge of the view."""
        if palm_m is not None:
            self._seen.append((time_s, palm_m, box_px))
            self._unknown, self.left_by = "", ()
        elif self._seen:
            self.left_by = self._edges(time_s)
            self._unknown = "" if self.left_by else "it vanished inside the view"
            self._seen.clear()
        return self._unknown

    @property
    def velocity_m_s(self) -> tuple[float, float] | None:
        """Of the palm over the last frames; None where they are too few."""
        if len(self._seen) < 2:
            return None
        (from_s, start, _), (to_s, end, _) = self._seen[0], self._seen[-1]
        if to_s <= from_s:
            return None
        return (end[0] - start[0]) / (to_s - from_s), (end[1] - start[1]) / (to_s - from_s)

    def _edges(self, time_s: float) -> tuple[Edge, ...]:
        """By which edges the hand can have left: it touched them, or was about to, and could be out of view by now."""
        last_s, _, box = self._seen[-1]
        gone_s = time_s - last_s
        ahead_s = min(gone_s, LEAVES_S)
        speeds = self._box_speeds()
        left, top, right, bottom = (value + speed * ahead_s for value, speed in zip(box, speeds, strict=True))
        width, height = self._size
        outer: dict[Edge, float] = {"left": left, "top": top, "right": width - right, "bottom": height - bottom}
        inner: dict[Edge, float] = {"left": box[2], "top": box[3], "right": width - box[0], "bottom": height - box[1]}
        most_px = self._fastest_px_s * gone_s + UNSEEN_PX
        return tuple(edge for edge in outer if outer[edge] <= EDGE_PX and inner[edge] <= most_px)

    def _box_speeds(self) -> tuple[float, ...]:
        (from_s, _, start), (to_s, _, end) = self._seen[0], self._seen[-1]
        if to_s <= from_s:
            return (0.0, 0.0, 0.0, 0.0)
        return tuple((b - a) / (to_s - from_s) for a, b in zip(start, end, strict=True))


EDGE_PX = 6  # a box this near to the image's edge touches it
LEAVES_S = 0.2  # a hand that is not seen any more is thought to have gone on for so long
UNSEEN_PX = 40  # of a hand at the edge that may be too little to be found
HAND_M_S, HAND_M = 2.0, 0.4  # as fast and as high as hands are


def _small(grey: NDArray[np.uint8]) -> NDArray[np.float32]:
    """What two whole images are correlated by."""
    return cv2.resize(grey, None, fx=1 / GRID, fy=1 / GRID, interpolation=cv2.INTER_AREA).astype(np.float32)


def _shift_px(low: float | None, high: float | None) -> float | None:
    """How far two opposite edges are off in the same direction; an arm or a part over one of them moves that alone."""
    if low is None or high is None or abs(low + high) > SAME_SHIFT_PX:
        return None
    return abs(high - low) / 2


def _look(image: NDArray[np.uint8]) -> tuple[NDArray[np.uint8], NDArray[np.uint8], _Figures]:
    """An image made small, in grey, and its figures."""
    small = np.ascontiguousarray(image[::GRID, ::GRID])
    grey = np.asarray(cv2.cvtColor(image, cv2.COLOR_RGB2GRAY), np.uint8)
    return small, grey, _figures(small, grey)


def _absolute(small: NDArray[np.uint8]) -> str:
    mean, spread = (float(value[0, 0]) for value in cv2.meanStdDev(small.reshape(-1, 1)))
    if mean < DARK:
        return "dark"
    if mean > BRIGHT:
        return "bright"
    return "without contrast" if spread < LEAST_CONTRAST else ""


def _figures(small: NDArray[np.uint8], grey: NDArray[np.uint8]) -> _Figures:
    levels = small[::2, ::2].reshape(-1, 3).astype(np.float32) + 1.0
    green = levels[:, 1]
    red, blue = (np.log(_median(levels[:, channel] / green, axis=0)) for channel in (0, 2))
    steps = np.abs(cv2.Laplacian(grey, cv2.CV_16S)[::SHARP_ROWS])
    return _Figures(float(levels.mean()), float(red), float(blue), _percentile(steps, 99.5))


def _median(values: NDArray[Any], axis: int) -> Array:
    """Along an axis of even length, as `np.median`, which looks for NaN besides."""
    middle = values.shape[axis] // 2
    parted = np.partition(values, (middle - 1, middle), axis=axis)
    median: Array = parted.take((middle - 1, middle), axis=axis).mean(axis=axis)
    return median


def _percentile(steps: NDArray[np.int16], percent: float) -> float:
    """Of whole numbers from 0 to STEEPEST, as `np.percentile`: counted, which is ten times as fast as sorted."""
    counts = cv2.calcHist([steps.view(np.uint16)], [0], None, [STEEPEST + 1], [0, STEEPEST + 1])
    at, share = divmod((steps.size - 1) * percent / 100, 1)
    low, high = np.searchsorted(np.cumsum(counts.ravel().astype(np.int64)), (at, at + 1), side="right")
    return float(low + share * (high - low))


def _edges_m(bench: Bench, product: Product) -> list[tuple[Array, Array]]:
    """The plate's upper edges: points (SIDE_SAMPLES, 3) on each, and the direction (3,) out of the plate."""
    holes = np.array(list(product.bracket.holes_m.values()))
    low, high = holes.min(axis=0) - product.bracket.margin_m, holes.max(axis=0) + product.bracket.margin_m
    share = np.linspace(0.1, 0.9, SIDE_SAMPLES)
    edges = []
    for axis in (0, 1):
        other = 1 - axis
        along = low[other] + share * (high[other] - low[other])
        for at, outwards in ((low[axis], -1.0), (high[axis], 1.0)):
            points, direction = np.zeros((SIDE_SAMPLES, 3)), np.zeros(3)
            points[:, axis], points[:, other], direction[axis] = at, along, outwards
            pose = bench.bracket.pose
            edges.append((pose.transform(points), pose.rotation @ direction))
    return edges


def _across_px(view: View, edge: tuple[Array, Array]) -> NDArray[np.intp]:
    """Pixels (SIDE_SAMPLES, 2 SEARCH_PX + 1, 2) across an edge of the plate, out of it."""
    points, outwards = edge
    start = view.pixels(points)
    step = view.pixels(points + 0.01 * outwards) - start
    unit = step / np.linalg.norm(step, axis=1, keepdims=True)
    reach = np.arange(-SEARCH_PX, SEARCH_PX + 1)
    places: NDArray[np.intp] = np.rint(start[:, None, :] + reach[None, :, None] * unit[:, None, :]).astype(np.intp)
    return places


def _offsets_px(profiles: Array) -> list[float | None]:
    """How far out of the plate its edges are seen, in pixels; None where no edge is seen.

    Args:
        profiles: (edges, 2 SEARCH_PX + 1) grey levels across them.
    """
    drops = _steps(profiles)
    most = drops.max(axis=1, keepdims=True)
    away = np.where(drops >= 0.8 * most, np.abs(REACH_PX), np.inf)
    nearest = REACH_PX[away.argmin(axis=1)]
    return [float(px) if step >= LEAST_STEP else None for px, step in zip(nearest, most[:, 0], strict=True)]


def _steps(profiles: Array) -> Array:
    """(edges, places) of grey levels across STEP_PX."""
    steps: Array = np.abs(profiles[:, STEP_PX:] - profiles[:, :-STEP_PX])
    return steps


def _steepness(profiles: Array) -> list[float]:
    """Of each edge that is seen, the share of its step that lies within STEP_PX: 1 where it is sharp."""
    found = []
    for profile, steps in zip(profiles, _steps(profiles), strict=True):
        middle = int(steps.argmax()) + STEP_PX // 2
        around = profile[max(0, middle - SOFT_REACH_PX) : middle + SOFT_REACH_PX + 1]
        if steps.max() >= LEAST_STEP:
            found.append(float(steps.max() / np.ptp(around)))
    return found
