"""Synthetic images for perception tests: parts drawn through the camera model, no simulator needed."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from bracket_cell.configuration import load_configuration, load_product
from bracket_cell.learned.bench_watcher import ClassicalDetectors, DetectorChain
from bracket_cell.learned.classical.box_model import View, outline
from bracket_cell.learned.classical.settings import PerceptionSettings
from bracket_ground.interfaces.bench import Bench
from bracket_ground.interfaces.pose import Array, Pose
from bracket_ground.interfaces.product import Product

CONFIGURATION = load_configuration()
PRODUCT = load_product(CONFIGURATION)
BENCH = CONFIGURATION.bench
SKIN = np.array(CONFIGURATION.perception.classical.skin_rgb)
OVERSAMPLING = 4

Image = NDArray[np.uint8]
Standing = tuple[str, float, float, float, float]  # type, x, y, yaw, height of the body's bottom


class Canvas:
    """An image of one view, drawn at a higher resolution so that edges come out soft."""

    def __init__(self, view: View, grey: int = 100) -> None:
        self._view = view
        shape = (view.model.height_px * OVERSAMPLING, view.model.width_px * OVERSAMPLING, 3)
        self._image = np.full(shape, grey, np.uint8)

    def polygon(self, points_m: Array, colour: Array) -> None:
        """Fill a flat convex polygon (n, 3) in the world."""
        self._fill(self._view.pixels(points_m), colour)

    def _fill(self, pixels: Array, colour: Array) -> None:
        pixels = (pixels + 0.5) * OVERSAMPLING - 0.5
        cv2.fillConvexPoly(self._image, np.round(pixels * 16).astype(np.int32), (colour * 255).tolist(), shift=4)

    def disc(self, middle_m: Array, radius_m: float, colour: Array) -> None:
        """Fill a level disc around a point (3,)."""
        angles = np.linspace(0, 2 * np.pi, 40, endpoint=False)
        rim = np.column_stack([np.cos(angles), np.sin(angles), np.zeros(40)])
        self.polygon(middle_m + radius_m * rim, colour)

    def part(self, standing: Standing) -> None:
        """Draw an upright part."""
        name, x_m, y_m, yaw_rad, bottom_m = standing
        self.body(name, Pose.from_yaw((x_m, y_m, bottom_m), yaw_rad))

    def body(self, name: str, world_from_part: Pose) -> None:
        """Draw the solids of a body, the lowest first."""
        kind = PRODUCT.parts[name]
        clouds = [(world_from_part.transform(solid.points()), solid.shade) for solid in kind.solids]
        for cloud, shade in sorted(clouds, key=lambda one: float(one[0][:, 2].max())):
            self._fill(outline(self._view.pixels(cloud)), np.array(kind.colour_rgb) * shade)

    def parts(self, standing: list[Standing]) -> None:
        """Draw several parts, the farthest from the camera first."""
        eye = np.array(self._view.world_from_camera.position_m)
        for one in sorted(standing, key=lambda part: -float(np.linalg.norm(eye[:2] - part[1:3]))):
            self.part(one)

    def image(self, rng: np.random.Generator, noise: float = 3.0, gain: float = 1.0) -> Image:
        """What the sensor makes of it."""
        size = (self._view.model.width_px, self._view.model.height_px)
        clean = cv2.resize(self._image, size, interpolation=cv2.INTER_AREA).astype(np.float32) * gain
        return np.clip(clean + noise * rng.standard_normal(clean.shape, np.float32), 0, 255).astype(np.uint8)


def overhead_view() -> View:
    """The overhead camera."""
    return View(BENCH.overhead.model, BENCH.overhead.mount.pose)


def hole_m(position: str) -> Array:
    """Middle (3,) of a hole on the plate's upper side."""
    return BENCH.bracket.pose.transform(np.array([*PRODUCT.bracket.holes_m[position], 0.0]))


def in_hole(name: str, position: str, yaw_rad: float = 0.0, shift_m: tuple[float, float] = (0.0, 0.0)) -> Standing:
    """A part that stands in a hole, or beside it."""
    x_m, y_m, z_m = hole_m(position)
    return name, float(x_m) + shift_m[0], float(y_m) + shift_m[1], yaw_rad, float(z_m)


def bench_canvas() -> Canvas:
    """Table and bracket with its empty holes."""
    canvas = Canvas(overhead_view(), grey=90)
    holes = np.array([hole_m(position) for position in PRODUCT.positions])
    margin = np.array([PRODUCT.bracket.margin_m, PRODUCT.bracket.margin_m, 0.0])
    (x0, y0, z), (x1, y1, _) = holes.min(axis=0) - margin, holes.max(axis=0) + margin
    canvas.polygon(np.array([[x0, y0, z], [x1, y0, z], [x1, y1, z], [x0, y1, z]]), np.full(3, 0.65))
    for hole in holes:
        canvas.disc(hole, 0.014, np.full(3, 0.04))
    return canvas


def draw_hand(canvas: Canvas, tips_m: tuple[float, float], height_m: float = 0.10) -> None:
    """Two fingers and a palm behind their tips; a held part is drawn before."""
    x_m, y_m = tips_m
    for side in (-1, 1):
        middle_y = y_m + side * 0.025
        corners = [[x, middle_y + dy, height_m] for x, dy in ((0, -7e-3), (0, 7e-3), (0.08, 7e-3), (0.08, -7e-3))]
        canvas.polygon(np.array(corners) + np.array([x_m, 0.0, 0.0]), SKIN)
    canvas.disc(np.array([x_m + 0.11, y_m, height_m]), 0.042, SKIN)


def classical_bench_watcher(
    bench: Bench, product: Product, settings: PerceptionSettings | None = None
) -> DetectorChain:
    """The three detectors of overhead frames, one after the other."""
    detectors = ClassicalDetectors(bench, product, settings or PerceptionSettings())
    return DetectorChain(bench, product, detectors.hands(), detectors.holes(), detectors.actions())
