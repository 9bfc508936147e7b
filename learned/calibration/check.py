"""Looks at the start and once a minute whether the cameras still hang where their calibration says."""

from __future__ import annotations

import numpy as np

from cell.interfaces.bench import Bench
from cell.interfaces.perception import Frame, HandSample
from cell.interfaces.pose import Pose
from cell.interfaces.product import Product
from learned.calibration.landmarks import PlateModel
from learned.calibration.solve import MOST_RMS_PX, REACHES_M, Fit, Shot, fit_camera, holes_off_m
from learned.calibration.tray import tray_off_m

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
            self._words = f"the overhead camera sees the holes {off_mm:.0f} mm off; run `cell calibrate`"
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
                self._words = f"the wrist camera sees the tray {off_mm:.0f} mm off; run `cell calibrate`"
            self._due_s, self._off_m = frame.time_s + EVERY_S, []
        return self._words
