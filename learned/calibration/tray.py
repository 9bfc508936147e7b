"""How far the wrist camera sees the tray off: opposite edges of its rim look alike, and move together."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from cell.interfaces.bench import Bench
from cell.interfaces.pose import Array, Pose
from learned.calibration.landmarks import STEP_PX, Rectangle, profiles

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
    """What two lines have in common where the first lies so many steps farther out."""
    if lag < 0:
        low, high = _overlapping(low, high, -lag)
        return high, low
    return high[lag:], low[: len(low) - lag]


def _correlation(one: Array, other: Array) -> float:
    one, other = one - one.mean(), other - other.mean()
    return float((one * other).sum() / max(1e-9, float(np.linalg.norm(one) * np.linalg.norm(other))))
