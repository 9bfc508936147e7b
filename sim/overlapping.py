"""What stands in each other's place on a bench: bins, tray and bracket."""

from __future__ import annotations

from itertools import combinations
from typing import NamedTuple

import numpy as np

from cell.interfaces.bench import Bench
from cell.interfaces.product import Product
from sim.storage import own_bins

Location = tuple[str, ...]


class _Place(NamedTuple):
    """A rectangle of the table from `low` to `high`, (x, y) in the world [m], and where the file says it."""

    name: str
    location: Location
    low: tuple[float, float]
    high: tuple[float, float]


def overlapping(product: Product, bench: Bench) -> list[tuple[Location, str]]:
    """Of every two that overlap the second one's location in the configuration, and what is wrong there."""
    found = []
    for one, other in combinations(_places(product, bench), 2):
        depths_m = [min(a, b) - max(c, d) for a, b, c, d in zip(one.high, other.high, one.low, other.low, strict=True)]
        if min(depths_m) > 0:
            what = f"{other.name} and {one.name} overlap by {min(depths_m):.3f} m; move one of them"
            found.append((other.location, what))
    return found


def _places(product: Product, bench: Bench) -> list[_Place]:
    """Their inner sides: neighbours may share a wall. A turned bracket counts as the rectangle around it."""
    holes_m = np.array([(*hole, 0.0) for hole in product.bracket.holes_m.values()])
    low_m, high_m = holes_m.min(axis=0) - product.bracket.margin_m, holes_m.max(axis=0) + product.bracket.margin_m
    corners_m = np.array([(x, y, 0.0) for x in (low_m[0], high_m[0]) for y in (low_m[1], high_m[1])])
    plate_m = bench.bracket.pose.transform(corners_m)[:, :2]
    low, high = plate_m.min(axis=0), plate_m.max(axis=0)
    places = [
        _Place(
            "the bracket",
            ("bench", "bracket", "position_m"),
            (float(low[0]), float(low[1])),
            (float(high[0]), float(high[1])),
        ),
        _around("the tray", ("bench", "tray", "centre_m"), bench.tray.centre_m, bench.tray.size_m),
    ]
    named = [name for name in bench.bins_m if name in product.parts]
    for name, one in zip(named, own_bins(product, bench), strict=True):
        places.append(_around(f"the bin of {name}", ("bench", "bins_m", name), one.centre_m, one.size_m))
    return places


def _around(name: str, location: Location, centre_m: tuple[float, float, float], size_m: tuple[float, float]) -> _Place:
    x, y, _ = centre_m
    return _Place(name, location, (x - size_m[0] / 2, y - size_m[1] / 2), (x + size_m[0] / 2, y + size_m[1] / 2))
