"""Solids: the convex pieces that a part's shape is made of, and how far they reach."""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import cache
from typing import Literal

import numpy as np
from pydantic import Field, model_validator

from bracket_ground.files.model import Model
from bracket_ground.files.units import Length, Point
from bracket_ground.interfaces.meshes import Mesh, hull_of
from bracket_ground.interfaces.pose import Array

AXES = "xyz"
RING = 16  # points on each edge of a cylinder, and on each of a ball's circles
LEAST_CORNERS = 4  # of a hull
GRID = 9  # lines each way that tell how far a hull reaches between two fingers
FLAT, EDGE_M = 1e-9, 1e-7  # slope of a face along a line; numbers of meshes are rounded
ROUND_M = 1e-4  # a cylinder's two diameters may differ by this much

Span = tuple[float, float]
_CORNERS = np.array([[x, y, z] for x in (-0.5, 0.5) for y in (-0.5, 0.5) for z in (-0.5, 0.5)])


class Solid(Model):
    """A convex piece of a part, given by the box around it.

    Attributes:
        solid: what it is; a ball whose extents differ is an ellipsoid, a hull is what its corners span.
        size_m: its extents along x, y and z of the part.
        centre_m: its middle in the part's frame, whose origin is the middle of the body's bottom.
        axis: which way a cylinder lies.
        shade: how bright it is, as a share of the part's colour.
        corners_m: of a hull: its corners (x, y, z) in the part's frame; a part's `mesh` gives them.
    """

    solid: Literal["box", "cylinder", "ball", "hull"]
    size_m: tuple[Length, Length, Length]
    centre_m: Point
    axis: Literal["x", "y", "z"] = "z"
    shade: float = Field(default=1.0, ge=0, le=1)
    corners_m: tuple[Point, ...] = ()

    @staticmethod
    def hull(points_m: Array) -> Solid:
        """The hull of points (n, 3) in the part's frame."""
        low, high = points_m.min(axis=0), points_m.max(axis=0)
        size, centre = ((float(x), float(y), float(z)) for x, y, z in (high - low, (low + high) / 2))
        corners = tuple((float(x), float(y), float(z)) for x, y, z in points_m)
        return Solid(solid="hull", size_m=size, centre_m=centre, corners_m=corners)

    def raised(self, by_m: float) -> Solid:
        """The same, higher."""
        (x, y, z), corners = self.centre_m, tuple((a, b, c + by_m) for a, b, c in self.corners_m)
        return self.model_copy(update={"centre_m": (x, y, z + by_m), "corners_m": corners})

    @model_validator(mode="after")
    def _has_corners(self) -> Solid:
        if (self.solid == "hull") != (len(self.corners_m) >= LEAST_CORNERS):
            raise ValueError(f"a hull has {LEAST_CORNERS} or more corners, and no other solid has any")
        return self

    @model_validator(mode="after")
    def _is_round(self) -> Solid:
        if self.solid == "cylinder" and abs(self.diameter_m - self._across[1]) > ROUND_M:
            raise ValueError(
                f"a cylinder along {self.axis} is as wide one way as the other, but size_m says "
                f"{self._across[0]:g} and {self._across[1]:g}"
            )
        return self

    @property
    def axis_index(self) -> int:
        """0, 1 or 2 for x, y or z."""
        return AXES.index(self.axis)

    @property
    def _across(self) -> tuple[float, float]:
        first, second = (self.size_m[index] for index in range(3) if index != self.axis_index)
        return first, second

    @property
    def diameter_m(self) -> float:
        """Of a cylinder."""
        return self._across[0]

    @property
    def length_m(self) -> float:
        """Of a cylinder, along its axis."""
        return self.size_m[self.axis_index]

    @property
    def volume_m3(self) -> float:
        """Of the solid alone, whatever else is in the same place."""
        if self.solid == "hull":
            return self.faces.volume_m3
        share = {"box": 1.0, "cylinder": math.pi / 4, "ball": math.pi / 6}[self.solid]
        return share * math.prod(self.size_m)

    @property
    def faces(self) -> Mesh:
        """Of a hull, its surface."""
        return _hull(self.corners_m)

    @property
    def middle_m(self) -> tuple[float, float, float]:
        """Middle of its mass in the part's frame."""
        if self.solid != "hull":
            return self.centre_m
        x, y, z = (float(value) for value in self.faces.middle_m)
        return x, y, z

    def mark(self, side: int) -> tuple[object, ...]:
        """What tells it from other solids, to 0.01 mm; side -1: after half a turn of the part."""
        x, y, z = self.centre_m
        axis = self.axis if self.solid == "cylinder" else ""
        corners = sorted(
            (round(side * x, 5) + 0.0, round(side * y, 5) + 0.0, round(z, 5)) for x, y, z in self.corners_m
        )
        box = (round(value, 5) + 0.0 for value in (*self.size_m, side * x, side * y, z))
        return (self.solid, axis, *box, *corners)

    def points(self) -> Array:
        """Points (n, 3) on the surface whose convex hull is the solid: exactly for a box, nearly for round ones."""
        if self.solid == "hull":
            return np.array(self.corners_m)
        unit = {"box": _CORNERS, "ball": _BALL}.get(self.solid)
        if unit is None:
            unit = np.roll(_CYLINDER, self.axis_index + 1, axis=1)
        points: Array = unit * np.array(self.size_m) + np.array(self.centre_m)
        return points

    def span_m(self, axis: int, windows: dict[int, Span]) -> Span | None:
        """How far it reaches along one axis within a window of each of the others, or None where it is outside.

        Args:
            axis: 0, 1 or 2.
            windows: (from, to) by axis; an axis that is not named is not limited.
        """
        if self.solid == "hull":
            return _through(self.faces, axis, windows)
        offsets = {index: self._offset(index, window) for index, window in windows.items()}
        if any(abs(offset) >= 1.0 for offset in offsets.values()):
            return None
        round_in = {"box": (), "ball": (0, 1, 2)}.get(
            self.solid, tuple(index for index in range(3) if index != self.axis_index)
        )
        missed = sum(offset**2 for index, offset in offsets.items() if index in round_in)
        if missed >= 1.0:
            return None
        half = self.size_m[axis] / 2 * (math.sqrt(1.0 - missed) if axis in round_in else 1.0)
        return self.centre_m[axis] - half, self.centre_m[axis] + half

    def _offset(self, index: int, window: Span) -> float:
        """Way from the centre to the nearest place in a window, in half extents."""
        low, high = window
        centre = self.centre_m[index]
        return (min(max(centre, low), high) - centre) / (self.size_m[index] / 2)


def span_m(solids: Sequence[Solid], axis: int, windows: dict[int, Span] | None = None) -> Span | None:
    """How far solids together reach along an axis within windows of the others; None where none is in them."""
    found = [span for solid in solids if (span := solid.span_m(axis, windows or {})) is not None]
    return (min(low for low, _ in found), max(high for _, high in found)) if found else None


@cache
def _hull(corners_m: tuple[Point, ...]) -> Mesh:
    return hull_of(np.array(corners_m))


def _through(hull: Mesh, axis: int, windows: dict[int, Span]) -> Span | None:
    """How far a hull reaches by its corners in the windows, and by lines along the axis on a grid in them."""
    low, high = hull.points_m.min(axis=0), hull.points_m.max(axis=0)
    others = [index for index in range(3) if index != axis]
    marks, corners = [], hull.points_m
    for index in others:
        begin, end = windows.get(index, (-math.inf, math.inf))
        if begin >= high[index] or end <= low[index]:
            return None
        marks.append(np.linspace(max(begin, float(low[index])), min(end, float(high[index])), GRID))
        corners = corners[(corners[:, index] >= begin) & (corners[:, index] <= end)]
    starts = np.zeros((GRID * GRID, 3))
    starts[:, others] = np.stack(np.meshgrid(*marks), axis=-1).reshape(-1, 2)
    outside = np.einsum("ij,kj->ki", hull.normals, starts) - np.einsum("ij,ij->i", hull.normals, hull.corners_m[:, 0])
    slopes = hull.normals[:, axis]
    with np.errstate(divide="ignore", invalid="ignore"):
        ways = -outside / slopes
    firsts = np.where(slopes < -FLAT, ways, -math.inf).max(axis=1)
    lasts = np.where(slopes > FLAT, ways, math.inf).min(axis=1)
    beside = np.where(np.abs(slopes) <= FLAT, outside, -1.0).max(axis=1) > EDGE_M
    inside = ~beside & (lasts >= firsts - EDGE_M)
    reached = np.concatenate([firsts[inside], lasts[inside], corners[:, axis]])
    return (float(reached.min()), float(reached.max())) if len(reached) else None


def _circle() -> Array:
    """(RING, 2), on the circle around a unit square's middle that touches its sides."""
    angles = np.arange(RING) * 2 * math.pi / RING
    return np.column_stack([np.cos(angles), np.sin(angles)]) / 2


_CYLINDER = np.concatenate([np.column_stack([_circle(), np.full(RING, end)]) for end in (-0.5, 0.5)])
_BALL = np.concatenate(
    [
        np.column_stack([math.cos(turn) * _circle(), np.full(RING, math.sin(turn) / 2)])
        for turn in np.arange(-4, 5) * math.pi / 8
    ]
)
