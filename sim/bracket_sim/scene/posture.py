"""Which side of a body is down, and how much room it takes then."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from bracket_ground.interfaces.pose import Pose
from bracket_ground.interfaces.product import PartType
from bracket_ground.interfaces.solid import Solid

_HALF = 0.5**0.5
UPRIGHT = "upright"
# rotation (w, x, y, z) of a body by what of it is down
TURNS: dict[str, tuple[float, float, float, float]] = {
    UPRIGHT: (1.0, 0.0, 0.0, 0.0),
    "left side": (_HALF, _HALF, 0.0, 0.0),
    "right side": (_HALF, -_HALF, 0.0, 0.0),
    "one end": (_HALF, 0.0, _HALF, 0.0),
    "other end": (_HALF, 0.0, -_HALF, 0.0),
    "head": (0.0, 1.0, 0.0, 0.0),
}
LYING = tuple(name for name in TURNS if name != UPRIGHT)
SIDES = ("left side", "right side")
DROP_M = 0.001  # a body begins this far above what it will lie on


@dataclass(frozen=True)
class Stance:
    """A body as it will lie.

    Attributes:
        spot_from_body: its frame, seen from the middle of the room it takes, on the floor.
        room_m: (length, width, height) of that room.
    """

    spot_from_body: Pose
    room_m: tuple[float, float, float]


def stance(solids: tuple[Solid, ...], turn: str) -> Stance:
    """The stance of some solids with one side down, a little above the floor."""
    turned = Pose((0.0, 0.0, 0.0), TURNS[turn])
    points = turned.transform(np.concatenate([solid.points() for solid in solids]))
    low, high = points.min(axis=0), points.max(axis=0)
    x, y, _ = (low + high) / 2
    length, width, height = (float(extent) for extent in high - low)
    return Stance(Pose((-float(x), -float(y), DROP_M - float(low[2]))) @ turned, (length, width, height))


def whole(kind: PartType) -> tuple[Solid, ...]:
    """All solids of a part, its peg among them."""
    return kind.whole
