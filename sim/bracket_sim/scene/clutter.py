"""Random scenes: parts close together in the tray, so that some block the grasp of others; upright, lying, stacked."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from bracket_ground.errors import SettingError
from bracket_ground.interfaces.bench import Tray
from bracket_ground.interfaces.pose import Array, Pose
from bracket_ground.interfaces.product import Product
from bracket_sim.scene.heaping import heaped
from bracket_sim.scene.parts import ScenePart
from bracket_sim.scene.posture import LYING, UPRIGHT, stance, whole
from bracket_sim.scene.settings import ClutterSettings
from bracket_sim.scene.unknown_objects import UNKNOWN, UnknownObject, draw_unknown_object

TRIES = 500
TRAYS = 20  # that are begun where parts are set down on others
RIM_M = 0.008  # from the wall of the tray, of what was set down on others
TOPS = 8  # spots on top of others that are compared
OUTWARDS = 0.4  # metres of height that a metre farther from the tray's middle is worth
BRIDGING = 0.6  # share of spots across two bodies
OFF_CENTRE = 0.15  # of the room of the part below, at most, by which a part is put off that part's middle


@dataclass(frozen=True)
class _Item:
    """What is to be put into the tray.

    Attributes:
        spot_from_part: where its frame is, seen from the middle of its room, on the floor.
        room_m: (length, width, height) that it takes.
    """

    part: str
    spot_from_part: Pose
    room_m: tuple[float, float, float]
    foreign: UnknownObject | None = None


@dataclass(frozen=True, eq=False)
class _Spot:
    """Where the middle of an item's room is, how it is turned, and how high its bottom is above the floor."""

    item: _Item
    centre_m: Array
    yaw_rad: float
    height_m: float = 0.0

    @property
    def corners_m(self) -> Array:
        """Of its room seen from above, (4, 2)."""
        return rectangle(self.item.room_m, self.centre_m, self.yaw_rad)

    @property
    def top_m(self) -> float:
        """Of its room, above the floor."""
        return self.height_m + self.item.room_m[2]


def full_set(product: Product) -> tuple[str, ...]:
    """The types of all single parts that goals take, one entry for each part; people build sub-assemblies."""
    single = {name: part for name, part in product.parts.items() if product.most[name] and not part.made_of}
    return tuple(name for name, part in single.items() for _ in range(part.quantity))


def sample_clutter(
    product: Product,
    tray: Tray,
    types: Sequence[str],
    rng: np.random.Generator,
    settings: ClutterSettings | None = None,
) -> tuple[ScenePart, ...]:
    """Put parts into the tray at random poses, many of them right beside another one, then those on top of others.

    Parts that lie begin a little above the floor, and come to rest there. Those that are set down on others lie, and
    where there are any, all are at rest.

    Args:
        types: type of every part, in any order.
        rng: the same generator state gives the same scene.

    Raises:
        InputError: the tray is too small for that many parts.
    """
    settings = settings or ClutterSettings()
    items = [_posed(product, types[i], rng, settings.lying_share) for i in rng.permutation(len(types))]
    stacked = [number > 0 and _happens(settings.stacked_share, rng) for number in range(len(items))]
    low = [item for item, high in zip(items, stacked, strict=True) if not high]
    tops = [item.part for item, high in zip(items, stacked, strict=True) if high]
    for _ in range(TRAYS):
        spots: list[_Spot] = []
        for item in low:
            spots.append(_free_spot(tray, item, spots, rng, settings))
        for _ in range(settings.foreign_objects):
            spots.append(_free_spot(tray, _unknown(rng), spots, rng, settings))
        floor = tuple(_scene_part(tray, spot) for spot in spots)
        if not tops:
            return floor
        if (scene := heaped(product, tray, floor, tops, rng, RIM_M)) is not None:
            return scene
    raise _full(tray, len(types))


def add_to_clutter(
    product: Product,
    tray: Tray,
    there: Sequence[tuple[str, Pose]],
    types: Sequence[str],
    rng: np.random.Generator,
    settings: ClutterSettings,
) -> tuple[ScenePart, ...]:
    """Stand further parts between those that are in the tray; closer together than wished where it is full.

    Args:
        there: type and world_from_part of every part in the tray.
        types: of the parts that come.
    """
    spots = [_spot_of(product, part, pose) for part, pose in there]
    found = []
    for name in types:
        item = _posed(product, name, rng, 0.0)
        spot = None
        for closer in (settings, settings.model_copy(update={"neighbour_share": 0.0, "nearest_gap_m": 0.002})):
            try:
                spot = _free_spot(tray, item, spots, rng, closer)
                break
            except SettingError:
                continue
        if spot is None:  # a full tray: onto what is there
            spot = _spot_on_top(tray, item, spots, rng)
        spots.append(spot)
        found.append(_scene_part(tray, spot))
    return tuple(found)


def _spot_of(product: Product, part: str, pose: Pose) -> _Spot:
    """Where a part stands or lies, as a room that it takes."""
    kind = product.parts[part]
    length, width, height = kind.size_m
    upright = float(pose.rotation[2, 2]) > math.cos(math.radians(20))
    room = (length, width, height + kind.peg_length_m) if upright else (max(kind.size_m),) * 3
    item = _Item(part, Pose((0.0, 0.0, 0.0)), room)
    return _Spot(item, np.array(pose.position_m[:2]), pose.yaw_rad if upright else 0.0)


def _happens(share: float, rng: np.random.Generator) -> bool:
    """Draws nothing where it never happens, so that scenes without it stay what they are."""
    return share > 0 and rng.random() < share


def _posed(
    product: Product, name: str, rng: np.random.Generator, lying_share: float, turns: Sequence[str] = LYING
) -> _Item:
    """A part on its peg, or on one of its other sides."""
    kind = product.parts[name]
    if not _happens(lying_share, rng):
        length, width, height = kind.size_m
        return _Item(name, Pose((0.0, 0.0, kind.peg_length_m)), (length, width, height + kind.peg_length_m))
    lies = stance(whole(kind), turns[int(rng.integers(len(turns)))])
    return _Item(name, lies.spot_from_body, lies.room_m)


def _unknown(rng: np.random.Generator) -> _Item:
    foreign = draw_unknown_object(rng)
    lies = stance(foreign.solids, (UPRIGHT, *LYING)[int(rng.integers(len(LYING) + 1))])
    return _Item(UNKNOWN, lies.spot_from_body, lies.room_m, foreign)


def _scene_part(tray: Tray, spot: _Spot) -> ScenePart:
    x, y = (float(value) for value in spot.centre_m)
    place = Pose.from_yaw((x, y, tray.centre_m[2] + spot.height_m), spot.yaw_rad)
    return ScenePart(spot.item.part, place @ spot.item.spot_from_part, foreign=spot.item.foreign)


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
    tray: Tray, item: _Item, placed: Sequence[_Spot], rng: np.random.Generator, settings: ClutterSettings
) -> _Spot:
    obstacles = [spot.corners_m for spot in placed]
    room = np.array(tray.size_m) / 2 - settings.rim_margin_m
    middle = np.array(tray.centre_m[:2])
    beside = bool(placed) and rng.random() < settings.neighbour_share
    for _ in range(TRIES if room.min() > 0 else 0):
        yaw = rng.uniform(-math.pi, math.pi)
        wanted = 0.0
        if beside:
            wanted = rng.uniform(settings.nearest_gap_m, settings.farthest_gap_m)
            neighbour = int(rng.integers(len(placed)))
            centre = _beside(obstacles[neighbour], placed[neighbour].centre_m, item.room_m, yaw, wanted, rng)
        else:
            centre = middle + rng.uniform(-room, room)
        body = rectangle(item.room_m, centre, yaw)
        inside = bool(np.all(np.abs(body - middle) <= room))
        if inside and all(gap(body, other) >= settings.nearest_gap_m - 1e-9 for other in obstacles):
            return _Spot(item, centre, yaw)
    raise _full(tray, len(placed) + 1)


def _full(tray: Tray, count: int) -> SettingError:
    what = f"no free spot for {count} parts in a tray of {tray.size_m[0]} x {tray.size_m[1]} m"
    return SettingError((("bench", "tray", "size_m"), what))


def _spot_on_top(tray: Tray, item: _Item, placed: Sequence[_Spot], rng: np.random.Generator) -> _Spot:
    """The one of several spots over others from which an item falls least, and hardly over the rim."""
    spots = [_spot_over(item, placed, rng) for _ in range(TOPS)]
    middle = np.array(tray.centre_m[:2])
    return min(spots, key=lambda spot: spot.height_m + OUTWARDS * float(np.linalg.norm(spot.centre_m - middle)))


def _spot_over(item: _Item, placed: Sequence[_Spot], rng: np.random.Generator) -> _Spot:
    """Over a body or across the gap between it and the nearest one, above whatever reaches under it."""
    below = placed[int(rng.integers(len(placed)))]
    others = sorted(placed, key=lambda spot: float(np.linalg.norm(spot.centre_m - below.centre_m)))[1:2]
    if others and rng.random() < BRIDGING:
        way = others[0].centre_m - below.centre_m
        centre, yaw = below.centre_m + way / 2, math.atan2(way[1], way[0])
        if item.room_m[1] > item.room_m[0]:
            yaw += math.pi / 2
    else:
        offset = rng.uniform(-OFF_CENTRE, OFF_CENTRE, 2) * below.item.room_m[:2]
        c, s = math.cos(below.yaw_rad), math.sin(below.yaw_rad)
        centre, yaw = below.centre_m + np.array([[c, -s], [s, c]]) @ offset, rng.uniform(-math.pi, math.pi)
    body = rectangle(item.room_m, centre, yaw)
    height = max((spot.top_m for spot in placed if spot is below or gap(body, spot.corners_m) < 0), default=0.0)
    return _Spot(item, centre, yaw, height)


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
