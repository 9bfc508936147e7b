"""What is known of the bracket's plate, and where an image shows it: points of its edges, and its empty holes."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from bracket_ground.interfaces.bench import Bench
from bracket_ground.interfaces.camera_model import CameraModel
from bracket_ground.interfaces.pose import Array, Pose
from bracket_ground.interfaces.product import Product

SPACING_M = 0.008  # of points along an edge
CORNER_M = 0.006  # no points this near to a corner
LEAST_REACH_PX = 4.0
STEP_PX = 0.5  # along the profile across an edge
SMOOTH = 2.0  # standard deviation of a profile's smoothing, in steps
LEAST_SLOPE = 2.0  # grey levels a step
SIDE_SEEN = 0.05  # slope of the view from which an edge may be that of the plate's lower side
HOLE_AREA = (0.35, 1.6)  # of the expected one
HOLE_STRETCH = 1.7
DARK = (0.45, 0.8)  # shares of the plate's level: surely of a hole, whose walls are lit, and surely not


@dataclass(frozen=True, eq=False)
class Rectangle:
    """Something with four straight edges in the world.

    Attributes:
        edges_m: (n, 3) points on its upper edges.
        outwards: (n, 3) unit vectors out of it.
        sides: (n,) which edge each is on: 0 and 1 lie across its x axis, at the lesser x first; 2 and 3 across y.
    """

    edges_m: Array
    outwards: Array
    sides: NDArray[np.int64]

    @staticmethod
    def between(low: Array, high: Array, pose: Pose) -> Rectangle:
        """With corners (2,) in the plane z = 0 of a pose."""
        points: list[Array] = []
        normals: list[Array] = []
        sides: list[NDArray[np.int64]] = []
        for axis in (0, 1):
            other = 1 - axis
            count = max(2, int((high[other] - low[other]) / SPACING_M))
            along = np.linspace(low[other] + CORNER_M, high[other] - CORNER_M, count)
            for at, sign in ((low[axis], -1.0), (high[axis], 1.0)):
                edge, normal = np.zeros((count, 3)), np.zeros((count, 3))
                edge[:, axis], edge[:, other], normal[:, axis] = at, along, sign
                points.append(edge)
                normals.append(normal)
                sides.append(np.full(count, len(sides)))
        outwards = np.concatenate(normals) @ pose.rotation.T
        return Rectangle(pose.transform(np.concatenate(points)), outwards, np.concatenate(sides))


@dataclass(frozen=True, eq=False)
class PlateModel(Rectangle):
    """The plate in the world.

    Attributes:
        holes_m: (m, 3) middles of the holes on the plate's upper side.
        radius_m: of a hole.
    """

    holes_m: Array
    radius_m: float

    @staticmethod
    def of(bench: Bench, product: Product) -> PlateModel:
        """The plate of a product on a bench."""
        plate, pose = product.bracket, bench.bracket.pose
        holes = np.array(list(plate.holes_m.values()))
        low, high = holes.min(axis=0) - plate.margin_m, holes.max(axis=0) + plate.margin_m
        edges = Rectangle.between(low, high, pose)
        middles = np.column_stack([holes, np.zeros(len(holes))])
        return PlateModel(**vars(edges), holes_m=pose.transform(middles), radius_m=product.hole_radius_m)


@dataclass(frozen=True, eq=False)
class Sighting:
    """Landmarks that were found in one image.

    Attributes:
        points_m: (k, 3) in the world.
        pixels: (k, 2) where they were seen.
        directions: (k, 2) unit vectors in the image along which that is known.
        edges, holes: how many points of edges there are, and how many holes.
        sides: (edges,) which edge each of its points is on.
    """

    points_m: Array
    pixels: Array
    directions: Array
    edges: int
    holes: int
    sides: NDArray[np.int64]


def sight(
    image: NDArray[np.uint8], camera: CameraModel, world_from_camera: Pose, plate: PlateModel, reach_m: float
) -> Sighting:
    """The landmarks within `reach_m` of where they are supposed to be, along the plate."""
    depth = float(world_from_camera.inverse().transform(plate.holes_m)[:, 2].mean())
    reach_px = max(LEAST_REACH_PX, reach_m * camera.focal_px / max(depth, 1e-3))
    grey = np.asarray(cv2.cvtColor(image, cv2.COLOR_RGB2GRAY), np.float32)
    edges, sides = _edges(grey, camera, world_from_camera, plate, reach_px)
    holes = _holes(grey, camera, world_from_camera, plate, reach_px)
    points, pixels, directions = (np.concatenate(each) for each in zip(edges, holes, strict=True))
    return Sighting(points, pixels, directions, len(edges[0]), len(holes[0]) // 2, sides)


_Found = tuple[Array, Array, Array]


def _edges(
    grey: NDArray[np.float32], camera: CameraModel, eye: Pose, plate: PlateModel, reach_px: float
) -> tuple[_Found, NDArray[np.int64]]:
    """Where the grey level changes most across each point of an edge, and of which edge each is.

    Points off their edge's line are left out.
    """
    found = profiles(grey, camera, eye, plate, reach_px)
    chosen, slopes, offsets = found.chosen, np.abs(found.slopes), found.offsets_px
    if not len(chosen):
        return (np.zeros((0, 3)), np.zeros((0, 2)), np.zeros((0, 2))), plate.sides[:0]
    best = slopes.argmax(axis=1)
    at = offsets[best] + STEP_PX * _between(slopes, best)
    clear = slopes[np.arange(len(best)), best] > LEAST_SLOPE
    clear &= (best > 0) & (best < len(offsets) - 1)
    for side in range(4):
        own = clear & (plate.sides[chosen] == side)
        clear[own] = _on_a_line(np.flatnonzero(own).astype(float), at[own])
    kept = chosen[clear]
    unit = found.outwards_px[clear]
    return (plate.edges_m[kept], found.start_px[clear] + at[clear, np.newaxis] * unit, unit), plate.sides[kept]


@dataclass(frozen=True, eq=False)
class Profiles:
    """How much the grey level changes across points of edges that are in view.

    Attributes:
        chosen: (k,) which of the rectangle's points.
        start_px, outwards_px: (k, 2) where they are supposed to be seen, and the unit vector out of the rectangle.
        offsets_px: (o,) places along it.
        slopes: (k, o) how much brighter it gets there, grey levels a step.
    """

    chosen: NDArray[np.int64]
    start_px: Array
    outwards_px: Array
    offsets_px: Array
    slopes: NDArray[np.float32]


def profiles(
    grey: NDArray[np.float32], camera: CameraModel, eye: Pose, rectangle: Rectangle, reach_px: float
) -> Profiles:
    """Across the edges of a rectangle, up to `reach_px` to both sides; edges whose lower side may be seen are left out.

    Args:
        eye: world_from_camera.
    """
    height, width = grey.shape
    start = camera.project(eye, rectangle.edges_m)
    step = camera.project(eye, rectangle.edges_m + 0.002 * rectangle.outwards) - start
    unit = step / np.maximum(np.linalg.norm(step, axis=1, keepdims=True), 1e-9)
    way = np.array(eye.position_m) - rectangle.edges_m
    hidden = (way * rectangle.outwards).sum(axis=1) < SIDE_SEEN * np.linalg.norm(way, axis=1)
    margin = reach_px + 2
    inside = (start > margin).all(axis=1) & (start[:, 0] < width - 1 - margin) & (start[:, 1] < height - 1 - margin)
    chosen = np.flatnonzero(hidden & inside)
    offsets: Array = np.arange(-reach_px, reach_px + STEP_PX, STEP_PX, dtype=float)
    places = start[chosen, np.newaxis] + offsets[np.newaxis, :, np.newaxis] * unit[chosen, np.newaxis]
    columns, rows = (places[..., axis].astype(np.float32) for axis in (0, 1))
    if not len(chosen):
        return Profiles(chosen, start[:0], unit[:0], offsets, np.zeros((0, len(offsets)), np.float32))
    profile = cv2.remap(grey, columns, rows, cv2.INTER_LINEAR)
    slopes = np.gradient(cv2.GaussianBlur(profile, (0, 0), sigmaX=SMOOTH, sigmaY=0.01), axis=1)
    return Profiles(chosen, start[chosen], unit[chosen], offsets, slopes)


def _between(slopes: NDArray[np.float32], best: NDArray[np.int64]) -> Array:
    """Sub-step place of maxima, by a parabola through their neighbours."""
    rows, last = np.arange(len(best)), slopes.shape[1] - 1
    before, top, after = (slopes[rows, np.clip(best + shift, 0, last)] for shift in (-1, 0, 1))
    bend = before - 2 * top + after
    shift: Array = np.where(np.abs(bend) > 1e-9, 0.5 * (before - after) / np.where(bend == 0, 1, bend), 0.0)
    return np.clip(shift, -0.5, 0.5)


def _on_a_line(along: Array, offset: Array) -> NDArray[np.bool_]:
    """Which offsets lie near one line through most of them."""
    if len(offset) < 4:
        return np.zeros(len(offset), bool)
    kept = np.abs(offset - np.median(offset)) < max(3.0, 2.5 * float(np.median(np.abs(offset - np.median(offset)))))
    for _ in range(3):
        if kept.sum() < 4:
            return np.zeros(len(offset), bool)
        line = np.polyval(np.polyfit(along[kept], offset[kept], 1), along)
        off = np.abs(offset - line)
        kept = off < max(0.7, 2.5 * float(np.median(off[kept])))
    return kept


def _holes(grey: NDArray[np.float32], camera: CameraModel, eye: Pose, plate: PlateModel, reach_px: float) -> _Found:
    """Middles of holes that are seen as dark and round; each counts along both axes of the image."""
    centres = camera.project(eye, plate.holes_m)
    depths = eye.inverse().transform(plate.holes_m)[:, 2]
    points, pixels, directions = [], [], []
    for point, centre, depth in zip(plate.holes_m, centres, depths, strict=True):
        radius_px = plate.radius_m * camera.focal_px / float(depth)
        seen = _dark_disc(grey, centre, radius_px, reach_px)
        if seen is not None:
            points += [point, point]
            pixels += [seen, seen]
            directions += [np.array([1.0, 0.0]), np.array([0.0, 1.0])]
    if not points:
        return np.zeros((0, 3)), np.zeros((0, 2)), np.zeros((0, 2))
    return np.array(points), np.array(pixels), np.array(directions)


def _dark_disc(grey: NDArray[np.float32], centre: Array, radius_px: float, reach_px: float) -> Array | None:
    """Middle (2,) of the dark disc near a place, weighted by how dark it is; None where there is none."""
    half = int(np.ceil(2.0 * radius_px + reach_px))
    column, row = (int(value) for value in np.rint(centre))
    height, width = grey.shape
    if not (half <= column < width - half and half <= row < height - half):
        return None
    window = grey[row - half : row + half + 1, column - half : column + half + 1]
    plate_level = max(1.0, float(np.percentile(window, 75)))
    depth = np.clip((DARK[1] - window / plate_level) / (DARK[1] - DARK[0]), 0, 1)
    dark = (depth > 0.5).astype(np.uint8)
    count, labels, stats, middles = cv2.connectedComponentsWithStats(dark)
    best: tuple[float, int] | None = None
    area = np.pi * radius_px**2
    for index in range(1, count):
        wide, high, own = stats[index][2:]
        away = float(np.hypot(*(middles[index] - half)))
        round_one = max(wide, high) < HOLE_STRETCH * min(wide, high) and own > 0.55 * wide * high
        if (
            HOLE_AREA[0] * area < own < HOLE_AREA[1] * area
            and round_one
            and away < reach_px
            and (not best or away < best[0])
        ):
            best = away, index
    if best is None:
        return None
    near = cv2.dilate((labels == best[1]).astype(np.uint8), np.ones((3, 3), np.uint8))
    weight = near * depth
    rows, columns = np.mgrid[-half : half + 1, -half : half + 1]
    total = float(weight.sum())
    return np.array([column + float((weight * columns).sum()) / total, row + float((weight * rows).sum()) / total])
