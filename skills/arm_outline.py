"""The arm's outline: how far each link, the gripper or a held part is from a body, and where its corners are."""

from __future__ import annotations

import coal
import numpy as np
import pinocchio

from cell.interfaces.pose import Array
from skills.collision import HELD, CollisionChecker

HELD_RADIUS_M = 0.05  # of a sphere around a part between the fingers
FIXED_JOINTS = 1  # base and shoulder stand where the person does not reach
HERE = coal.Transform3s()


class ArmOutline:
    """Links from the upper arm on, gripper and camera; in the order of `names`.

    Attributes:
        names: of the L links.
    """

    def __init__(self, checker: CollisionChecker) -> None:
        self._model, self._geometry = checker.model, checker.arm_with_part(HELD_RADIUS_M)
        self._data, self._placed = self._model.createData(), self._geometry.createData()
        objects = self._geometry.geometryObjects
        self._links = [number for number, item in enumerate(objects) if item.parentJoint > FIXED_JOINTS]
        self.names = tuple(objects[number].name for number in self._links)
        self._corners = np.array([_corners(objects[number].geometry) for number in self._links])
        self._part = np.array([name == HELD for name in self.names])

    def distances(self, joints_rad: Array, body: coal.Convex, holding: bool) -> tuple[Array, Array]:
        """Least distances (L,) in [m], and the ways (L, 3) from the body to the links; infinite for a part not held."""
        self._place(joints_rad)
        distances, ways = np.full(len(self._links), np.inf), np.zeros((len(self._links), 3))
        request, result = coal.DistanceRequest(), coal.DistanceResult()
        for row, number in enumerate(self._links):
            if self._part[row] and not holding:
                continue
            placement, shape = self._placed.oMg[number], self._geometry.geometryObjects[number].geometry
            result.clear()
            link = coal.Transform3s(placement.rotation, placement.translation)
            distances[row] = coal.distance(shape, link, body, HERE, request, result)
            ways[row] = result.getNearestPoint1() - result.getNearestPoint2()
        return distances, ways

    def corners_m(self, joints_rad: Array) -> Array:
        """Corners (L, 8, 3) of boxes around the links; no point of a link is faster than its fastest corner."""
        self._place(joints_rad)
        turned = np.array([self._placed.oMg[number].rotation for number in self._links])
        moved = np.array([self._placed.oMg[number].translation for number in self._links])
        corners: Array = np.einsum("lij,lcj->lci", turned, self._corners) + moved[:, None]
        return corners

    def _place(self, joints_rad: Array) -> None:
        pinocchio.updateGeometryPlacements(self._model, self._data, self._geometry, self._placed, joints_rad)


def _corners(shape: coal.CollisionGeometry) -> Array:
    """Of the box (8, 3) around a shape, in its own frame."""
    shape.computeLocalAABB()
    low, high = shape.aabb_local.min_, shape.aabb_local.max_
    return np.array([[x, y, z] for x in (low[0], high[0]) for y in (low[1], high[1]) for z in (low[2], high[2])])
