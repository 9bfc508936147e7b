"""Random scenes: parts that stand close together in the tray, so that some block the grasp of others."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from cell.interfaces.bench import Tray
from cell.interfaces.errors import SettingError
from cell.interfaces.pose import Array, Pose
from cell.interfaces.product import Product
from sim.settings import ClutterSettings

TRIES = 500

Owner = Literal["robot", "person"]


@dataclass(frozen=True)
class ScenePart:
    """One part and where it starts.

    Attributes:
        part: its type.
        world_from_part: the part frame (body's bottom centre).
        owner: whose set it belongs to.
    """

    part: str
    world_from_part: Pose
    owner: Owner = "robot"


def full_set(product: Product) -> tuple[str, ...]:
    """The types of all parts that one product needs, one entry for each part."""
    return tuple(name for name, part in product.parts.items() for _ in range(part.quantity))


def sample_clutter(
    product: Product,
    tray: Tray,
    types: Sequence[str],
    rng: np.random.Generator,
    settings: ClutterSettings | None = None,
) -> tuple[ScenePart, ...]:
    """Stand parts in the tray at random poses, many of them right beside another one.

    Args:
        types: type of every part, in any order.
        rng: the same generator state gives the same scene.

    Raises:
        InputError: the tray is too small for so many parts.
    """
    settings = settings or ClutterSettings()
    order = [types[i] for i in rng.permutation(len(types))]
    placed: list[tuple[str, Array, float]] = []
    for name in order:
        placed.append((name, *_free_spot(product, tray, name, placed, rng, settings)))
    return tuple(standing(product, tray, name, centre, yaw) for name, centre, yaw in placed)


def standing(product: Product, tray: Tray, name: str, centre_m: Sequence[float] | Array, yaw_rad: float) -> ScenePart:
    """A part of the robot's set that stands in the tray at (x, y), for scenes given by hand."""
    height = tray.centre_m[2] + product.parts[name].peg_length_m
    return ScenePart(name, Pose.from_yaw((float(centre_m[0]), float(centre_m[1]), height), yaw_rad))


def rectangle(size_m: Sequence[float], centre_m: Array, yaw_rad: float) -> Array:
    """Corners (4, 2) of a body seen from above, counter-clockwise."""
    half = np.array([[1, 1], [-1, 1], [-1, -1], [1, -1]]) * np.array(size_m[:2]) / 2
    c, s = math.cos(yaw_rad), math.sin(yaw_rad)
    corners: Array = half @ np.array([[c, s], [-s, c]]) + centre_m
    return corners


def gap(first: Array, second: Array) -> float:
    """Widest gap between two rectangles (4, 2) along any of their side directions; negative where they overlap."""
    sides = np.concatenate([first[:2] - first[1:3], second[:2] - second[1:3]])
    axes = sides / np.linalg.norm(sides, axis=1, keepdims=True)
    a, b = first @ axes.T, second @ axes.T
    return float(np.max(np.maximum(a.min(axis=0) - b.max(axis=0), b.min(axis=0) - a.max(axis=0))))


def _free_spot(
    product: Product,
    tray: Tray,
    name: str,
    placed: list[tuple[str, Array, float]],
    rng: np.random.Generator,
    settings: ClutterSettings,
) -> tuple[Array, float]:
    size = product.parts[name].size_m
    obstacles = [rectangle(product.parts[other].size_m, centre, yaw) for other, centre, yaw in placed]
    room = np.array(tray.size_m) / 2 - settings.rim_margin_m
    middle = np.array(tray.centre_m[:2])
    beside = bool(placed) and rng.random() < settings.neighbour_share
    for _ in range(TRIES if room.min() > 0 else 0):
        yaw = rng.uniform(-math.pi, math.pi)
        wanted = 0.0
        if beside:
            wanted = rng.uniform(settings.nearest_gap_m, settings.farthest_gap_m)
            neighbour = int(rng.integers(len(placed)))
            centre = _beside(obstacles[neighbour], placed[neighbour][1], size, yaw, wanted, rng)
        else:
            centre = middle + rng.uniform(-room, room)
        body = rectangle(size, centre, yaw)
        inside = bool(np.all(np.abs(body - middle) <= room))
        if inside and all(gap(body, other) >= settings.nearest_gap_m - 1e-9 for other in obstacles):
            return centre, yaw
    what = f"no free spot for {len(placed) + 1} parts in a tray of {tray.size_m[0]} x {tray.size_m[1]} m"
    raise SettingError((("bench", "tray", "size_m"), what))


def _beside(
    neighbour: Array, centre: Array, size_m: Sequence[float], yaw_rad: float, wanted_m: float, rng: np.random.Generator
) -> Array:
    """Slide a body away from its neighbour's centre in a random direction until the gap is as wanted."""
    angle = rng.uniform(-math.pi, math.pi)
    direction = np.array([math.cos(angle), math.sin(angle)])
    near, far = 0.0, 0.3
    for _ in range(24):
        half = (near + far) / 2
        if gap(rectangle(size_m, centre + half * direction, yaw_rad), neighbour) < wanted_m:
            near = half
        else:
            far = half
    spot: Array = centre + far * direction
    return spot
