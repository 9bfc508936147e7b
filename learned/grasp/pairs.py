"""Numbers that describe one part beside another, for a network that asks whether the second is in the way."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cell.interfaces.pose import Array
from learned.grasp.boxes import Boxes
from learned.grasp.options import available, gripped_m, jaw_yaw_rad
from learned.grasp.settings import GripperOutline

Indices = NDArray[np.intp]

PAIR_FEATURES = 16
REACH_M = 0.16  # no outline of gripper or part extends so far from a part's middle that farther pairs matter
_UNIT_M = 0.03


@dataclass(frozen=True)
class Pairs:
    """Indices (p,) each: a part, an option to grasp it, a neighbour within reach."""

    part: Indices
    option: Indices
    neighbour: Indices

    def __len__(self) -> int:
        return len(self.part)


def near_pairs(boxes: Boxes) -> Pairs:
    """All pairs of neighbours, for every option that the part has."""
    offset = boxes.centre_m[None] - boxes.centre_m[:, None]
    near = np.hypot(offset[..., 0], offset[..., 1]) < REACH_M
    np.fill_diagonal(near, False)
    exists = available(boxes, GripperOutline())
    return Pairs(*np.nonzero(near[:, None] & exists[..., None]))


def pair_features(boxes: Boxes, pairs: Pairs) -> NDArray[np.float32]:
    """Features (p, PAIR_FEATURES) of neighbours in the jaw's frame at the parts.

    A box looks the same from both ends and from both sides, and so does the gripper: the neighbour is mirrored into
    the quarter x, y >= 0 of the jaw's frame, so that the network need not learn these symmetries.
    """
    required, neighbour = pairs.part, pairs.neighbour
    offset = boxes.centre_m[neighbour] - boxes.centre_m[required]
    yaw = jaw_yaw_rad(boxes)[required, pairs.option]
    along = offset[:, 0] * np.cos(yaw) + offset[:, 1] * np.sin(yaw)
    across = offset[:, 1] * np.cos(yaw) - offset[:, 0] * np.sin(yaw)
    turn = boxes.yaw_rad[neighbour] - yaw
    mirrored = np.where(along * across < 0, -1.0, 1.0)
    gripped = gripped_m(boxes)
    own = np.column_stack(
        [gripped[required, 1 - pairs.option], gripped[required, pairs.option], boxes.size_m[required, 2]]
    )
    other = boxes.size_m[neighbour]
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
