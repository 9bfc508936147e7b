"""Where a hand pinches a part, and how: style of the grip, place on the part, place of the hand for a held part."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cache, lru_cache

import numpy as np

from bracket_ground.interfaces.pose import Array, Pose
from bracket_ground.interfaces.product import PartType, Product
from bracket_ground.interfaces.solid import span_m
from bracket_sim.scene.hand import Hand
from bracket_sim.scene.human_hand import Grasp
from bracket_sim.scene.person import Grip, sample
from bracket_sim.worker.worker_sight import SeenPart

HEIGHT_M = (0.010, 0.035)  # least and most above the body's bottom, else half its height
FROM_BOTTOM_M, FROM_TOP_M = 0.008, 0.004  # the same where a part is taken at any height
FROM_END = 0.16  # of the body's length, so that the part protrudes ahead of the fingertips
LENGTH_M = 0.012  # of the fingers, ahead of and behind the pinch, that lies against the part
STEP_M = 0.001
TIP_M = 0.003  # radius of a tool's tip
SQUEEZE_M = 0.016  # commanded below the part's width: 20 N a finger
LOST_GRIP_M = 0.006  # gap this far below the part's width: nothing is between the fingers
LOST_PART_M = 0.07
CLOSED_M = 0.002  # gap this far above the part's width: the fingers lie against it


@cache
def widest_near_end(part: PartType) -> tuple[tuple[float, float, float], float]:
    """A place near the part's end, at the height where it is widest, the nearest to half its height.

    Returns:
        The place in the part's frame and how wide the part is there, in [m].
    """
    length_m, _, height_m = part.size_m
    low_m, high_m = HEIGHT_M
    return _widest(part, length_m * (0.5 - FROM_END), min(max(height_m / 2, low_m), high_m), HEIGHT_M)


@lru_cache(maxsize=512)
def widest(part: PartType, from_middle_m: float) -> tuple[tuple[float, float, float], float]:
    """The same at a distance from the part's middle, at any height."""
    length_m, _, height_m = part.size_m
    x_m = min(from_middle_m, length_m * (0.5 - FROM_END))
    return _widest(part, x_m, height_m / 2, (FROM_BOTTOM_M, height_m - FROM_TOP_M))


@lru_cache(maxsize=512)
def top_m(part: PartType, from_middle_m: float) -> float:
    """How high the part reaches above its bottom on its long axis, where a tool's tip comes down."""
    window = (from_middle_m - TIP_M, from_middle_m + TIP_M)
    _, high = span_m(part.solids, 2, {0: window, 1: (-TIP_M, TIP_M)}) or (0.0, part.size_m[2])
    return high


def _widest(
    part: PartType, x_m: float, middle_m: float, heights_m: tuple[float, float]
) -> tuple[tuple[float, float, float], float]:
    low_m, high_m = heights_m
    along = (x_m - LENGTH_M, x_m + LENGTH_M)
    steps = np.arange(round((low_m - middle_m) / STEP_M), round((high_m - middle_m) / STEP_M) + 1)
    best_m, widest_m = middle_m, 0.0
    for step in sorted(steps, key=abs):
        z_m = middle_m + float(step) * STEP_M
        low, high = span_m(part.solids, 1, {0: along, 2: (z_m, z_m)}) or (0.0, 0.0)
        if high - low > widest_m + 1e-9:
            best_m, widest_m = z_m, high - low
    return (x_m, 0.0, best_m), widest_m or part.size_m[1]


@dataclass(frozen=True)
class GripStyle:
    """How one part is gripped; see `Grip`."""

    tilt_rad: float
    roll_rad: float
    curl_rad: float
    from_middle_m: float | None
    open_m: float
    grasp: Grasp


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
        self._grasps = chance.spawn(1)[0]  # of its own: what else is drawn is the same for a hand of any shape
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
            tilt_rad=sample(habits.tilt_rad, self._chance),
            roll_rad=sample(habits.roll_rad, self._chance),
            curl_rad=sample(habits.curl_rad, self._chance),
            from_middle_m=None if habits.from_middle_m is None else sample(habits.from_middle_m, self._chance),
            open_m=sample(habits.open_m, self._chance),
            grasp=habits.grasps[int(self._grasps.integers(len(habits.grasps)))],
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
