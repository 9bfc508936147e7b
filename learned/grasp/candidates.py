"""Grasp candidates: across a part's width, or across its length where the jaw opens so far; always at its middle."""

from __future__ import annotations

from typing import Literal, Protocol

import numpy as np

from cell.interfaces.pose import Array
from learned.grasp.boxes import Blocks, Boxes

Candidate = Literal["width", "length"]
CANDIDATES: tuple[Candidate, ...] = ("width", "length")
_GRIPPED = (1, 0)  # column of a body's size that is between the fingers
_TURN_RAD = np.array([0.0, np.pi / 2])


class Opening(Protocol):
    """What decides which candidates exist."""

    @property
    def clearance_m(self) -> float:
        """Gap between each finger and the body during descent."""
        ...

    @property
    def one_way(self) -> bool:
        """Parts are grasped across their width alone."""
        ...

    @property
    def stroke_m(self) -> float:
        """Widest opening of the jaw."""
        ...


def gripped_m(boxes: Boxes) -> Array:
    """Extent (n, candidates) of each body between the fingers."""
    extent: Array = boxes.size_m[:, _GRIPPED]
    return extent


def jaw_yaw_rad(boxes: Boxes) -> Array:
    """Heading (n, candidates) of the fingers' width; they close at a right angle to it."""
    yaw: Array = boxes.yaw_rad[:, None] + _TURN_RAD
    return yaw


def available(boxes: Boxes, opening: Opening) -> Blocks:
    """(n, candidates): whether the jaw opens wide enough and may grasp so."""
    fits: Blocks = gripped_m(boxes) + 2 * opening.clearance_m <= opening.stroke_m
    if opening.one_way:
        fits[:, CANDIDATES.index("length")] = False
    return fits


def mark_missing(blocks: Blocks, exists: Blocks) -> Blocks:
    """Blocks (n, candidates, n) in which a candidate that does not exist is blocked by the part itself alone.

    Args:
        blocks: [i, c, j] true where j is in the way of grasping i by candidate c.
        exists: (n, candidates).
    """
    own = np.eye(len(blocks), dtype=bool)[:, None]
    marked: Blocks = np.where(exists[..., None], blocks & ~own, own)
    return marked


def graspable(blocks: Blocks) -> Blocks:
    """(n,): whether any candidate of a part is free."""
    free: Blocks = np.any(~blocks.any(axis=-1), axis=-1)
    return free
