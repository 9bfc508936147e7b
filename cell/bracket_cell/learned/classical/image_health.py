"""Says whether an overhead image can be believed: each region of it must show fresh evidence of this bench.

Fresh: new pixels, as a sensor's noise makes them. Evidence: neither dark nor glaring, in focus, in the light and
colours of the run's first frames. Of this bench: see bench_evidence.py.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from bracket_cell.learned.classical.bench_evidence import SCENE, TILE, Mask, SceneConsistency, near_robot, robot_outline
from bracket_cell.learned.classical.box_model import View, obstacle_mask
from bracket_cell.learned.classical.due_change import DueChange
from bracket_cell.learned.classical.grain import Grain
from bracket_cell.learned.inference.prefetch import Prefetch
from bracket_ground.interfaces.bench import Bench
from bracket_ground.interfaces.frame import Frame
from bracket_ground.interfaces.perception import HandSample
from bracket_ground.interfaces.pose import Array
from bracket_ground.interfaces.product import Product


@dataclass(frozen=True)
class ImageLimits:
    """When an image cannot be judged. Origin: chosen on simulated assemblies, sound and damaged.

    Attributes:
        dark: [grey levels] mean of a dark image.
        bright: [grey levels] mean of a bright image.
        black: [grey levels] of the brightest channel of a place that shows nothing.
        white: [grey levels] of the darkest channel of a place that shows nothing.
        least_contrast: [grey levels] standard deviation of an image that shows something.
        least_colour: [grey levels] between channels of a coloured image.
        baseline_frames: [frames] that the later ones are compared with.
        light_log: change of mean light, as a logarithm.
        colour_log: change of median red or blue over green, as a logarithm.
        least_sharpness: share of the baseline's sharpness.
        least_step: [grey levels] across an edge of the plate.
        step_px: [px] across which an edge of the plate is measured.
        search_px: [px] in which it is searched.
        soft_reach_px: [px] of a soft edge's whole step.
        least_steepness: share of that step within step_px: 0.54 at a blur of 2.9 px.
        soft_frames: [frames] in a row with soft edges.
        least_edges: [edges] that must be measured.
    """

    dark: float = 16.0
    bright: float = 235.0
    black: int = 6
    white: int = 240
    least_contrast: float = 6.0
    least_colour: float = 4.0
    baseline_frames: int = 8
    light_log: float = 0.3
    colour_log: float = 0.14
    least_sharpness: float = 0.5
    least_step: float = 10.0
    step_px: int = 4
    search_px: int = 16
    soft_reach_px: int = 8
    least_steepness: float = 0.54
    soft_frames: int = 8
    least_edges: int = 2


IMAGE = ImageLimits()


SIDE_SAMPLES = 24
STEEPEST = 4 * 255  # of what the Laplacian makes of grey levels
SHARP_ROWS = 4  # every fourth row is enough for sharpness


@dataclass(frozen=True)
class _Figures:
    """What an image is compared by."""

    light: float
    red: float
    blue: float
    sharpness: float


@dataclass(frozen=True, eq=False)
class _Looked:
    """What follows from an image alone.

    Attributes:
        samples: every TILE-th pixel along both axes.
        small: the means of TILE x TILE pixels.
        high, low: the brightest and the darkest channel of those.
        grey: the image in grey.
    """

    samples: NDArray[np.uint8]
    small: NDArray[np.uint8]
    high: NDArray[np.uint8]
    low: NDArray[np.uint8]
    grey: NDArray[np.uint8]
    figures: _Figures


class ImageHealth:
    """Judges the frames of one camera in their order.

    Attributes:
        unseen: why the image does not show this bench, in words; empty where it does.
        unexplained: what is in view that should be seen as a hand, in words; empty where there is nothing.
    """

    def __init__(self, bench: Bench, product: Product) -> None:
        self._view = view = View(bench.overhead.model, bench.overhead.mount.pose)
        edges = np.array([_across_px(view, edge) for edge in _edges_m(bench, product)])
        size_px = bench.overhead.model.width_px, bench.overhead.model.height_px
        edges = edges[((edges >= 0) & (edges < size_px)).all(axis=(1, 2, 3))]
        covered = obstacle_mask(view, bench)[edges[..., 1], edges[..., 0]]
        self._edges = edges[~covered.any(axis=(1, 2))]
        self._baseline: list[_Figures] = []
        self._usual: _Figures | None = None
        self._fresh, self._due = Freshness(bench.overhead.rate_hz), DueChange(_uncovered(view, bench))
        self._evidence = SceneConsistency(bench, product)
        self._soft = 0
        self.unseen = self.unexplained = ""
        self._looked = Prefetch(_look)

    def judge(self, frame: Frame, hands: Sequence[HandSample] = ()) -> str:
        """What is wrong with it, in words; empty for a sound image.

        Args:
            hands: all that are seen in it.
        """
        looked = self._looked(frame.image)
        nothing = _absolute(looked)
        health = self._fresh.judge(looked.samples) or nothing or self._compared(looked.figures)
        robot = robot_outline(frame.robot_m, self._view, looked.small.shape[:2])
        health = health or _glaring(looked, robot) or self._focus(looked.grey)
        if not nothing:  # such an image says nothing of where the camera looks
            self._evidence.see(frame, looked.small, looked.grey, hands)
            self._due.see(frame, looked.small, robot)
        self.unseen = self._fresh.repeats or self._due.late or self._evidence.unseen
        self.unexplained = self._evidence.unexplained
        return health or self._due.stuck or self.unseen or self.unexplained

    def prepare(self, image: NDArray[np.uint8]) -> None:
        """Do before anybody asks what follows from the image alone."""
        self._looked.prepare(image)

    def _compared(self, figures: _Figures) -> str:
        usual = self._usual
        if usual is None:
            self._baseline.append(figures)
            if len(self._baseline) == IMAGE.baseline_frames:
                self._usual = _Figures(*np.median([tuple(vars(seen).values()) for seen in self._baseline], axis=0))
            return ""
        light = float(np.log(figures.light / usual.light))
        if abs(light) > IMAGE.light_log:
            return "brighter than before" if light > 0 else "darker than before"
        if max(abs(figures.red - usual.red), abs(figures.blue - usual.blue)) > IMAGE.colour_log:
            return "discoloured"
        return "blurred" if figures.sharpness < IMAGE.least_sharpness * usual.sharpness else ""

    def _focus(self, grey: NDArray[np.uint8]) -> str:
        """Whether the edges of the plate are soft for long; an arm over them looks like that for a moment."""
        steepness = _steepness(_median(grey[self._edges[..., 1], self._edges[..., 0]], axis=1))
        soft = len(steepness) >= IMAGE.least_edges and float(np.median(steepness)) < IMAGE.least_steepness
        self._soft = self._soft + 1 if soft else 0
        return "blurred" if self._soft >= IMAGE.soft_frames else ""


@dataclass(frozen=True)
class FreshnessLimits:
    """Limits of `Freshness`. Origin: chosen on simulated assemblies, with live and with frozen images.

    Attributes:
        cell: [samples] side of the squares that are looked at by themselves.
        stuck_frames: [frames] in which a square stays the same.
        stuck_share: share of such squares, from which part of the image is frozen.
        noise: [grey levels] by which noise changes a sample.
        noise_share: share of samples that change by more.
        noisy_frames: [frames] in a row.
        rhythm: [frames] in which a camera that repeats its images shows it.
        repeats: [frames] of these at least that repeat the one before, and at least that do not.
        again: [frames] of the last `rhythm` ones that are old; by chance one may look so, as what is still does.
    """

    cell: int = 5
    stuck_frames: int = 5
    stuck_share: float = 0.02
    noise: int = 30
    noise_share: float = 0.12
    noisy_frames: int = 12
    rhythm: int = 12
    repeats: int = 4
    again: int = 2


class Freshness:
    """Whether images are new ones, as a whole and in part.

    Args:
        rate_hz: images a second that the camera is set to.

    Attributes:
        repeats: that old images came again, in words; from then on nobody knows how old images are.
    """

    def __init__(self, rate_hz: float, limits: FreshnessLimits = FreshnessLimits()) -> None:
        self._rate_hz, self._limits = rate_hz, limits
        self._grain = Grain()
        self._before: NDArray[np.uint8] | None = None
        self._same: NDArray[np.intp] = np.zeros((1, 1), np.intp)  # frames in a row in which each cell was the same
        self._noisy = 0
        self._repeated: deque[bool] = deque(maxlen=limits.rhythm)
        self._agos: deque[int] = deque(maxlen=limits.rhythm)
        self.repeats = ""

    def judge(self, samples: NDArray[np.uint8]) -> str:
        """Whether it is stuck, in words."""
        before, self._before = self._before, samples
        if before is None:
            return ""
        changes, limits = cv2.absdiff(samples, before), self._limits
        repeated = not changes.any()
        self._repeated.append(repeated)
        if not repeated:
            self._grain.see(samples)
            self._agos.append(self._grain.ago)
        self._noisy = self._noisy + 1 if float((changes > limits.noise).mean()) > limits.noise_share else 0
        if not self.repeats and np.count_nonzero(self._agos) >= limits.again:
            self.repeats = f"an image of {max(self._agos)} frames ago came again"
        return (
            self._rhythm()
            or self._stuck(np.asarray(changes, np.uint8))
            or "noise in part" * (self._noisy >= limits.noisy_frames)
        )

    def _rhythm(self) -> str:
        """Whether a camera sends each image several times, in words."""
        old = sum(self._repeated)
        if min(old, len(self._repeated) - old) < self._limits.repeats:
            return ""
        fresh_hz = self._rate_hz * (1 - old / len(self._repeated))
        return f"sent several times: {fresh_hz:.3g} new ones a second, not {self._rate_hz:g} as rate_hz says"

    def _stuck(self, changes: NDArray[np.uint8]) -> str:
        limits = self._limits
        rows, columns = changes.shape[0] // limits.cell, changes.shape[1] // limits.cell
        cells = changes[: rows * limits.cell, : columns * limits.cell].reshape(rows, limits.cell, columns, -1)
        self._same = np.where(cells.any(axis=(1, 3)), 0, self._same + 1)
        if self._repeated[-1]:
            return "frozen"
        in_part = (self._same + 1 >= limits.stuck_frames).mean() > limits.stuck_share
        return "frozen in part" if in_part else "frozen, but for its noise" * self._grain.copies


def _uncovered(view: View, bench: Bench) -> NDArray[np.bool_]:
    """Small pixels that no obstacle hides."""
    covered = obstacle_mask(view, bench)
    size = view.model.width_px // TILE, view.model.height_px // TILE
    small: NDArray[np.bool_] = np.asarray(cv2.resize(covered, size, interpolation=cv2.INTER_AREA)) == 0
    return small


def _look(image: NDArray[np.uint8]) -> _Looked:
    samples = np.ascontiguousarray(image[::TILE, ::TILE])
    small = cv2.resize(image, None, fx=1 / TILE, fy=1 / TILE, interpolation=cv2.INTER_AREA)
    grey = np.asarray(cv2.cvtColor(image, cv2.COLOR_RGB2GRAY), np.uint8)
    red, green, blue = cv2.split(small)
    high, low = cv2.max(cv2.max(red, green), blue), cv2.min(cv2.min(red, green), blue)
    small, high, low = (np.asarray(levels, np.uint8) for levels in (small, high, low))
    return _Looked(samples, small, high, low, grey, _figures(samples, grey))


def _absolute(looked: _Looked) -> str:
    mean, spread = (float(value[0, 0]) for value in cv2.meanStdDev(looked.samples.reshape(-1, 1)))
    if mean < IMAGE.dark:
        return "dark"
    if mean > IMAGE.bright:
        return "bright"
    if spread < IMAGE.least_contrast:
        return "without contrast"
    return "without colour" if float(np.max(looked.high - looked.low)) < IMAGE.least_colour else ""


def _glaring(looked: _Looked, robot: Mask) -> str:
    """Whether part of the bench cannot be seen for it; a white arm in the light hides no more of it than a grey one."""
    dead = (((looked.high < IMAGE.black) | (looked.low > IMAGE.white)) & ~near_robot(robot)).astype(np.float32)
    shares = cv2.boxFilter(dead, -1, (SCENE.thick, SCENE.thick), borderType=cv2.BORDER_REPLICATE)
    return "black or glaring in part" if bool((shares > SCENE.thick_share).any()) else ""


def _figures(samples: NDArray[np.uint8], grey: NDArray[np.uint8]) -> _Figures:
    levels = samples[::2, ::2].reshape(-1, 3).astype(np.float32) + 1.0
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
    reach = np.arange(-IMAGE.search_px, IMAGE.search_px + 1)
    places: NDArray[np.intp] = np.rint(start[:, None, :] + reach[None, :, None] * unit[:, None, :]).astype(np.intp)
    return places


def _steps(profiles: Array) -> Array:
    """(edges, places) of grey levels across STEP_PX."""
    steps: Array = np.abs(profiles[:, IMAGE.step_px :] - profiles[:, : -IMAGE.step_px])
    return steps


def _steepness(profiles: Array) -> list[float]:
    """Of each edge that is seen, the share of its step that lies within STEP_PX: 1 where it is sharp."""
    found = []
    for profile, steps in zip(profiles, _steps(profiles), strict=True):
        middle = int(steps.argmax()) + IMAGE.step_px // 2
        around = profile[max(0, middle - IMAGE.soft_reach_px) : middle + IMAGE.soft_reach_px + 1]
        if steps.max() >= IMAGE.least_step:
            found.append(float(steps.max() / np.ptp(around)))
    return found
