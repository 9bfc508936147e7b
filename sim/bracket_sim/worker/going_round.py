"""How a person minds the robot: goes round an arm that stands, on the own side, and gives way where it is touched.

People keep some centimetres between a reaching hand and what stands beside its way, and slow down there (Dean and
Brüwer, Exp. Brain Res. 97, 1994). A touch that nobody meant is answered after about 0.15 s (Woodworth and Schlosberg,
Experimental Psychology, 1954); until then an arm whose muscles rest is a spring of some 400 N/m (Mussa-Ivaldi, Hogan
and Bizzi, J. Neurosci. 5, 1985), which a reach of 0.65 m/s has then drawn by 0.1 m: 40 N.
"""

from __future__ import annotations

import math

import numpy as np

from bracket_ground.interfaces.pose import Array
from bracket_sim.scene.hand import SLEEVE, WRIST, Hand
from bracket_sim.worker.worker_sight import Sight

CLEAR_M, SLOW_M = 0.03, 0.10  # between hand and arm: never less, and from here on slower
ASIDE_M_S, MOST_ASIDE_M = 0.5, 0.25
WAITS_S, PAUSES_S, SLOWEST = 20.0, 3.0, 0.2  # for room at the target, for a way round, and how it goes on then
REACTS_S, CALM_S, YIELDS_N = 0.15, 0.3, 40.0
SHARES = np.linspace(0.0, 1.0, 4)[1:, None]
TIPS = np.array([[0.0, 0.0, 0.0], [0.05, 0.0, 0.025], [0.108, 0.037, 0.05], WRIST[1]])
POINTS_M: Array = np.vstack([TIPS, np.array(WRIST[1]) + SHARES * (np.array(SLEEVE[1]) - np.array(WRIST[1]))])
RADII_M: Array = np.array([0.025, 0.03, 0.05, 0.036, 0.036, 0.036, 0.036])
LINK_M = 0.055  # half of a gripper's or a wrist's width


class GoingRound:
    """Where the hand goes instead of where it wants to.

    Attributes:
        aside_m: how far it is beside that, towards the person.
        care: how much slower than it wants to it moves on; 0 where it waits.

    Args:
        turned_rad: over which edge the person stands, see `OtherHand`.
        minds: it goes round at all; where nothing touches, as without physics, nobody needs to.
    """

    def __init__(self, hand: Hand, sight: Sight, turned_rad: float, minds: bool) -> None:
        self._hand, self._sight, self._minds = hand, sight, minds
        self._outwards: Array = np.array([math.cos(turned_rad), math.sin(turned_rad), 0.0])
        self._touched_s, self._calm_s, self._stopped_s, self._apart_s = 0.0, CALM_S, 0.0, CALM_S
        self.aside_m, self.care = 0.0, 1.0

    def in_the_way(self, target_m: Array, yaw_rad: float) -> bool:
        """Whether an arm that stands leaves the hand no room at a target (3,)."""
        return self._gap_m(target_m, yaw_rad, 0.0) < CLEAR_M

    def update(self, wanted_m: Array, yaw_rad: float, dt_s: float, *, meant: bool, room: bool, waits: bool) -> None:
        """One more period.

        Args:
            wanted_m: (3,) of the fingertips.
            meant: the hand is at the arm on purpose.
            room: there is room for the hand where it is going.
            waits: until there is, it stands back, which lets the arm go.
        """
        touched = self._hand.touches_robot
        self._touched_s = self._touched_s + dt_s if touched else 0.0
        self._apart_s = 0.0 if touched else self._apart_s + dt_s
        self._calm_s = 0.0 if self._touched_s > REACTS_S else self._calm_s + dt_s
        step_m, gap_m = ASIDE_M_S * dt_s, self._gap_m(wanted_m, yaw_rad, self.aside_m)
        blocked = not meant and (waits or self._calm_s < CALM_S or gap_m < CLEAR_M)
        less_m, more_m = max(self.aside_m - step_m, 0.0), min(self.aside_m + step_m, MOST_ASIDE_M)
        if meant or not room:
            self.aside_m = less_m
        elif blocked and self._gap_m(wanted_m, yaw_rad, more_m) > (min(gap_m, CLEAR_M) if waits else gap_m):
            self.aside_m = more_m
        elif not blocked and self._gap_m(wanted_m, yaw_rad, less_m) > CLEAR_M:
            self.aside_m = less_m
        self._stopped_s = self._stopped_s + dt_s if blocked else 0.0
        slow = 1.0 if meant else min(max((gap_m - CLEAR_M) / (SLOW_M - CLEAR_M), SLOWEST), 1.0)
        self.care = 0.0 if blocked and room and self._stopped_s < PAUSES_S else slow

    def goes_to(self, wanted_m: Array, gently: bool) -> Array:
        """Where the hand is commanded to (3,): no harder against the robot than a surprised person presses.

        Nor is it thrown at the robot again where it came off.
        """
        goal_m = wanted_m + self.aside_m * self._outwards
        if not (gently and self._apart_s < CALM_S):
            return goal_m
        ahead_m = goal_m - self._hand.position_m
        most_m = YIELDS_N / self._hand.stiffness_n_m
        pressed: Array = self._hand.position_m + ahead_m * min(1.0, most_m / max(float(np.linalg.norm(ahead_m)), 1e-9))
        return pressed

    def _gap_m(self, wanted_m: Array, yaw_rad: float, aside_m: float) -> float:
        """Between the hand, were it there, and an arm that stands, or stood as it was gone round; else infinite."""
        if not (self._minds and self._sight.has_arm) or (
            self._sight.arm_moving and not (self.aside_m or self._stopped_s)
        ):
            return math.inf
        links_m = self._sight.links_m
        cosine, sine = math.cos(yaw_rad), math.sin(yaw_rad)
        turned = POINTS_M @ np.array([[cosine, sine, 0.0], [-sine, cosine, 0.0], [0.0, 0.0, 1.0]])
        points_m = wanted_m + aside_m * self._outwards + turned
        start, along = links_m[:-1], np.diff(links_m, axis=0)
        from_start = points_m[:, None] - start
        lengths = np.maximum((along**2).sum(axis=1), 1e-12)
        share = np.clip((from_start * along).sum(axis=2) / lengths, 0.0, 1.0)
        away = np.linalg.norm(from_start - share[..., None] * along, axis=2).min(axis=1)
        return float((away - RADII_M).min()) - LINK_M
