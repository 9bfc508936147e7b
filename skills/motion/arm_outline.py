"""The arm's outline: how far each link, the gripper or a held part is from a body, and where its corners are."""

from __future__ import annotations

from functools import lru_cache

import coal
import numpy as np
from numpy.typing import NDArray

from cell.interfaces.pose import Array
from skills.motion.collision import HELD, CollisionChecker, box_corners
from skills.motion.kinematics import LinkPlaces

HELD_RADIUS_M = 0.05  # of a sphere around a part between the fingers
FIXED_JOINTS = 1  # base and shoulder stand where the person does not reach
HERE = coal.Transform3s()
MARGIN_M = 1e-4  # that a measured distance may be below its bound, as it is found by steps


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
        """Measure those (K, L) that are wanted and were not measured so far."""
        request, result = coal.DistanceRequest(), coal.DistanceResult()
        numbers, rows = np.nonzero(wanted & ~self._asked)
        self._asked |= wanted
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
    """

    def __init__(self, checker: CollisionChecker) -> None:
        objects = checker.arm_with_part(HELD_RADIUS_M).geometryObjects
        links = [item for item in objects if item.parentJoint > FIXED_JOINTS]
        self._places = LinkPlaces(checker.model, [one.parentJoint for one in links], [one.placement for one in links])
        self.names = tuple(one.name for one in links)
        self._shapes = [one.geometry for one in links]
        self._corners = np.array([box_corners(shape) for shape in self._shapes])
        self._always = np.array([name != HELD for name in self.names])

    def distances(self, joints_rad: Array, body: coal.Convex, holding: bool) -> tuple[Array, Array]:
        """Least distances (L,) in [m], and the ways (L, 3) from the body to the links; infinite for a part not held."""
        rooms = self.rooms(self.placed(joints_rad[np.newaxis]), body, holding)
        return rooms.distances_m[0], rooms.ways[0]

    def placed(self, joints_rad: Array) -> Array:
        """Where the links are at K times, from joints (K, 6): world_from_link (K, L, 4, 4)."""
        return self._places.at(joints_rad)

    def rooms(self, placed: Array, body: coal.Convex, holding: bool) -> Rooms:
        """The same as `distances` at K times, all measured."""
        rooms = self.least_rooms(placed, self.corners_m(placed), body, holding)
        rooms.measure(np.isfinite(rooms.least_m))
        return rooms

    def least_rooms(self, placed: Array, corners_m: Array, body: coal.Convex, holding: bool) -> Rooms:
        """Bounds of `distances` at K times, from the links' corners there; nothing is measured."""
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


def bounds_m(corners_m: Array, body: coal.Convex) -> Array:
    """(...) that no point between corners (..., 8, 3) is nearer to a body: how far they are beyond one of its faces."""
    normals, reach_m = _faces(body)
    corners = np.ascontiguousarray(corners_m.reshape(-1, 8, 3).T).reshape(3, -1)  # sums and minima go along them
    beyond_m = (normals @ corners).reshape(len(normals), 8, -1).min(axis=1)
    bounds: Array = (beyond_m - reach_m[:, np.newaxis]).max(axis=0).reshape(corners_m.shape[:-2]) - MARGIN_M
    return bounds


@lru_cache(maxsize=16)  # a body is asked for several times in a tick, and those beyond the view in all ticks
def _faces(body: coal.Convex) -> tuple[Array, Array]:
    """Outward normals (F, 3) of a body's faces, and how far it reaches along them."""
    points = np.array(body.points())
    corners = points[[[corner[0], corner[1], corner[2]] for corner in map(body.polygons, range(body.num_polygons))]]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normals *= np.sign(np.einsum("fi,fi->f", normals, corners[:, 0] - points.mean(axis=0)))[:, np.newaxis]
    normals /= np.maximum(np.linalg.norm(normals, axis=1), 1e-12)[:, np.newaxis]
    normals = np.unique(normals.round(6), axis=0)  # of two triangles of one face
    return normals, (points @ normals.T).max(axis=0)
