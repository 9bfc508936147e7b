"""The arm's outline: how far each link, the gripper or a held part is from a body, and where its corners are."""

from __future__ import annotations

import coal
import numpy as np

from cell.interfaces.pose import Array
from skills.motion.collision import HELD, CollisionChecker, box_corners
from skills.motion.kinematics import LinkPlaces

HELD_RADIUS_M = 0.05  # of a sphere around a part between the fingers
FIXED_JOINTS = 1  # base and shoulder stand where the person does not reach
HERE = coal.Transform3s()


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
        self._request = coal.DistanceRequest()

    def distances(self, joints_rad: Array, body: coal.Convex, holding: bool) -> tuple[Array, Array]:
        """Least distances (L,) in [m], and the ways (L, 3) from the body to the links; infinite for a part not held."""
        distances, ways = self.rooms(self.placed(joints_rad[np.newaxis]), body, holding)
        return distances[0], ways[0]

    def placed(self, joints_rad: Array) -> Array:
        """Where the links are at K times, from joints (K, 6): world_from_link (K, L, 4, 4)."""
        return self._places.at(joints_rad)

    def rooms(
        self, placed: Array, body: coal.Convex, holding: bool, wanted: Array | None = None
    ) -> tuple[Array, Array]:
        """The same as `distances` at K times, for the links (K, L) that are wanted; infinite for all others."""
        wanted = np.ones(placed.shape[:2], dtype=bool) if wanted is None else wanted
        distances, ways = np.full(placed.shape[:2], np.inf), np.zeros((*placed.shape[:2], 3))
        request, result = self._request, coal.DistanceResult()
        asked = np.nonzero(wanted if holding else wanted & self._always)
        for number, row in zip(*(index.tolist() for index in asked), strict=True):
            at = placed[number, row]
            result.clear()
            link = coal.Transform3s(at[:3, :3], at[:3, 3])
            distances[number, row] = coal.distance(self._shapes[row], link, body, HERE, request, result)
            ways[number, row] = result.getNearestPoint1() - result.getNearestPoint2()
        return distances, ways

    def corners_m(self, placed: Array) -> Array:
        """Corners (K, L, 8, 3) of boxes around the links at K times; no point of a link is faster than the fastest.

        Args:
            placed: (K, L, 4, 4), see `placed`.
        """
        corners: Array = self._corners @ placed[..., :3, :3].swapaxes(-1, -2) + placed[..., None, :3, 3]
        return corners
