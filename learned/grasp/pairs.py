"""Numbers that describe one part beside another, for a network that asks whether the second blocks the first."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from cell.interfaces.pose import Array
from learned.grasp.geometry import Boxes

PAIR_FEATURES = 16
REACH_M = 0.16  # no outline of gripper or part extends so far from a part's middle that farther pairs matter
_UNIT_M = 0.03


def near_pairs(boxes: Boxes) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """Indices (p,) of required parts and (p,) of neighbours within reach of them."""
    offset = boxes.centre_m[None] - boxes.centre_m[:, None]
    near = np.hypot(offset[..., 0], offset[..., 1]) < REACH_M
    np.fill_diagonal(near, False)
    required, neighbour = np.nonzero(near)
    return required, neighbour


def pair_features(boxes: Boxes, required: NDArray[np.intp], neighbour: NDArray[np.intp]) -> NDArray[np.float32]:
    """Features (p, PAIR_FEATURES) of neighbours in the required parts' frames.

    A box looks the same from both ends and from both sides, and so does the gripper: the neighbour is mirrored into
    the quarter x, y >= 0 of the required part's frame, so that the network need not learn these symmetries.
    """
    offset = boxes.centre_m[neighbour] - boxes.centre_m[required]
    yaw = boxes.yaw_rad[required]
    along = offset[:, 0] * np.cos(yaw) + offset[:, 1] * np.sin(yaw)
    across = offset[:, 1] * np.cos(yaw) - offset[:, 0] * np.sin(yaw)
    turn = boxes.yaw_rad[neighbour] - yaw
    mirrored = np.where(along * across < 0, -1.0, 1.0)
    own, other = boxes.size_m[required], boxes.size_m[neighbour]
    cos, sin = np.abs(np.cos(turn)), np.abs(np.sin(turn))
    # The required part as the neighbour sees it.
    seen_along = np.abs(offset[:, 0] * np.cos(yaw + turn) + offset[:, 1] * np.sin(yaw + turn))
    seen_across = np.abs(offset[:, 1] * np.cos(yaw + turn) - offset[:, 0] * np.sin(yaw + turn))
    half_along = (other[:, 0] * cos + other[:, 1] * sin) / 2
    half_across = (other[:, 0] * sin + other[:, 1] * cos) / 2
    lengths: Array = np.column_stack(
        [
            own,
            other,
            np.abs(along),
            np.abs(across),
            np.abs(along) - half_along,
            np.abs(across) - half_across - own[:, 1] / 2,
            seen_along,
            seen_across,
            boxes.bottom_m[neighbour] - boxes.bottom_m[required],
            boxes.top_m[neighbour] - boxes.top_m[required],
        ]
    )
    angles = np.column_stack([np.cos(2 * turn), mirrored * np.sin(2 * turn)])
    features: NDArray[np.float32] = np.concatenate([lengths / _UNIT_M, angles], axis=1).astype(np.float32)
    return features
