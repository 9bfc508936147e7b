"""Fits upright parts of one type to the pixels of its colour: seeds by correlation, then least squares on outlines."""

from __future__ import annotations

from dataclasses import dataclass, replace

import cv2
import numpy as np
from numpy.typing import NDArray

from bracket_cell.learned.classical.box_model import View, body_corners
from bracket_cell.learned.classical.silhouette import Silhouette, Solids
from bracket_ground.interfaces.pose import Array
from bracket_ground.interfaces.product import PartType

Mask = NDArray[np.uint8]

SEED_YAWS = 12  # over half a turn
SEED_SCALE = 2  # seeds are searched in an image this much smaller
RING_PX = 2  # pixels around a seed that should not be of its colour
FLOOR_COST = 1.5
TAKEN_COST = 0.3  # a neighbour may hide a body's sides
LEAST_SEED_SCORE = 0.35
MOST_OVERLAP = 0.2  # of two footprints; bodies cannot stand inside each other
ROUNDS = 4
REACH_PX = 8.0  # outline points farther from every box belong to none
HUBER_PX = 1.0
AGREE_PX = 1.5
EDGE_PX = 0.5  # the true edge runs half a pixel outside the outermost pixel's centre


@dataclass(frozen=True)
class ShapeFit:
    """An upright part on the floor.

    Attributes:
        support: share of its visible pixels that show the right colour.
        agreement: share of the outline pixels nearest to it that lie on its outline; low where a part lies on its
            side.
        visible: share of its pixels that nothing of another colour hides.
    """

    x_m: float
    y_m: float
    yaw_rad: float
    support: float = 0.0
    agreement: float = 0.0
    visible: float = 1.0


class ShapeFitter:
    """Finds all parts of one type in a mask of their colour."""

    def __init__(self, view: View, part: PartType, bottom_m: float) -> None:
        self._view = view
        self._solids = Solids(part.solids)
        self._size_m = part.size_m
        self._bottom_m = bottom_m
        turns = 1 if part.alike_after_half_turn else 2
        self._yaws_rad = np.arange(turns * SEED_YAWS) * np.pi / SEED_YAWS

    def silhouette(self, fit: ShapeFit) -> Silhouette:
        """What a part covers in the image."""
        return self._solids.silhouette(self._view, fit.x_m, fit.y_m, fit.yaw_rad, self._bottom_m)

    def fit(self, own: Mask, hidden: Mask) -> list[ShapeFit]:
        """Parts in a mask.

        Args:
            own: (height, width), 1 where a pixel has the type's colour.
            hidden: 1 where something else may stand before a part: other parts, the image's border.
        """
        count, components, stats, _ = cv2.connectedComponentsWithStats(own, connectivity=8)
        fits: list[ShapeFit] = []
        for index in range(1, count):
            left, top, width, height, area = (int(value) for value in stats[index])
            middle = np.array([[left + width / 2, top + height / 2]])
            x_m, y_m = self._view.on_plane(middle, self._bottom_m + self._size_m[2] / 2)[0]
            if area < 0.2 * self.silhouette(ShapeFit(x_m, y_m, 0.0)).area_px():
                continue
            fits += self._fit_component((components == index).astype(np.uint8), hidden, (left, top, width, height))
        return fits

    def _fit_component(self, own: Mask, hidden: Mask, box: tuple[int, int, int, int]) -> list[ShapeFit]:
        seeds: list[ShapeFit] = []
        remaining = own.copy()
        expected = None
        while (seed := self._best_seed(remaining, own, hidden, box)) is not None:
            seeds.append(seed)
            silhouette = self.silhouette(seed)
            expected = expected or silhouette.area_px()
            remaining &= 1 - silhouette.fill(own.shape)
            if int(remaining.sum()) < 0.3 * expected or len(seeds) > 8:
                break
        return self._apart(self.refine(seeds, own, hidden)) if seeds else []

    def _apart(self, fits: list[ShapeFit]) -> list[ShapeFit]:
        """Without parts that stand inside an earlier one."""
        kept: list[ShapeFit] = []
        for fit in fits:
            footprint = self._footprint(fit)
            overlaps = [cv2.intersectConvexConvex(footprint, self._footprint(other))[0] for other in kept]
            if max(overlaps, default=0.0) < MOST_OVERLAP * self._size_m[0] * self._size_m[1] * 1e6:
                kept.append(fit)
        return kept

    def _footprint(self, fit: ShapeFit) -> NDArray[np.float32]:
        """Corners (4, 2) of the body on the floor, in [mm]."""
        corners = body_corners(self._size_m, fit.x_m, fit.y_m, fit.yaw_rad, self._bottom_m)[:4, :2]
        return (corners * 1e3).astype(np.float32)

    def _best_seed(self, remaining: Mask, own: Mask, hidden: Mask, box: tuple[int, int, int, int]) -> ShapeFit | None:
        """The pose where the outline covers most remaining and least bare pixels, with none around it."""
        left, top, width, height = box
        middle = np.array([[left + width / 2, top + height / 2]])
        x_m, y_m = self._view.on_plane(middle, self._bottom_m + self._size_m[2] / 2)[0]
        inside, ring = _evidence(remaining, own, hidden, box, self._margin(x_m, y_m))
        best: tuple[float, ShapeFit] | None = None
        for yaw in self._yaws_rad:
            kernel, rim = _templates(self.silhouette(ShapeFit(x_m, y_m, yaw)), middle[0])
            if kernel.shape[0] > inside.shape[0] * 2 or kernel.shape[1] > inside.shape[1] * 2:
                continue
            score = _correlate(inside, kernel) + _correlate(ring, rim)
            _, highest, _, (column, row) = cv2.minMaxLoc(score)
            if best is None or highest > best[0]:
                shift = np.array([[column, row]]) * SEED_SCALE + np.array(box[:2]) - self._margin(x_m, y_m)
                place = self._view.on_plane(shift, self._bottom_m + self._size_m[2] / 2)[0]
                best = (highest, ShapeFit(float(place[0]), float(place[1]), float(yaw)))
        return best[1] if best is not None and best[0] > LEAST_SEED_SCORE else None

    def _margin(self, x_m: float, y_m: float) -> int:
        """Pixels around a component where parts may reach that are partly hidden."""
        half = self._view.pixels_per_m((x_m, y_m, self._bottom_m)) * self._size_m[0] / 2
        return int(np.ceil(half / SEED_SCALE)) * SEED_SCALE

    def refine(self, seeds: list[ShapeFit], own: Mask, hidden: Mask) -> list[ShapeFit]:
        """Least squares of all parts on the outline points of the mask, each point given to the nearest part."""
        points, certain = _outline_points(own, hidden)
        fits = list(seeds)
        for _ in range(ROUNDS):
            distances = np.array([self.silhouette(fit).distances(points) + EDGE_PX for fit in fits])
            nearest = np.abs(distances).argmin(axis=0)
            for index, fit in enumerate(fits):
                mine = (nearest == index) & (np.abs(distances[index]) < REACH_PX)
                if int(mine.sum()) >= 8:
                    fits[index] = self._step(fit, points[mine], certain[mine])
        distances = np.abs([self.silhouette(fit).distances(points) + EDGE_PX for fit in fits])
        nearest = distances.argmin(axis=0)
        return [
            replace(
                self._judge(fit, own, hidden), agreement=_share_below(distances[index, certain & (nearest == index)])
            )
            for index, fit in enumerate(fits)
        ]

    def _step(self, fit: ShapeFit, points: Array, certain: NDArray[np.bool_]) -> ShapeFit:
        """Two damped Gauss-Newton steps on (x, y, yaw) with Huber weights."""
        steps = np.array([5e-4, 5e-4, 5e-3])
        values = np.array([fit.x_m, fit.y_m, fit.yaw_rad])
        for _ in range(2):
            residuals = self._residuals(values, points)
            jacobian = np.empty((len(points), 3))
            for column in range(3):
                moved = values.copy()
                moved[column] += steps[column]
                jacobian[:, column] = (self._residuals(moved, points) - residuals) / steps[column]
            weights = HUBER_PX / np.maximum(np.abs(residuals), HUBER_PX)
            # inside a part an edge next to another part may be that part's edge
            weights[~certain & (residuals < 0)] = 0.0
            normal = jacobian.T @ (weights[:, None] * jacobian)
            normal[np.diag_indices(3)] *= 1.0 + 1e-3
            normal[np.diag_indices(3)] += 1e-6
            change = np.linalg.solve(normal, -jacobian.T @ (weights * residuals))
            values += np.clip(change, [-0.01, -0.01, -0.3], [0.01, 0.01, 0.3])
        return replace(fit, x_m=float(values[0]), y_m=float(values[1]), yaw_rad=float(values[2]))

    def _residuals(self, values: Array, points: Array) -> Array:
        x_m, y_m, yaw_rad = (float(value) for value in values)
        return self.silhouette(ShapeFit(x_m, y_m, yaw_rad)).distances(points) + EDGE_PX

    def _judge(self, fit: ShapeFit, own: Mask, hidden: Mask) -> ShapeFit:
        """How much of the part is seen, and how much of what is seen has its colour; its blurred rim does not count."""
        body = np.asarray(cv2.erode(self.silhouette(fit).fill(own.shape), np.ones((3, 3), np.uint8)), np.uint8)
        total = max(int(body.sum()), 1)
        covered = int((body & own).sum())
        obscured = int((body & hidden & (1 - own)).sum())
        return replace(fit, support=covered / max(total - obscured, 1), visible=1.0 - obscured / total)


def _evidence(
    remaining: Mask, own: Mask, hidden: Mask, box: tuple[int, int, int, int], margin: int
) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """What each pixel around a component says for (+) or against (-) a part over it, and beside it."""
    left, top, width, height = box
    crops: list[NDArray[np.float32]] = []
    for mask in (remaining, own, hidden):
        padded = cv2.copyMakeBorder(mask, margin, margin, margin, margin, cv2.BORDER_CONSTANT, value=0)
        crop = padded[top : top + height + 2 * margin, left : left + width + 2 * margin]
        crops.append(crop[::SEED_SCALE, ::SEED_SCALE].astype(np.float32))
    wanted, coloured, obscured = crops
    taken = coloured - wanted
    floor = 1.0 - np.maximum(coloured, obscured)
    return np.asarray(wanted - FLOOR_COST * floor - TAKEN_COST * taken, np.float32), np.negative(wanted)


def _correlate(image: NDArray[np.float32], kernel: NDArray[np.float32]) -> NDArray[np.float32]:
    return np.asarray(cv2.filter2D(image, cv2.CV_32F, kernel, borderType=cv2.BORDER_CONSTANT), np.float32)


def _templates(silhouette: Silhouette, middle: Array) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """Kernels of a part around its middle and of the ring beside it, each of weight one."""
    local = silhouette.moved(-middle / SEED_SCALE, 1 / SEED_SCALE)
    half = int(np.ceil(np.abs(local.points).max())) + RING_PX + 1
    body = local.moved(np.array([half, half])).fill((2 * half + 1, 2 * half + 1))
    ring = cv2.dilate(body, np.ones((2 * RING_PX + 1, 2 * RING_PX + 1), np.uint8)) - body
    return np.asarray(body / max(body.sum(), 1), np.float32), np.asarray(ring * (0.5 / max(ring.sum(), 1)), np.float32)


def _share_below(distances: Array) -> float:
    """Share of outline pixels that agree with a part; 1 where none says anything."""
    return float((distances < AGREE_PX).mean()) if len(distances) else 1.0


def _outline_points(own: Mask, hidden: Mask) -> tuple[Array, NDArray[np.bool_]]:
    """Outline pixels (n, 2) of a component and whether each borders on bare floor, not on something in front."""
    contours, _ = cv2.findContours(own, cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)
    points = np.concatenate([contour.reshape(-1, 2) for contour in contours])
    height, width = own.shape
    inner = (points[:, 0] > 0) & (points[:, 1] > 0) & (points[:, 0] < width - 1) & (points[:, 1] < height - 1)
    near = cv2.dilate(hidden & (1 - own), np.ones((5, 5), np.uint8))
    certain = inner & (near[points[:, 1], points[:, 0]] == 0)
    return points.astype(np.float64), certain
