"""A hand that goes into the way of a moving arm, and what it does there; generators, each `yield` is a period."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Literal

import numpy as np

from bracket_ground.interfaces.pose import Array
from bracket_sim.scene.hand_motion import PEAK_TO_MEAN
from bracket_sim.scene.person import BesideRobot, bernoulli, sample
from bracket_sim.worker.hand_primitives import ARCH_M, RELAXED_GAP_M, HandPrimitives, Script
from bracket_sim.worker.worker_sight import Sight

ABOVE_M = 0.02  # of the fingertips over a part
BEHIND_M = np.array([[0.0, 0.0], [0.10, 0.0], [0.17, 0.0]])  # fingertips, palm and wrist, with the fingers along -x
HANGS_M = np.array([0.0, 0.03, 0.025])  # how much higher than the fingertips their undersides are
WIDE_M = 0.06  # half of a hand and half of a part
RISES_M_S = 1.0
Sequel = Literal["withdraw", "freeze", "pull"]
SHOULDER_M = (1.45, 0.14, 0.35)
ARM_LENGTH_M = 0.95
LOWEST_M = 0.05
LOOK_AHEAD_S = 0.6
PULL_M_S = 0.5
ACCELERATION_M_S2 = 12.0  # of a hand that is quick
GIVES_UP_S, THERE_M = 1.5, 0.015
HALF_HAND_M = 0.05  # what reaches the arm first is the middle of the hand, not the fingertips


class OverParts:
    """Lifts the places of one way; near its end the hand comes down as steeply as 45 degrees.

    Args:
        tops_m: (n, 3) of the parts that stand there.
        dt_s: from one place to the next.
    """

    def __init__(self, tops_m: Array, dt_s: float) -> None:
        self._tops_m, self._step_m = tops_m, RISES_M_S * dt_s
        self._lift_m = 0.0

    def lifted(self, place_m: Array, target_m: Array) -> Array:
        """The next place (3,) on the way to a target, as high as it must be, or as high as the hand can be by now."""
        wanted_m = max(0.0, self._least_m(place_m, target_m) - float(place_m[2]))
        self._lift_m += float(np.clip(wanted_m - self._lift_m, -self._step_m, self._step_m))
        lifted: Array = place_m + np.array([0.0, 0.0, self._lift_m])
        return lifted

    def _least_m(self, place_m: Array, target_m: Array) -> float:
        if not len(self._tops_m):
            return 0.0
        away_m = np.linalg.norm(place_m[:2] + BEHIND_M[:, None] - self._tops_m[:, :2], axis=2)
        beside_m = np.maximum(away_m - WIDE_M, 0.0)
        needed_m = self._tops_m[:, 2] + ABOVE_M - HANGS_M[:, None] - beside_m
        return min(float(needed_m.max()), float(target_m[2] + np.linalg.norm(target_m[:2] - place_m[:2])))


class Intrusion:
    """Sends the hand to where the arm's tool will be.

    Args:
        note: told each act by its name, with numbers.
    """

    def __init__(
        self,
        work: HandPrimitives,
        sight: Sight,
        habits: BesideRobot,
        rng: np.random.Generator,
        note: Callable[..., None],
    ) -> None:
        self._work, self._sight, self._habits = work, sight, habits
        self._rng, self._note = rng, note

    def script(self, sequel: Sequel | None = None, speed_m_s: float | None = None) -> Script:
        """Reach into the arm's way, stay, withdraw or pull, and come back to where the hand was.

        Args:
            sequel, speed_m_s: drawn from the person's habits where they are not given.
        """
        speed = sample(self._habits.intrusion_m_s, self._rng) if speed_m_s is None else speed_m_s
        sequel = self._draw_sequel() if sequel is None else sequel
        start_m, yaw_rad, gap_m = self._work.position_m, self._work.yaw_rad, self._work.gap_m
        chases = bernoulli(self._habits.chases, self._rng)
        self._note("intrude", speed_m_s=speed, chases=chases)
        yield from self._chase(speed) if chases else self._reach_into_way(speed)
        self._note(sequel)
        if sequel == "freeze":
            yield from self._work.wait(sample(self._habits.freeze_s, self._rng))
        elif sequel == "pull":
            yield from self._pull()
        yield from self._work.reach(start_m, yaw_rad, gap_m, arch_m=ARCH_M)
        self._note("back")

    def _draw_sequel(self) -> Sequel:
        chance = self._rng.random()
        if chance < self._habits.freezes:
            return "freeze"
        return "pull" if chance < self._habits.freezes + self._habits.pulls else "withdraw"

    def _reach_into_way(self, speed_m_s: float) -> Script:
        """One reach to where the tool will be when the hand arrives."""
        tool_m, velocity_m_s = self._sight.tool()
        far_m = float(np.linalg.norm(tool_m - self._work.position_m))
        arrives_s = min(PEAK_TO_MEAN * far_m / speed_m_s, LOOK_AHEAD_S)
        target_m = within_reach(tool_m + velocity_m_s * arrives_s - np.array([HALF_HAND_M, 0.0, 0.0]))
        duration_s = PEAK_TO_MEAN * float(np.linalg.norm(target_m - self._work.position_m)) / speed_m_s
        over = OverParts(self._sight.tops_m, self._work.dt_s)
        for _ in self._work.reach(target_m, 0.0, RELAXED_GAP_M, duration_s=duration_s):
            self._work.position_m = over.lifted(self._work.position_m, target_m)
            yield

    def _chase(self, speed_m_s: float) -> Script:
        """Go to where the tool is, wherever it goes, until the hand is there or gives up."""
        velocity, elapsed_s, dt_s = np.zeros(3), 0.0, self._work.dt_s
        place_m, over = self._work.position_m, OverParts(self._sight.tops_m, dt_s)
        while elapsed_s < GIVES_UP_S:
            tool_m, _ = self._sight.tool()
            target_m = within_reach(tool_m - np.array([HALF_HAND_M, 0.0, 0.0]))
            way_m = target_m - place_m
            far_m = float(np.linalg.norm(way_m))
            if far_m < THERE_M:
                return
            wanted = way_m / far_m * min(speed_m_s, math.sqrt(2 * ACCELERATION_M_S2 * far_m))
            change = wanted - velocity
            size = float(np.linalg.norm(change))
            velocity = velocity + change * min(1.0, ACCELERATION_M_S2 * dt_s / max(size, 1e-9))
            place_m = place_m + velocity * dt_s
            self._work.position_m = over.lifted(place_m, target_m)
            elapsed_s += dt_s
            yield

    def _pull(self) -> Script:
        """Pinch what is between the fingers now, pull it towards the person and let go."""
        tool_m, _ = self._sight.tool()
        yield from self._work.reach(within_reach(tool_m), 0.0, 0.08)
        yield from self._work.pinch(0.0)
        away_m = self._work.position_m + np.array([sample(self._habits.pull_m, self._rng), 0.0, 0.03])
        duration_s = PEAK_TO_MEAN * float(np.linalg.norm(away_m - self._work.position_m)) / PULL_M_S
        yield from self._work.reach(away_m, duration_s=duration_s)
        yield from self._work.pinch(0.08)


def within_reach(target_m: Array) -> Array:
    """The point (3,) nearest to the target that a seated person's fingertips reach, above the bench."""
    shoulder = np.array(SHOULDER_M)
    along = target_m - shoulder
    far_m = float(np.linalg.norm(along))
    point: Array = shoulder + along * min(1.0, ARM_LENGTH_M / max(far_m, 1e-9))
    point[2] = max(point[2], LOWEST_M)
    return point
