"""Looks at the start and once a minute whether the cameras still hang where their calibration says."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from bracket_cell.learned.calibration.landmarks import STEP_PX, PlateModel, Rectangle, profiles
from bracket_cell.learned.calibration.solve import MOST_RMS_PX, REACHES_M, Fit, Shot, fit_camera, holes_off_m
from bracket_ground.interfaces.bench import Bench
from bracket_ground.interfaces.frame import Frame
from bracket_ground.interfaces.perception import HandSample
from bracket_ground.interfaces.pose import Array, Pose
from bracket_ground.interfaces.product import Product

EVERY_S, AGAIN_S = 60.0, 0.5  # between checks, and between looks of one check
LOOKS = 3  # that must agree, and that a check takes
MOST_LOOKS = 20  # hand and arm are often in the way; then the check waits for the next minute
MOST_OFF_M = 0.010  # at the holes
LEAST_SEEN = 0.6  # of the plate's edges
NEAR_REACHES_M = REACHES_M[1:]  # of a search that finds the plate only where it is believed to be
MARGIN_PX = 15.0  # around the plate: a hand this near may hide it
WORLD = Pose((0.0, 0.0, 0.0))


def trouble(fit: Fit, images: int, bench: Bench, product: Product) -> str:
    """Why a fit cannot be believed, in words; empty for a good one."""
    points = len(PlateModel.of(bench, product).edges_m)
    if fit.images < images:
        return f"the bracket's plate is seen in {fit.images} of {images} images"
    if fit.rms_px > MOST_RMS_PX:
        return f"a bad fit: the plate is seen {fit.rms_px:.1f} pixels off what any place of the camera explains"
    if fit.edges < LEAST_SEEN * points and fit.holes == 0:
        return "too little of the plate is seen"
    return ""


class CalibrationCheck:
    """Judges the frames of the overhead camera in their order."""

    def __init__(self, bench: Bench, product: Product) -> None:
        self._bench, self._product = bench, product
        self._points = len(PlateModel.of(bench, product).edges_m)
        seen = bench.overhead.model.project(bench.overhead.mount.pose, PlateModel.of(bench, product).edges_m)
        self._plate_px = seen.min(axis=0) - MARGIN_PX, seen.max(axis=0) + MARGIN_PX
        self._due_s = 0.0
        self._off_m: list[float] = []
        self._looks = 0
        self._words = ""

    def judge(self, frame: Frame, hand: HandSample | None) -> str:
        """What is wrong with the calibration, in words; empty where nothing is known to be.

        Args:
            hand: nothing is looked at while it is at the plate.
        """
        if frame.time_s >= self._due_s and not self._words and (hand is None or not self._at_plate(hand.box_px)):
            self._look(frame)
        return self._words

    def _at_plate(self, box_px: tuple[int, int, int, int]) -> bool:
        left, top, right, bottom = box_px
        low, high = self._plate_px
        return bool(left < high[0] and right > low[0] and top < high[1] and bottom > low[1])

    def _look(self, frame: Frame) -> None:
        setup, fit = self._bench.overhead, self._fit(frame)
        self._looks += 1
        if not trouble(fit, 1, self._bench, self._product) and fit.edges >= LEAST_SEEN * self._points:
            self._off_m.append(holes_off_m(setup, fit.setup, self._bench, self._product))
        over = len(self._off_m) >= LOOKS
        if over and min(self._off_m) > MOST_OFF_M:
            off_mm = 1e3 * sorted(self._off_m)[LOOKS // 2]
            self._words = f"the overhead camera sees the holes {off_mm:.0f} mm off; run `cell setup calibrate`"
        if over or self._looks >= MOST_LOOKS:
            self._due_s, self._off_m, self._looks = frame.time_s + EVERY_S, [], 0
        else:
            self._due_s = frame.time_s + AGAIN_S

    def _fit(self, frame: Frame) -> Fit:
        """The camera as the frame shows it.

        A search that reaches far takes the feet of parts for an edge of a plate that is nearly full, now and then. So
        a camera that seems to have moved is looked for near its place, too, and there it is if no less is seen then.
        """
        seen = [Shot(frame.image, WORLD)], self._bench.overhead, self._bench, self._product
        fit = fit_camera(*seen)
        if holes_off_m(self._bench.overhead, fit.setup, self._bench, self._product) <= MOST_OFF_M:
            return fit
        near = fit_camera(*seen, reaches_m=NEAR_REACHES_M)
        return near if (near.edges, near.holes) >= (fit.edges, fit.holes) and near.rms_px <= fit.rms_px else fit


class TrayCheck:
    """Judges the frames of the wrist camera in their order; one that does not show the tray's rim well says nothing."""

    def __init__(self, bench: Bench) -> None:
        self._bench = bench
        self._due_s = 0.0
        self._off_m: list[float] = []
        self._words = ""

    def judge(self, frame: Frame) -> str:
        """What is wrong with the calibration, in words; empty where nothing is known to be.

        Args:
            frame: its `world_from_camera` is that of the calibration.
        """
        if frame.time_s < self._due_s or self._words:
            return self._words
        off = tray_off_m(frame.image, frame.world_from_camera, self._bench)
        if off is not None:
            self._off_m.append(float(np.linalg.norm(off)))
        if len(self._off_m) == LOOKS:
            if min(self._off_m) > MOST_OFF_M:
                off_mm = 1e3 * sorted(self._off_m)[LOOKS // 2]
                self._words = f"the wrist camera sees the tray {off_mm:.0f} mm off; run `cell setup calibrate`"
            self._due_s, self._off_m = frame.time_s + EVERY_S, []
        return self._words


REACH_M = 0.035  # of the search on the tray, to both sides
MOST_M = 0.025  # shift that is looked for
LEAST_RIM_SEEN = 0.5  # of the points of each edge
LEAST_ALIKE = 0.9  # correlation of opposite edges
LEAST_CLEARER = 0.1  # than that of any other shift farther than a rim's width
RIM_M = 0.008


def tray_off_m(image: NDArray[np.uint8], world_from_camera: Pose, bench: Bench) -> Array | None:
    """Where the tray is seen, less where it is, (2,) along x and y; None where its rim is not seen well enough.

    Which lines a rim shows depends on light and colours, but opposite edges show the same ones: where a camera is off,
    one edge is seen too far out and the opposite one as much too far in.

    Args:
        world_from_camera: where the camera is believed to be.
    """
    tray, camera = bench.tray, bench.wrist.model
    half, (x, y, z) = np.array(tray.size_m) / 2, tray.centre_m
    rim = Rectangle.between(-half, half, Pose((x, y, z + tray.wall_m)))
    depth_m = float(world_from_camera.inverse().transform(rim.edges_m)[:, 2].mean())
    if depth_m <= REACH_M:
        return None
    grey = np.asarray(cv2.cvtColor(image, cv2.COLOR_RGB2GRAY), np.float32)
    a_metre_px = camera.focal_px / depth_m
    found = profiles(grey, camera, world_from_camera, rim, REACH_M * a_metre_px)
    sides = rim.sides[found.chosen]
    if any((sides == side).sum() < LEAST_RIM_SEEN * (rim.sides == side).sum() for side in range(4)):
        return None
    lines = [np.median(found.slopes[sides == side], axis=0) for side in range(4)]
    lags = [_lag(lines[2 * axis + 1], lines[2 * axis], a_metre_px) for axis in (0, 1)]
    if lags[0] is None or lags[1] is None:
        return None
    return np.array(lags, float) / 2 * STEP_PX / a_metre_px


def _lag(high: Array, low: Array, a_metre_px: float) -> float | None:
    """By how many steps the first line lies farther out than the second; None where they are not clearly alike."""
    most, rim = (2 * round(length_m * a_metre_px / STEP_PX) for length_m in (MOST_M, RIM_M))
    lags = range(-most, most + 1)
    alike = np.array([_correlation(*_overlapping(high, low, lag)) for lag in lags])
    best = int(alike.argmax())
    others = alike[np.abs(np.arange(len(alike)) - best) > rim]
    if alike[best] < LEAST_ALIKE or (len(others) and alike[best] - others.max() < LEAST_CLEARER):
        return None
    return float(lags[best])


def _overlapping(high: Array, low: Array, lag: int) -> tuple[Array, Array]:
    """What two lines have in common where the first lies a number of steps farther out."""
    if lag < 0:
        low, high = _overlapping(low, high, -lag)
        return high, low
    return high[lag:], low[: len(low) - lag]


def _correlation(one: Array, other: Array) -> float:
    one, other = one - one.mean(), other - other.mean()
    return float((one * other).sum() / max(1e-9, float(np.linalg.norm(one) * np.linalg.norm(other))))
