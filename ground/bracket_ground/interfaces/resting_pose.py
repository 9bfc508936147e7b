"""How a part can lie: which of its sides is up, and the pose in which it then comes to rest on a level floor."""

from __future__ import annotations

import math
from functools import cache

import numpy as np

from bracket_ground.interfaces.pose import Array, Pose
from bracket_ground.interfaces.product import PartType

UPRIGHT = "+z"
SIDES = ("+y", "-y", "+x", "-x", "-z")
"""What of a part that lies is up, as an axis of its own frame; `UPRIGHT` for one that stands on its peg."""

NEAR_RAD = math.radians(25)  # a part that tips farther than this does not rest on that side
RAISED_M = 0.012  # of the lowest point: what is higher lies on something, whether that is seen or not
_TOUCHING_M = 1e-5
_TIPS = 20


def axis_of(side: str) -> Array:
    """The direction (3,) in the part's frame: `-y` is (0, -1, 0)."""
    axis = np.zeros(3)
    axis["xyz".index(side[1])] = 1.0 if side[0] == "+" else -1.0
    return axis


@cache
def rest_on(kind: PartType, up: str) -> Pose | None:
    """floor_from_part of a part that was laid down with this side up, its middle of mass above the origin.

    It tips until the middle of its mass is above what it touches, its material being alike everywhere.

    Returns:
        The pose, z from the floor; None where it tips over onto another side.
    """
    solids = kind.whole
    points = np.concatenate([solid.points() for solid in solids])
    volumes = np.array([solid.volume_m3 for solid in solids])
    mass = volumes @ np.array([solid.middle_m for solid in solids]) / volumes.sum()
    turned = laid(up)
    for _ in range(_TIPS):
        tip = _tip(points @ turned.T, turned @ mass)
        if tip is None:
            break
        turned = tip @ turned
    else:
        return None
    if float(turned[2] @ axis_of(up)) < math.cos(NEAR_RAD):
        return None
    x, y, _ = turned @ mass
    pose = np.eye(4)
    pose[:3, :3], pose[:3, 3] = turned, (-x, -y, -float((points @ turned.T)[:, 2].min()))
    return Pose.from_matrix(pose)


def side_up(world_from_part: Pose) -> str:
    """The side that is up, or most nearly so."""
    return max((UPRIGHT, *SIDES), key=lambda side: float(world_from_part.rotation[2] @ axis_of(side)))


def over_floor_m(kind: PartType, world_from_part: Pose, floor_m: float) -> float:
    """How high above a floor the lowest point of a part is."""
    points = world_from_part.transform(np.concatenate([solid.points() for solid in kind.whole]))
    return float(points[:, 2].min()) - floor_m


def lies_raised(kind: PartType, world_from_part: Pose, floor_m: float) -> bool:
    """Whether a part is too high above a floor to lie on it."""
    return over_floor_m(kind, world_from_part, floor_m) > RAISED_M


def laid(up: str) -> Array:
    """A rotation (3, 3) that turns this side up; along the floor runs what is next in the order x, y, z."""
    first = "xyz".index(up[1])
    third, ahead = axis_of(up), np.eye(3)[(first + 1) % 3]
    rotation: Array = np.array([ahead, np.cross(third, ahead), third])
    return rotation


def _tip(points: Array, mass: Array) -> Array | None:
    """The rotation (3, 3) until the next point touches the floor, or None where nothing tips."""
    low = points[:, 2].min()
    touching = points[points[:, 2] < low + _TOUCHING_M]
    foot = _nearest_foot(touching[:, :2], mass[:2])
    way = mass[:2] - foot
    if float(np.linalg.norm(way)) < _TOUCHING_M:
        return None
    way = way / np.linalg.norm(way)
    ahead, height = (points[:, :2] - foot) @ way, points[:, 2] - low
    angles = np.arctan2(height, ahead)[height >= _TOUCHING_M]
    return _turn(np.array([-way[1], way[0], 0.0]), float(angles.min()))


def _nearest_foot(touching: Array, mass: Array) -> Array:
    """The place (2,) of the area between touching points (n, 2) that is nearest to another."""
    offsets = touching - mass
    bearings = np.sort(np.arctan2(offsets[:, 1], offsets[:, 0]))
    if float(np.diff(bearings, append=bearings[0] + 2 * math.pi).max()) <= math.pi + 1e-9:
        return mass
    edges = touching[None] - touching[:, None]
    along = np.einsum("ijk,ik->ij", edges, -offsets) / np.maximum((edges**2).sum(axis=2), 1e-18)
    feet = (touching[:, None] + np.clip(along, 0.0, 1.0)[..., None] * edges).reshape(-1, 2)
    nearest: Array = feet[np.linalg.norm(feet - mass, axis=1).argmin()]
    return nearest


def _turn(axis: Array, angle_rad: float) -> Array:
    """Rotation matrix (3, 3) about a unit axis (Rodrigues)."""
    x, y, z = axis
    cross = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    rotation: Array = np.eye(3) + math.sin(angle_rad) * cross + (1 - math.cos(angle_rad)) * cross @ cross
    return rotation
