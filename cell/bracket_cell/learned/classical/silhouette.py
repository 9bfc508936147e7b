"""How an upright part looks to a camera: the convex outlines of its solids, and what they cover together."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from bracket_cell.learned.classical.box_model import View, fill, outline
from bracket_ground.interfaces.pose import Array
from bracket_ground.interfaces.product import PartType
from bracket_ground.interfaces.solid import Solid

TOP_STEP_M = 5e-4


class Silhouette:
    """What a part covers in an image: the union of convex polygons.

    Attributes:
        polygons: (k, 2) each, in pixels.
    """

    def __init__(self, polygons: Sequence[Array]) -> None:
        self.polygons = tuple(polygons)

    @cached_property
    def points(self) -> Array:
        """Corners (n, 2) of all polygons."""
        points: Array = np.concatenate(self.polygons)
        return points

    @cached_property
    def _lines(self) -> tuple[Array, Array, NDArray[np.intp]]:
        """Outward normals (2, n) of the sides of all polygons, their offsets (n,), and where each polygon begins."""
        counts = np.array([len(polygon) for polygon in self.polygons])
        begins = np.cumsum(counts) - counts
        following = np.arange(1, len(self.points) + 1)
        following[begins + counts - 1] = begins
        edges = self.points[following] - self.points
        normals = np.column_stack([edges[:, 1], -edges[:, 0]]) / np.maximum(np.hypot(*edges.T), 1e-9)[:, None]
        middles = np.repeat(np.add.reduceat(self.points, begins) / counts[:, None], counts, axis=0)
        normals *= np.sign(np.einsum("ij,ij->i", normals, self.points - middles))[:, None]
        return normals.T, np.einsum("ij,ij->i", normals, self.points), begins

    def moved(self, offset: Array, scale: float = 1.0) -> Silhouette:
        """The silhouette after a shift and a change of scale: scale * points + offset."""
        return Silhouette([polygon * scale + offset for polygon in self.polygons])

    def fill(self, shape: tuple[int, int]) -> NDArray[np.uint8]:
        """Mask (height, width), 1 where it covers a pixel."""
        mask = fill(shape, self.polygons[0])
        for polygon in self.polygons[1:]:
            mask |= fill(shape, polygon)
        return mask

    def area_px(self) -> int:
        """How many pixels it covers, wherever it is in the image."""
        low = np.floor(self.points.min(axis=0)) - 1
        width, height = (np.ceil(self.points.max(axis=0)) - low + 2).astype(int)
        return int(self.moved(-low).fill((height, width)).sum())

    def distances(self, points: Array) -> Array:
        """Distance of points (n, 2) outside of it, negative inside; beyond corners slightly short."""
        normals, offsets, begins = self._lines
        each = np.maximum.reduceat(points @ normals - offsets, begins, axis=1)
        nearest: Array = each.min(axis=1)
        return nearest


class Solids:
    """The solids of an upright body, ready to be projected."""

    def __init__(self, solids: Sequence[Solid]) -> None:
        clouds = [solid.points() for solid in solids]
        self._points = np.concatenate(clouds)
        self._ends = np.cumsum([len(cloud) for cloud in clouds])[:-1]

    def silhouette(self, view: View, x_m: float, y_m: float, yaw_rad: float, bottom_m: float) -> Silhouette:
        """What a camera sees of the body, whose bottom's middle is at (x, y, bottom)."""
        cosine, sine = np.cos(yaw_rad), np.sin(yaw_rad)
        turn = np.array([[cosine, sine, 0.0], [-sine, cosine, 0.0], [0.0, 0.0, 1.0]])
        pixels = view.pixels(self._points @ turn + np.array([x_m, y_m, bottom_m]))
        return Silhouette([outline(cloud) for cloud in np.split(pixels, self._ends)])

    def top_area_m2(self) -> float:
        """What the body covers from straight above."""
        clouds = np.split(self._points[:, :2] / TOP_STEP_M, self._ends)
        return Silhouette([outline(cloud) for cloud in clouds]).area_px() * TOP_STEP_M**2


def top_areas_m2(parts: Sequence[PartType]) -> tuple[float, ...]:
    """What each type's body covers from straight above."""
    return tuple(Solids(part.solids).top_area_m2() for part in parts)
