"""How an upright part looks to a camera: the convex outlines of its solids, and what they cover together."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from cell.interfaces.pose import Array
from cell.interfaces.product import PartType
from cell.interfaces.solid import Solid
from learned.classical.box_model import View, fill, outline, signed_distances

TOP_STEP_M = 5e-4


class Silhouette:
    """What a part covers in an image: the union of convex polygons.

    Attributes:
        polygons: (k, 2) each, in pixels.
    """

    def __init__(self, polygons: Sequence[Array]) -> None:
        self.polygons = tuple(polygons)

    @property
    def points(self) -> Array:
        """Corners (n, 2) of all polygons."""
        points: Array = np.concatenate(self.polygons)
        return points

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
        """Distance of points (n, 2) outside of it, negative inside."""
        nearest: Array = np.min([signed_distances(points, polygon) for polygon in self.polygons], axis=0)
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
