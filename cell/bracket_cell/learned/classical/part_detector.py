"""Finds parts in the wrist camera's view as oriented boxes with poses on the bench."""

from __future__ import annotations

import math

import cv2
import numpy as np

from bracket_cell.learned.classical.box_model import View, body_corners, fill, outline
from bracket_cell.learned.classical.colour import BACKGROUND, ColourModel, Labels
from bracket_cell.learned.classical.part_fit import ShapeFit, ShapeFitter
from bracket_cell.learned.classical.settings import PerceptionSettings
from bracket_ground.interfaces.bench import Bench
from bracket_ground.interfaces.frame import Frame
from bracket_ground.interfaces.perception import PartDetection
from bracket_ground.interfaces.pose import Pose
from bracket_ground.interfaces.product import PartType, Product

LEAST_SUPPORT = 0.75
LEAST_AGREEMENT = 0.75  # parts that lie on their side stay below 0.7, those that stand above 0.9
LEAST_VISIBLE = 0.25
NEAREST_M = 0.05  # from the camera to the tray


class ClassicalPartDetector:
    """Segments by colour and fits the projected shape of each type to its pixels (PartDetector)."""

    def __init__(self, bench: Bench, product: Product, settings: PerceptionSettings | None = None) -> None:
        self._bench = bench
        self._product = product
        self._settings = settings or PerceptionSettings()
        self._colours = ColourModel(product, self._settings.skin_rgb)

    def detect(self, frame: Frame) -> tuple[PartDetection, ...]:
        """Parts in and near the tray, in the product's order of types."""
        view = View.of(self._bench.wrist.model, frame)
        region = self._tray_region(view)
        if region is None:
            return ()
        labels = np.asarray(cv2.medianBlur(self._colours.label(frame.image), 3), np.uint8) * region
        found: list[PartDetection] = []
        for label, name in enumerate(self._product.parts, start=1):
            part = self._product.parts[name]
            bottom_m = self._bench.tray.centre_m[2] + part.peg_length_m
            fitter = ShapeFitter(view, part, bottom_m)
            own = (labels == label).astype(np.uint8)
            fits = [fit for fit in fitter.fit(own, _hidden(labels, label)) if self._counts(fit)]
            found += [_detection(name, part, fit, fitter, bottom_m) for fit in fits]
        return tuple(found)

    def _tray_region(self, view: View) -> Labels | None:
        """1 where parts in and near the tray can be seen; None where the camera does not look down at it."""
        tray = self._bench.tray
        longest_m = max(part.size_m[0] for part in self._product.parts.values())
        length, width = np.array(tray.size_m) + 2 * self._settings.tray_margin_m + longest_m
        tallest_m = max(part.size_m[2] + part.peg_length_m for part in self._product.parts.values())
        x_m, y_m, z_m = tray.centre_m
        corners = body_corners((length, width, tallest_m), x_m, y_m, 0.0, z_m)
        if float(view.depths(corners).min()) < NEAREST_M:
            return None
        return fill((view.model.height_px, view.model.width_px), outline(view.pixels(corners)))

    def _counts(self, fit: ShapeFit) -> bool:
        stands = fit.support >= LEAST_SUPPORT and fit.agreement >= LEAST_AGREEMENT
        return stands and fit.visible >= LEAST_VISIBLE and self._near_tray(fit)

    def _near_tray(self, fit: ShapeFit) -> bool:
        tray = self._bench.tray
        reach = np.array(tray.size_m) / 2 + self._settings.tray_margin_m
        offset = np.abs(np.array([fit.x_m, fit.y_m]) - np.array(tray.centre_m[:2]))
        return bool((offset < reach).all())


def _hidden(labels: Labels, label: int) -> Labels:
    """1 where another part stands that may hide one of this label, or the image ends."""
    hidden: Labels = ((labels != BACKGROUND) & (labels != label)).astype(np.uint8)
    hidden[[0, -1], :] = 1
    hidden[:, [0, -1]] = 1
    return hidden


def _detection(name: str, part: PartType, fit: ShapeFit, fitter: ShapeFitter, bottom_m: float) -> PartDetection:
    turn = math.pi if part.alike_after_half_turn else 2 * math.pi
    yaw_rad = (fit.yaw_rad + turn / 2) % turn - turn / 2
    points = fitter.silhouette(fit).points
    left, top = np.floor(points.min(axis=0)).astype(int)
    right, bottom = np.ceil(points.max(axis=0)).astype(int) + 1
    return PartDetection(
        part=name,
        confidence=fit.support * fit.agreement * (0.5 + 0.5 * fit.visible),
        world_from_part=Pose.from_yaw((fit.x_m, fit.y_m, bottom_m), yaw_rad),
        size_m=part.size_m,
        box_px=(int(left), int(top), int(right), int(bottom)),
    )
