"""Where the person's parts stand when a run begins: in bins, permuted and mixed, or left on the table."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import combinations
from typing import NamedTuple

import numpy as np

from bracket_ground.errors import SettingError
from bracket_ground.files.model import Location
from bracket_ground.interfaces.bench import Bench
from bracket_ground.interfaces.places import EMPTY
from bracket_ground.interfaces.pose import Array, Pose
from bracket_ground.interfaces.product import Product
from bracket_sim.scene.parts import ScenePart
from bracket_sim.scene.person import Storage, bernoulli

BIN_GAP_M = 0.032  # between bodies in a bin: room for a thumb beside a finger
COMMON_BIN_M = (0.135, 0.186)  # of bins that take any type
EDGE_M = 0.010  # of such a bin that stays free, so that parts of neighbouring bins stay apart
MOST_YAW_RAD = 0.35  # of a part in such a bin
TABLE_FROM_BRACKET_M = 0.165  # where parts on the table lie, towards the person; free of bins and bracket
TABLE_PITCH_M = 0.115
LOW_M = 0.15  # an obstacle that begins higher stands over what is below it


@dataclass(frozen=True)
class Bin:
    """A bin: the middle of its floor's upper side, and its inner (x, y) extent."""

    centre_m: tuple[float, float, float]
    size_m: tuple[float, float]


@dataclass(frozen=True)
class Layout:
    """The person's bins and parts."""

    bins: tuple[Bin, ...]
    parts: tuple[ScenePart, ...]


def own_bins(product: Product, bench: Bench) -> tuple[Bin, ...]:
    """A bin for each type that has a place on the bench."""
    sizes = {
        name: (part.size_m[0] + 0.04, (part.size_m[1] + BIN_GAP_M) * part.quantity)
        for name, part in product.parts.items()
    }
    return tuple(Bin(centre, sizes[name]) for name, centre in bench.bins_m.items() if name in sizes)


def person_set(product: Product, bench: Bench) -> tuple[ScenePart, ...]:
    """One product's parts in the person's own bins; raises SettingError for a type without a bin."""
    if missing := [name for name in product.assembled if name not in bench.bins_m]:
        raise SettingError(
            (("bench", "bins_m"), f"no place for {', '.join(missing)}; there is one for {', '.join(bench.bins_m)}")
        )
    return tuple(
        ScenePart(name, Pose(spot), "person") for name in product.assembled for spot in _row(product, bench, name)
    )


def lay_out(
    product: Product, bench: Bench, storage: Storage, rng: np.random.Generator, *, handing: bool = False
) -> Layout:
    """Draw where bins and parts are.

    Args:
        handing: there is a robot that hands parts over; those stand in its tray.
        rng: untouched where each type has its own bin and no part lies elsewhere.
    """
    layout = Layout(own_bins(product, bench), person_set(product, bench))
    if storage.bins == "permuted":
        layout = _permuted(product, bench, storage, rng)
    if storage.elsewhere > 0:
        layout = replace(layout, parts=_some_on_table(product, bench, layout.parts, storage.elsewhere, rng))
    if handing and storage.handed_over > 0:
        layout = replace(layout, parts=_some_in_tray(product, bench, layout.parts, storage.handed_over, rng))
    return layout


def begun(
    product: Product,
    bench: Bench,
    parts: Sequence[ScenePart],
    wanted: Mapping[str, str],
    storage: Storage,
    rng: np.random.Generator,
) -> tuple[ScenePart, ...]:
    """The person's parts, some of them in holes that somebody else has filled.

    Args:
        wanted: type of the part by position; a sub-assembly and what another step comes before are nobody's beginning.
    """
    first = [at for at in wanted if not product.predecessors.get(at) and wanted[at] not in product.wholes]
    found = list(parts)
    for index in rng.permutation(len(first))[: storage.begun] if storage.begun else ():
        place = bench.bracket.pose @ Pose(product.slot_m(first[index]))
        number = next(number for number, part in enumerate(found) if part.part == wanted[first[index]])
        found.append(replace(found.pop(number), world_from_part=place))
    return tuple(found)


def _permuted(product: Product, bench: Bench, storage: Storage, rng: np.random.Generator) -> Layout:
    spots = [bench.bins_m[name] for name in product.assembled]
    contents = [[name] * product.parts[name].quantity for name in product.assembled]
    contents = [contents[index] for index in rng.permutation(len(contents))]
    if bernoulli(storage.mixed, rng) and len(contents) > 1:
        one, other = (int(index) for index in rng.permutation(len(contents))[:2])
        contents[one][-1], contents[other][-1] = contents[other][-1], contents[one][-1]
    bins = tuple(Bin(spot, COMMON_BIN_M) for spot in spots)
    filled = zip(bins, contents, strict=True)
    return Layout(bins, tuple(part for holder, names in filled for part in _fill(holder, names, product, rng)))


def _fill(holder: Bin, names: Sequence[str], product: Product, rng: np.random.Generator) -> list[ScenePart]:
    """Stand parts in a bin from one side to the other, with random gaps and turned a little where there is room."""
    order = [names[index] for index in rng.permutation(len(names))]
    yaws = rng.uniform(-MOST_YAW_RAD, MOST_YAW_RAD, len(order))
    extents = [_extent(product, name, yaw) for name, yaw in zip(order, yaws, strict=True)]
    wide_m = holder.size_m[1] - 2 * EDGE_M - BIN_GAP_M * (len(order) - 1)
    room_m = wide_m - sum(extent[1] for extent in extents)
    if room_m < 0:
        yaws = np.zeros(len(order))
        extents = [_extent(product, name, 0.0) for name in order]
        room_m = max(0.0, wide_m - sum(extent[1] for extent in extents))
    gaps_m = room_m * rng.dirichlet(np.ones(len(order) + 1))
    x, y, z = holder.centre_m
    y -= holder.size_m[1] / 2 - EDGE_M
    found = []
    for name, yaw, extent, gap_m in zip(order, yaws, extents, gaps_m, strict=False):
        y += gap_m + extent[1] / 2
        slack_m = max(0.0, holder.size_m[0] - extent[0]) / 2
        spot = (x + float(rng.uniform(-slack_m, slack_m)), float(y), z + product.parts[name].peg_length_m)
        found.append(ScenePart(name, Pose.from_yaw(spot, float(yaw)), "person"))
        y += extent[1] / 2 + BIN_GAP_M
    return found


def _extent(product: Product, name: str, yaw_rad: float) -> tuple[float, float]:
    """(x, y) size of a body that is turned."""
    length_m, width_m, _ = product.parts[name].size_m
    c, s = abs(math.cos(yaw_rad)), abs(math.sin(yaw_rad))
    return length_m * c + width_m * s, length_m * s + width_m * c


def _some_on_table(
    product: Product, bench: Bench, parts: Sequence[ScenePart], share: float, rng: np.random.Generator
) -> tuple[ScenePart, ...]:
    """Some of the parts on the table between bracket and bins, one at each of a few spots."""
    x = bench.bracket.position_m[0] + TABLE_FROM_BRACKET_M
    middle = bench.bracket.position_m[1]
    spots = [middle + TABLE_PITCH_M * step for step in (-2, -1, 0, 1, 2)]
    free = [spots[index] for index in rng.permutation(len(spots))]
    found = []
    for part in parts:
        if free and bernoulli(share, rng):
            yaw = float(rng.uniform(-MOST_YAW_RAD, MOST_YAW_RAD))
            place = (x, free.pop() + float(rng.uniform(-0.015, 0.015)), product.parts[part.part].peg_length_m)
            part = replace(part, world_from_part=Pose.from_yaw(place, yaw))
        found.append(part)
    return tuple(found)


def _some_in_tray(
    product: Product, bench: Bench, parts: Sequence[ScenePart], share: float, rng: np.random.Generator
) -> tuple[ScenePart, ...]:
    """Some of the parts in the robot's tray, one at each of a few spots that are far apart."""
    x, y, z = bench.tray.centre_m
    length_m, width_m = bench.tray.size_m
    spots = [(x + length_m * dx, y + width_m * dy) for dx in (-0.25, 0.25) for dy in (-0.3, 0.0, 0.3)]
    free = [spots[index] for index in rng.permutation(len(spots))]
    found = []
    for part in parts:
        if free and bernoulli(share, rng):
            place = (*free.pop(), z + product.parts[part.part].peg_length_m)
            part = replace(part, world_from_part=Pose.from_yaw(place, float(rng.uniform(-MOST_YAW_RAD, MOST_YAW_RAD))))
        found.append(part)
    return tuple(found)


def at_places(product: Product, bench: Bench) -> tuple[ScenePart, ...]:
    """Parts that stand at places with names when a run begins."""
    return tuple(
        ScenePart(part, place.stands(number, product.parts[part].peg_length_m), "place")
        for place in bench.places.values()
        for number, part in enumerate(place.filled)
        if part != EMPTY
    )


def _row(product: Product, bench: Bench, name: str) -> tuple[tuple[float, float, float], ...]:
    """Where the parts of one type stand in their own bin: a row along y, body lengths along x (body bottoms)."""
    x, y, z = bench.bins_m[name]
    part = product.parts[name]
    pitch = part.size_m[1] + BIN_GAP_M
    first = y - pitch * (part.quantity - 1) / 2
    return tuple((x, first + pitch * i, z + part.peg_length_m) for i in range(part.quantity))


class _Place(NamedTuple):
    """A rectangle of the table from `low` to `high`, (x, y) in the world [m], and where the file says it."""

    name: str
    location: Location
    low: tuple[float, float]
    high: tuple[float, float]


def overlapping(product: Product, bench: Bench) -> list[tuple[Location, str]]:
    """Of every two that overlap the second one's location in the configuration, and what is wrong there."""
    found = []
    for first, second in combinations(_places(product, bench), 2):
        depths_m = [
            min(a, b) - max(c, d) for a, b, c, d in zip(first.high, second.high, first.low, second.low, strict=True)
        ]
        both = first.location[1] == second.location[1] == "obstacles"  # which together may be one thing
        if min(depths_m) > 0 and not both:
            what = f"{second.name} and {first.name} overlap by {min(depths_m):.3f} m; move one of them"
            found.append((second.location, what))
    return found


def _places(product: Product, bench: Bench) -> list[_Place]:
    """Their inner sides: neighbours may share a wall. A turned bracket counts as the rectangle around it."""
    holes_m = np.array([(*hole, 0.0) for hole in product.bracket.holes_m.values()])
    low_m, high_m = holes_m.min(axis=0) - product.bracket.margin_m, holes_m.max(axis=0) + product.bracket.margin_m
    corners_m = np.array([(x, y, 0.0) for x in (low_m[0], high_m[0]) for y in (low_m[1], high_m[1])])
    places = [
        _spanned("the bracket", ("bench", "bracket", "position_m"), bench.bracket.pose.transform(corners_m)),
        _around("the tray", ("bench", "tray", "centre_m"), bench.tray.centre_m, bench.tray.size_m),
    ]
    named = [name for name in bench.bins_m if name in product.parts]
    for name, bin_ in zip(named, own_bins(product, bench), strict=True):
        places.append(_around(f"the bin of {name}", ("bench", "bins_m", name), bin_.centre_m, bin_.size_m))
    for name, place in bench.places.items():
        length, width = place.size_m(product.longest_m(place.holds))
        corners_m = np.array([(x, y, 0.0) for x in (-length / 2, length / 2) for y in (-width / 2, width / 2)])
        places.append(_spanned(name, ("bench", "places", name), place.pose.transform(corners_m)))
    for number, obstacle in enumerate(bench.obstacles):
        points = obstacle.points_m
        if points[:, 2].min() < LOW_M:
            places.append(_spanned(obstacle.name, ("bench", "obstacles", number), points))
    return places


def _spanned(name: str, location: Location, points_m: Array) -> _Place:
    """The rectangle that points (n, 3) span, seen from above."""
    low, high = points_m[:, :2].min(axis=0), points_m[:, :2].max(axis=0)
    return _Place(name, location, (float(low[0]), float(low[1])), (float(high[0]), float(high[1])))


def _around(name: str, location: Location, centre_m: tuple[float, float, float], size_m: tuple[float, float]) -> _Place:
    x, y, _ = centre_m
    return _Place(name, location, (x - size_m[0] / 2, y - size_m[1] / 2), (x + size_m[0] / 2, y + size_m[1] / 2))
