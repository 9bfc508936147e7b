"""Where the links are along a path: forward kinematics of many places at once, in numpy."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pinocchio

from cell.interfaces.pose import Array


class LinkPlaces:
    """An arm whose joints follow one another, with bodies that are fixed to them.

    Args:
        joints: of each body's placement: the joint that carries it.
        placements: joint_from_body of each.
    """

    def __init__(self, model: pinocchio.Model, joints: Sequence[int], placements: Sequence[pinocchio.SE3]) -> None:
        self._turns = [_turn(model, number) for number in range(1, model.njoints)]
        self._joints = np.array(joints) - 1
        self._placements = np.array([one.homogeneous for one in placements])

    def at(self, joints_rad: Array) -> Array:
        """world_from_body (K, L, 4, 4) of L bodies, from joints (K, n)."""
        cosines, sines = np.cos(joints_rad)[..., None, None], np.sin(joints_rad)[..., None, None]
        carried, place = np.empty((len(joints_rad), len(self._turns), 4, 4)), None
        for number, (still, sine, cosine) in enumerate(self._turns):
            turned = still + sine * sines[:, number] + cosine * cosines[:, number]
            place = turned if place is None else place @ turned
            carried[:, number] = place
        placed: Array = carried[:, self._joints] @ self._placements
        return placed


def _turn(model: pinocchio.Model, number: int) -> tuple[Array, Array, Array]:
    """What turns with a joint: the sum of the first, the second times its sine and the third times its cosine.

    Rodrigues' formula, after the placement of the joint on the one before it.
    """
    assert model.parents[number] == number - 1
    data = model.joints[number].createData()
    model.joints[number].calc(data, np.zeros(model.nq))
    x, y, z = np.asarray(data.S)[3:].ravel()
    cross = np.zeros((4, 4))
    cross[:3, :3] = [[0, -z, y], [z, 0, -x], [-y, x, 0]]
    before, square = model.jointPlacements[number].homogeneous, cross @ cross
    return before @ (np.eye(4) + square), before @ cross, before @ -square
