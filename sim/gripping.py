"""Where a hand pinches a part, and how: style of the grip, place on the part, place of the hand for a held part."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from cell.interfaces.pose import Array, Pose
from cell.interfaces.product import PartType, Product
from sim.hand import Hand
from sim.person import Grip, drawn
from sim.pinch import widest, widest_near_end
from sim.worker_sight import SeenPart

SQUEEZE_M = 0.016  # commanded below the part's width: 20 N a finger
LOST_GRIP_M = 0.006  # gap this far below the part's width: nothing is between the fingers
LOST_PART_M = 0.07
CLOSED_M = 0.002  # gap this far above the part's width: the fingers lie against it


@dataclass(frozen=True)
class GripStyle:
    """How one part is gripped; see `Grip`."""

    tilt_rad: float
    roll_rad: float
    curl_rad: float
    from_middle_m: float | None
    open_m: float


class Gripping:
    """How one hand grips parts.

    Attributes:
        style: of the part that is gripped, or was last.

    Args:
        habits: of the person.
        chance: for what not every person does.
    """

    def __init__(self, hand: Hand, product: Product, habits: Grip, chance: np.random.Generator) -> None:
        self._hand, self._product = hand, product
        self._habits, self._chance = habits, chance
        self.style = self._drawn_style()

    def another(self) -> None:
        """The next part is gripped in a style of its own."""
        self.style = self._drawn_style()

    def opened_m(self, part: str) -> float:
        """The gap of the fingers beside a part."""
        return self._product.parts[part].size_m[1] + self.style.open_m

    def closed_m(self, part: str) -> float:
        """What is commanded to hold a part."""
        return self.place(part)[1] - SQUEEZE_M

    def holds(self, seen: SeenPart) -> bool:
        """Whether a part is between the fingers."""
        apart_m = float(np.linalg.norm(np.array(seen.pose.position_m) - self._hand.position_m))
        return self._hand.gap_m > self.place(seen.part)[1] - LOST_GRIP_M and apart_m < LOST_PART_M

    def closed_around(self, seen: SeenPart) -> bool:
        """Whether the fingers lie against a part."""
        return self.holds(seen) and self._hand.gap_m < self.place(seen.part)[1] + CLOSED_M

    def place(self, part: str) -> tuple[tuple[float, float, float], float]:
        """Where in its frame a part is pinched in the present style, and how wide it is there."""
        kind: PartType = self._product.parts[part]
        if self.style.from_middle_m is None:
            return widest_near_end(kind)
        return widest(kind, round(self.style.from_middle_m, 3))

    def around(self, seen: SeenPart, yaw_rad: float) -> tuple[Array, float, float]:
        """Where to pinch a part that may lean; how wide it is across the fingers and how high it reaches, as it stands.

        Returns:
            The pinch (3,), the width and the height of the top, in [m].
        """
        part = self._product.parts[seen.part]
        length_m, width_m, height_m = part.size_m
        corners_m = seen.pose.transform(
            np.array([[x, y, z] for x in (-0.5, 0.5) for y in (-0.5, 0.5) for z in (0, 1)])
            * (length_m, width_m, height_m)
        )
        across = turn(yaw_rad, np.array([0.0, 1.0, 0.0]))
        offsets_m = (corners_m - np.array(seen.pose.position_m)) @ across
        grip_m = np.array(seen.pose.position_m) + turn(yaw_rad, np.array(self.place(seen.part)[0]))
        grip_m += across * (offsets_m.max() + offsets_m.min()) / 2
        return grip_m, float(np.ptp(offsets_m)), float(corners_m[:, 2].max())

    def _drawn_style(self) -> GripStyle:
        """How the next part is gripped; nothing is drawn where the person always does it alike."""
        habits = self._habits
        return GripStyle(
            tilt_rad=drawn(habits.tilt_rad, self._chance),
            roll_rad=drawn(habits.roll_rad, self._chance),
            curl_rad=drawn(habits.curl_rad, self._chance),
            from_middle_m=None if habits.from_middle_m is None else drawn(habits.from_middle_m, self._chance),
            open_m=drawn(habits.open_m, self._chance),
        )

    def hand_for(self, pose: Pose, target_m: Array) -> tuple[Array, float]:
        """Where the hand must be so that the held part is at `target_m` with its long side along x."""
        held_m = turn(-self._hand.yaw_rad, np.array(pose.position_m) - self._hand.position_m)
        yaw_rad = -fold_yaw(pose.yaw_rad - self._hand.yaw_rad)
        return target_m - turn(yaw_rad, held_m), yaw_rad


def fold_yaw(yaw_rad: float) -> float:
    """The same line's heading in (-pi/2, pi/2]: a part looks alike from both ends."""
    folded = math.fmod(yaw_rad, math.pi)
    if folded > math.pi / 2:
        return folded - math.pi
    return folded + math.pi if folded <= -math.pi / 2 else folded


def turn(yaw_rad: float, vector_m: Array) -> Array:
    """A vector (3,) turned about the vertical."""
    c, s = math.cos(yaw_rad), math.sin(yaw_rad)
    x, y, z = (float(value) for value in vector_m)
    return np.array([c * x - s * y, s * x + c * y, z])
