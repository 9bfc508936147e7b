"""Finds the hand by the colour of skin, and the part between its fingers by the part's colour."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from bracket_cell.learned.classical.box_model import View
from bracket_cell.learned.classical.colour import ColourModel, Labels
from bracket_cell.learned.classical.settings import PerceptionSettings
from bracket_cell.learned.classical.silhouette import top_areas_m2
from bracket_ground.interfaces.bench import Bench
from bracket_ground.interfaces.frame import Frame
from bracket_ground.interfaces.perception import HandSample
from bracket_ground.interfaces.pose import Array
from bracket_ground.interfaces.product import Product

TIP_DEPTH_M = 0.012  # fingertips reach this far behind the foremost one
HELD_BEHIND_M = 0.050  # where a held part may show: behind, ahead of and beside the fingertips
HELD_AHEAD_M = 0.065
HELD_BESIDE_M = 0.034
HELD_SHARE = 0.15  # of a body's top that must show
TOUCH_PX = 3

Box = tuple[int, int, int, int]


class ClassicalHandTracker:
    """Segments skin and takes the largest piece as the hand (HandTracker)."""

    def __init__(self, bench: Bench, product: Product, settings: PerceptionSettings, colours: ColourModel) -> None:
        self._bench = bench
        self._product = product
        self._settings = settings
        self._colours = colours
        self._tops_m2 = dict(zip(product.parts, top_areas_m2(list(product.parts.values())), strict=True))
        view = View(bench.overhead.model, bench.overhead.mount.pose)
        self._scale = view.pixels_per_m((*bench.bracket.position_m[:2], settings.hand_height_m))

    @property
    def others(self) -> tuple[HandSample, ...]:
        """None: only the largest piece of skin is looked at."""
        return ()

    def track(self, frame: Frame) -> HandSample | None:
        """The hand and what it holds, or None where no hand is in view."""
        labels = self._colours.label(frame.image)
        view = View.of(self._bench.overhead.model, frame)
        skin, box = self._largest(labels)
        if skin is None:
            return None
        left, top, _, _ = box
        contours, _ = cv2.findContours(skin, cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)
        edge = np.concatenate([contour.reshape(-1, 2) for contour in contours]) + np.array([left, top])
        tips = _fingertips(view.on_plane(edge, self._settings.hand_height_m))
        held, box = self._held(view, labels, skin, box, tips)
        return HandSample(
            time_s=frame.time_s,
            box_px=box,
            fingertips_m=(float(tips[0]), float(tips[1])),
            palm_m=self._palm(view, skin, (left, top)),
            held_part=held,
        )

    def _largest(self, labels: Labels) -> tuple[Labels | None, Box]:
        """The mask of the largest piece of skin within its box (left, top, right, bottom)."""
        skin = (labels == self._colours.skin).astype(np.uint8)
        skin = np.asarray(cv2.morphologyEx(skin, cv2.MORPH_OPEN, np.ones((3, 3), np.uint8)), np.uint8)
        x, y, width, height = cv2.boundingRect(skin)
        if width == 0:
            return None, (0, 0, 0, 0)
        _, pieces, stats, _ = cv2.connectedComponentsWithStats(skin[y : y + height, x : x + width], connectivity=8)
        areas = stats[1:, cv2.CC_STAT_AREA]
        if len(areas) == 0 or areas.max() < self._settings.hand_area_m2 * self._scale**2:
            return None, (0, 0, 0, 0)
        index = int(areas.argmax()) + 1
        left, top, width, height, _ = (int(value) for value in stats[index])
        piece = (pieces[top : top + height, left : left + width] == index).astype(np.uint8)
        return piece, (x + left, y + top, x + left + width, y + top + height)

    def _palm(self, view: View, skin: Labels, corner: tuple[int, int]) -> tuple[float, float]:
        """The middle of the hand's widest place."""
        padded = cv2.copyMakeBorder(skin, 3, 3, 3, 3, cv2.BORDER_CONSTANT, value=0)
        whole = cv2.morphologyEx(padded, cv2.MORPH_CLOSE, np.ones((5, 5), np.uint8))
        _, _, _, (column, row) = cv2.minMaxLoc(cv2.distanceTransform(whole, cv2.DIST_L2, 3))
        pixel = np.array([[column - 3 + corner[0], row - 3 + corner[1]]])
        x_m, y_m = view.on_plane(pixel, self._settings.hand_height_m)[0]
        return float(x_m), float(y_m)

    def _held(self, view: View, labels: Labels, skin: Labels, box: Box, tips: Array) -> tuple[str | None, Box]:
        """The type between the fingers, and the hand's box with it."""
        window = self._window(view, tips)
        left, top, right, bottom = window
        crop = labels[top:bottom, left:right]
        near = _paste(skin, box, window)
        near = np.asarray(cv2.dilate(near, np.ones((2 * TOUCH_PX + 1, 2 * TOUCH_PX + 1), np.uint8)), np.uint8)
        best: tuple[float, str, Box] | None = None
        for label, (name, top_m2) in enumerate(self._tops_m2.items(), start=1):
            area, extent = _touching(crop == label, near)
            share = area / (top_m2 * self._scale**2)
            if share > HELD_SHARE and (best is None or area > best[0]):
                best = (area, name, extent)
        if best is None:
            return None, box
        _, name, (x0, y0, x1, y1) = best
        return name, (min(box[0], x0 + left), min(box[1], y0 + top), max(box[2], x1 + left), max(box[3], y1 + top))

    def _window(self, view: View, tips: Array) -> Box:
        """The part of the image where a held part may show."""
        reach = np.array([[x, y] for x in (-HELD_AHEAD_M, HELD_BEHIND_M) for y in (-HELD_BESIDE_M, HELD_BESIDE_M)])
        corners = np.column_stack([tips + reach, np.full(4, self._settings.hand_height_m)])
        pixels = view.pixels(corners)
        model = view.model
        low = np.clip(np.floor(pixels.min(axis=0)), 0, (model.width_px - 1, model.height_px - 1)).astype(int)
        high = np.clip(np.ceil(pixels.max(axis=0)) + 1, low + 1, (model.width_px, model.height_px)).astype(int)
        return int(low[0]), int(low[1]), int(high[0]), int(high[1])


def _fingertips(edge_m: Array) -> Array:
    """The middle (x, y) of the fingertips: the person stands at +x and reaches towards -x."""
    foremost = np.partition(edge_m[:, 0], min(3, len(edge_m) - 1))[min(3, len(edge_m) - 1)]
    tips = edge_m[edge_m[:, 0] < foremost + TIP_DEPTH_M]
    return np.array([foremost, (tips[:, 1].min() + tips[:, 1].max()) / 2])


def _paste(mask: Labels, box: Box, window: Box) -> Labels:
    """A mask that stands at `box` in the image, seen through `window`."""
    left, top, right, bottom = window
    seen = np.zeros((bottom - top, right - left), np.uint8)
    x0, y0, x1, y1 = max(box[0], left), max(box[1], top), min(box[2], right), min(box[3], bottom)
    if x0 < x1 and y0 < y1:
        seen[y0 - top : y1 - top, x0 - left : x1 - left] = mask[y0 - box[1] : y1 - box[1], x0 - box[0] : x1 - box[0]]
    return seen


def _touching(coloured: NDArray[np.bool_], near: Labels) -> tuple[float, Box]:
    """Area and box of the largest coloured piece that touches the hand."""
    count, pieces, stats, _ = cv2.connectedComponentsWithStats(coloured.astype(np.uint8), connectivity=8)
    best = (0.0, (0, 0, 0, 0))
    for index in range(1, count):
        left, top, width, height, area = (int(value) for value in stats[index])
        if area > best[0] and bool(near[pieces == index].any()):
            best = (float(area), (left, top, left + width, top + height))
    return best
