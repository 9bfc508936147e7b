"""The arm's outline: how far each link, the gripper or a held part is from a body, and where its corners are."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import coal
import numpy as np
from numpy.typing import NDArray

from bracket_cell.skills.motion.collision import HELD, CollisionChecker, box_corners
from bracket_cell.skills.motion.kinematics import LinkPlaces
from bracket_ground.interfaces.pose import Array


@dataclass(frozen=True)
class OutlineLimits:
    """How the arm is drawn for distances to people. Origin: chosen.

    Attributes:
        held_radius_m: [m] of a sphere around a part between the fingers.
        fixed_joints: [joints] from the base whose links stand where the person does not reach.
        margin_m: [m] that a measured distance may be below its bound, as it is found by steps.
    """

    held_radius_m: float = 0.05
    fixed_joints: int = 1
    margin_m: float = 0.0001


OUTLINE = OutlineLimits()


HERE = coal.Transform3s()


class Rooms:
    """Distances of links at K times to a body, each measured when it is asked for.

    Attributes:
        least_m: (K, L) that no distance is below; infinite for a part that is not held.
        distances_m: (K, L), infinite where not measured.
        ways: (K, L, 3) from the body to the link, zero where not measured.
    """

    def __init__(self, shapes: list[coal.CollisionGeometry], placed: Array, body: coal.Convex, least_m: Array) -> None:
        self._shapes, self._placed, self._body = shapes, placed, body
        self._asked = np.isinf(least_m)
        self.least_m = least_m
        self.distances_m, self.ways = np.full(placed.shape[:2], np.inf), np.zeros((*placed.shape[:2], 3))

    def measure(self, wanted: NDArray[np.bool_]) -> None:
        """Measure those of the first times, or of all, that are wanted and were not measured so far."""
        request, result = coal.DistanceRequest(), coal.DistanceResult()
        asked = self._asked[: len(wanted)]
        numbers, rows = np.nonzero(wanted & ~asked)
        asked |= wanted
        for number, row in zip(numbers.tolist(), rows.tolist(), strict=True):
            at = self._placed[number, row]
            result.clear()
            link = coal.Transform3s(at[:3, :3], at[:3, 3])
            shape = self._shapes[row]
            self.distances_m[number, row] = coal.distance(shape, link, self._body, HERE, request, result)
            self.ways[number, row] = result.getNearestPoint1() - result.getNearestPoint2()


class ArmOutline:
    """Links from the upper arm on, gripper and camera; in the order of `names`.

    Attributes:
        names: of the L links.
        joints: how many the arm has.
    """

    def __init__(self, checker: CollisionChecker) -> None:
        objects = checker.arm_with_part(OUTLINE.held_radius_m).geometryObjects
        links = [item for item in objects if item.parentJoint > OUTLINE.fixed_joints]
        self._places = LinkPlaces(
            checker.model, [link.parentJoint for link in links], [link.placement for link in links]
        )
        self.names, self.joints = tuple(link.name for link in links), checker.model.nq
        self._shapes = [link.geometry for link in links]
        self._corners = np.array([box_corners(shape) for shape in self._shapes])
        self._always = np.array([name != HELD for name in self.names])

    def distances(self, joints_rad: Array, body: coal.Convex, holding: bool) -> tuple[Array, Array]:
        """Least distances (L,) in [m], and the ways (L, 3) from the body to the links; infinite for a part not held."""
        rooms = self.rooms(self.placed(joints_rad[np.newaxis]), body, holding)
        return rooms.distances_m[0], rooms.ways[0]

    def placed(self, joints_rad: Array) -> Array:
        """Where the links are at K times, from joints (K, n): world_from_link (K, L, 4, 4)."""
        return self._places.at(joints_rad)

    def rooms(self, placed: Array, body: coal.Convex, holding: bool, below_m: float = np.inf) -> Rooms:
        """The same as `distances` at K times; measured where they may be below a limit."""
        rooms = self.least_rooms(placed, turned(self.corners_m(placed)), body, holding)
        rooms.measure(rooms.least_m < below_m)
        return rooms

    def least_rooms(self, placed: Array, corners_m: Array, body: coal.Convex, holding: bool) -> Rooms:
        """Bounds of `distances` at K times, from the links' corners there (3, 8, K, L); nothing is measured."""
        least_m = bounds_m(corners_m, body)
        if not holding:
            least_m[:, ~self._always] = np.inf
        return Rooms(self._shapes, placed, body, least_m)

    def corners_m(self, placed: Array) -> Array:
        """Corners (K, L, 8, 3) of boxes around the links at K times; no point of a link is faster than the fastest.

        Args:
            placed: (K, L, 4, 4), see `placed`.
        """
        corners: Array = self._corners @ placed[..., :3, :3].swapaxes(-1, -2) + placed[..., None, :3, 3]
        return corners


def turned(corners_m: Array) -> Array:
    """Corners (K, L, 8, 3) as (3, 8, K, L), as sums and minima over them are made quickly then."""
    return np.ascontiguousarray(corners_m.transpose(3, 2, 0, 1))


def bounds_m(corners_m: Array, body: coal.Convex) -> Array:
    """(K, L) that no point between corners (3, 8, K, L) is nearer to a body: so far they are beyond a face of it."""
    normals, reach_m = _faces(body)
    beyond_m = (normals @ corners_m.reshape(3, -1)).reshape(len(normals), *corners_m.shape[1:]).min(axis=1)
    bounds: Array = (beyond_m - reach_m[:, np.newaxis, np.newaxis]).max(axis=0) - OUTLINE.margin_m
    return bounds


@lru_cache(maxsize=16)  # a body is asked for several times in a tick, and those beyond the view in all ticks
def _faces(body: coal.Convex) -> tuple[Array, Array]:
    """Outward normals (F, 3) of a body's faces, and how far it reaches along them."""
    points = np.array(body.points())
    triangles = [body.polygons(number) for number in range(0, body.num_polygons, 2)]  # two make a face of a prism
    first, second, third = (points[[corner[i] for corner in triangles]] for i in range(3))
    normals = _cross((second - first).T, (third - first).T).T
    normals *= np.sign(((first - points.mean(axis=0)) * normals).sum(axis=1))[:, np.newaxis]
    normals /= np.sqrt((normals * normals).sum(axis=1))[:, np.newaxis]
    return normals, (points @ normals.T).max(axis=0)


def _cross(a: Array, b: Array) -> Array:
    return np.array([a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]])
