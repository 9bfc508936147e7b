"""Whether an arm obeys: standstill and speed along the path are measured, not only ordered.

After reaction and braking, played through as for separation, a held arm stands, and the way along its path grows by no
more than the allowed share. Safe operating stop and safe speed monitor as in IEC 61800-5-2; not safety-rated.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import get_args

import numpy as np
from numpy.typing import NDArray

from bracket_cell.skills.motion.separation import EPS, SEPARATION
from bracket_ground.files.words.message import Message
from bracket_ground.interfaces.command import JointTrajectory
from bracket_ground.interfaces.observation import LETS_GO, ArmMode, ArmState
from bracket_ground.interfaces.pose import Array
from bracket_ground.interfaces.robot import RobotModel


@dataclass(frozen=True)
class ArmLimits:
    """What a measured arm may do beside what its path says. Origin: chosen, and tried with simulated faults (`cell lab
    eval faults`).

    Attributes:
        brakes_at_least: share of the braking that is played through.
        speed_tolerance: share by which the way along the path may grow too fast.
        way_tolerance_s: [s] of the way along the path: a clock's jitter.
        way_tolerance_rad: [rad] of a joint along it: a servo's swing where it is held (.002 of a simulated UR10).
        settles_s: [s] in which a standing arm comes to rest.
        stays_rad: [rad] that a standing arm moves by a push.
        repeats_s: [s] in which a moving arm reports something new.
        stuck_s: [s] in which a moving arm goes on along its path.
        tells_s: [s] in which a moving arm may report the same with new stamps.
        lags_s: [s] in which an arm that may go on does so.
        lags_share: share of the allowed speed at which it then goes on.
        longest_s: [s] between two states that can be compared.
        jump_rad: [rad] by which a measurement may be off.
        range_slack_rad: [rad] beyond a joint's range that a measurement adds.
        speed_slack: times the robot's own speed that a measurement adds.
        speed_off_rad_s: [rad/s] by which reported speeds differ from measured ones.
        speed_off: share by which they differ.
        speeds_off: [states] in a row that differ by more.
        shakes_rad: [rad] within which an arm that stands shakes where it is rammed.
        rammed_off: [states] that differ meanwhile.
    """

    brakes_at_least: float = 0.8
    speed_tolerance: float = 1.03
    way_tolerance_s: float = 0.02
    way_tolerance_rad: float = 0.003
    settles_s: float = 0.12
    stays_rad: float = 0.08
    repeats_s: float = 0.1
    stuck_s: float = 0.24
    tells_s: float = 0.3
    lags_s: float = 1.0
    lags_share: float = 0.2
    longest_s: float = 0.2
    jump_rad: float = 0.02
    range_slack_rad: float = 0.01
    speed_slack: float = 1.3
    speed_off_rad_s: float = 0.1
    speed_off: float = 0.15
    speeds_off: int = 3
    shakes_rad: float = 0.01
    rammed_off: int = 24


ARM = ArmLimits()


MODES = get_args(ArmMode)
BRAKED = ("protective_stop", "recovery")  # what pushes an arm whose brakes are on may shake it


@dataclass(frozen=True)
class StopLimits:
    """What a stop may take at most, whatever braking is worked out.

    Attributes:
        time_s: until the arm stands.
        way_m: of the tool.
    """

    time_s: float = math.inf
    way_m: float = math.inf


@dataclass(eq=False)
class ArmMonitor:
    """Sees every state of the arm and every order to it.

    Attributes:
        reaction_s: from an order to the first braking.
        tool_m: where the tool is (3,), from joints.
        slow_share: of a path, the share of speed at which no link is faster than the slow speed.
        disobeys, implausible, lags: what is wrong now, in words; empty for nothing.
        repeats_s: since when a moving arm tells the same state.
    """

    robot: RobotModel = field(repr=False)
    reaction_s: float
    limits: StopLimits
    tool_m: Callable[[Array], Array]
    slow_share: Callable[[JointTrajectory], float]
    disobeys: str = field(default="", init=False)
    implausible: str = field(default="", init=False)
    lags: str = field(default="", init=False)
    repeats_s: float = field(default=0.0, init=False)
    _free_s: float = field(default=0.0, init=False)  # since when the arm may go on; how far it may, and did, since
    _due_s: float = field(default=0.0, init=False)
    _went_s: float = field(default=0.0, init=False)
    _now_s: float = field(default=-math.inf, init=False)
    _changed_s: float = field(default=-math.inf, init=False)
    _advanced_s: float = field(default=-math.inf, init=False)
    _arm: ArmState | None = field(default=None, init=False)
    _orders: deque[tuple[float, float]] = field(default_factory=deque, init=False)  # (since when, share)
    _rate: float = field(default=0.0, init=False)  # share of the planned speed that the arm may have at most
    _path: JointTrajectory | None = field(default=None, init=False)  # the last one
    _begun_s: float = field(default=-math.inf, init=False)
    _held_s: float = field(default=math.inf, init=False)
    _path_s: float | None = field(default=None, init=False)
    _allowed_s: float = field(default=0.0, init=False)
    _excess_s: float = field(default=0.0, init=False)
    _played_s: float = field(default=-math.inf, init=False)  # its way is reckoned until then: a state may be older
    _held_at_m: Array | None = field(default=None, init=False)
    _still_s: float = field(default=math.inf, init=False)
    _anchor: Array | None = field(default=None, init=False)
    _mismatches: NDArray[np.int64] = field(init=False)
    _from_rad: Array = field(init=False)  # where each joint was as its mismatches began

    def __post_init__(self) -> None:
        self._names = self.robot.joints
        self._mismatches = np.zeros(len(self._names), dtype=np.int64)
        self._from_rad = np.zeros(len(self._names))
        self._limits_rad = self.robot.limits_rad + np.array([[-ARM.range_slack_rad], [ARM.range_slack_rad]])
        self._speed_rad_s = np.array(self.robot.speed_rad_s) * ARM.speed_slack
        self._acceleration_rad_s2 = np.array(self.robot.acceleration_rad_s2)

    def see(self, now_s: float, arm: ArmState, share: float, path: JointTrajectory | None) -> None:
        """One more tick.

        Args:
            share, path: what was ordered in the tick before; no path for a stop.
        """
        if now_s == self._now_s:
            return
        self.implausible, self.disobeys = self._wrong(arm), ""
        if self.implausible:
            self._now_s = now_s
            return
        self._order(share if path is not None else 0.0, path)
        self._allowed_s += self._play(min(now_s, arm.time_s))
        self._now_s = now_s
        self.lags = self._lags(arm)
        self.disobeys = self._ahead(arm) or self._moves(arm) or self._stuck(arm, path)
        self._arm = arm

    def _order(self, share: float, path: JointTrajectory | None) -> None:
        """What was ordered at the end of the tick before."""
        self._held_s = math.inf if share > 0 else min(self._held_s, self._now_s)
        if path is not None and path is not self._path:
            self._path, self._begun_s, self._path_s, self._excess_s = path, self._now_s, None, 0.0
            self._still_s, self._anchor = math.inf, None
        if not self._orders or self._orders[-1][1] != share:
            self._orders.append((self._now_s, share))

    def _may(self, time_s: float) -> float:
        """The greatest share that was ordered within the reaction before a time."""
        while len(self._orders) > 1 and self._orders[1][0] <= time_s - self.reaction_s:
            self._orders.popleft()
        return max((share for begun_s, share in self._orders if begun_s <= time_s), default=self._orders[0][1])

    def _play(self, until_s: float) -> float:
        """How far along its path the arm may go until it was measured, as time of that path."""
        since_s, self._played_s = self._played_s, max(self._played_s, until_s)
        if self._arm is None or until_s <= since_s:
            return 0.0
        steps = max(1, min(math.ceil((until_s - since_s) / SEPARATION.play_s - EPS), 50))
        step_s, way_s = (until_s - since_s) / steps, 0.0
        for number in range(steps):
            time_s = since_s + (number + 1) * step_s
            most = self._may(time_s)
            if most < self._rate:
                most = max(most, self._rate - self._braking(way_s) * step_s)
            if time_s - self._held_s > self.limits.time_s:
                most = 0.0
            self._rate = most
            way_s += most * step_s
        return way_s

    def _braking(self, way_s: float) -> float:
        """By how much the share of speed falls in a second, where the arm is; as in separation."""
        if self._path is None:
            return math.inf
        place_s = (self._path_s or 0.0) + self._allowed_s + way_s
        before, here, after = self._path.along(place_s + np.array([-SEPARATION.mark_s, 0.0, SEPARATION.mark_s]))
        speeds, bends = (after - before) / (2 * SEPARATION.mark_s), (after - 2 * here + before) / SEPARATION.mark_s**2
        fastest = np.maximum(np.abs(speeds), EPS)
        limits = self._acceleration_rad_s2 / fastest
        least = SEPARATION.least_braking * float(limits.min())
        along = bends * np.sign(speeds) / fastest * self._rate**2
        return ARM.brakes_at_least * max(float((limits + along).min()), least)

    def _ahead(self, arm: ArmState) -> str:
        """The way along the path grew by more than it may."""
        silent = self._arm is not None and arm.time_s - self._arm.time_s > ARM.longest_s  # and heard no order meanwhile
        new = self._now_s - self._begun_s <= self.reaction_s + ARM.longest_s / 4
        if arm.path_s is None or not arm.moving or new or silent:
            self._path_s, self._allowed_s = arm.path_s, 0.0
            return self._too_far(arm)
        if self._arm is not None and arm.time_s == self._arm.time_s:  # nothing new
            return ""
        if self._path_s is not None:
            grew_s = arm.path_s - self._path_s
            self._excess_s = max(0.0, self._excess_s + grew_s - ARM.speed_tolerance * self._allowed_s)
        self._path_s, self._allowed_s = arm.path_s, 0.0
        if self._excess_s > ARM.way_tolerance_s and self._excess_rad(arm.path_s) > ARM.way_tolerance_rad:
            return Message(
                "the arm is {excess_s} s farther along its path than it may be", excess_s=f"{self._excess_s:.2f}"
            )
        return self._too_far(arm)

    def _excess_rad(self, path_s: float) -> float:
        """By how much a joint is farther than it may be; near rest that is little for much time of the path."""
        if self._path is None:
            return math.inf
        may, is_at = self._path.along(np.array([path_s - self._excess_s, path_s]))
        return float(np.abs(is_at - may).max())

    def _too_far(self, arm: ArmState) -> str:
        """The tool went farther than a stop may take."""
        if self._held_s == math.inf or self._still_s < self._now_s - ARM.settles_s:
            self._held_at_m = None
            return ""
        tool_m = self.tool_m(np.array(arm.positions_rad))
        self._held_at_m = tool_m if self._held_at_m is None else self._held_at_m
        way_m = float(np.linalg.norm(tool_m - self._held_at_m))
        if way_m <= self.limits.way_m:
            return ""
        return Message("the tool went {way_m} m since it was to stand", way_m=f"{way_m:.2f}")

    def _moves(self, arm: ArmState) -> str:
        """A joint moves although the arm must stand; in some modes somebody may move it."""
        if (self._rate > 0 and arm.moving) or arm.mode in LETS_GO:
            self._still_s, self._anchor = math.inf, None
            return ""
        self._still_s = min(self._still_s, self._now_s)
        if self._now_s - self._still_s < ARM.settles_s:
            return ""
        positions = np.array(arm.positions_rad)
        self._anchor = positions if self._anchor is None else self._anchor
        moved = np.abs(positions - self._anchor)
        joint = int(moved.argmax())
        if moved[joint] > ARM.stays_rad:
            return Message(
                "{joint} moved by {moved} rad, although the arm must stand",
                joint=self._names[joint],
                moved=f"{moved[joint]:.2f}",
            )
        return ""

    def _stuck(self, arm: ArmState, path: JointTrajectory | None) -> str:
        """A moving arm that may go on tells the same again and again, or does not go on."""
        same = self._arm is not None and (arm.path_s, arm.positions_rad) == (self._arm.path_s, self._arm.positions_rad)
        free = arm.moving and path is not None and min(share for _, share in self._orders) > 0
        took_s = 0.0 if self._arm is None else arm.time_s - self._arm.time_s
        silent, unseen = self._arm is not None and took_s == 0, took_s > ARM.longest_s
        if not same or silent or unseen or (not free and self.repeats_s < ARM.repeats_s):
            self._changed_s = self._now_s
        self.repeats_s = self._now_s - self._changed_s
        if self.repeats_s > ARM.tells_s:
            return Message("the arm moves and tells the same for {repeats_s} s", repeats_s=f"{self.repeats_s:.2f}")
        grows = self._arm is None or self._arm.path_s is None or arm.path_s is None or arm.path_s > self._arm.path_s
        if not free or grows or unseen:
            self._advanced_s = self._now_s
        if self._now_s - self._advanced_s > ARM.stuck_s:
            return Message(
                "the arm does not go on for {stuck_s} s, although it may and says that it moves", stuck_s=ARM.stuck_s
            )
        return ""

    def _lags(self, arm: ArmState) -> str:
        """The way along the path grows by much less than it may."""
        before, least = self._arm, min(share for _, share in self._orders)
        grew_s = -1.0
        if before is not None and before.path_s is not None and arm.path_s is not None:
            grew_s = arm.path_s - before.path_s
        if before is None or grew_s < 0 or not arm.moving or least == 0:  # or it is another path
            self._free_s = self._due_s = self._went_s = 0.0
            return ""
        took_s = arm.time_s - before.time_s
        self._free_s, self._due_s = self._free_s + took_s, self._due_s + least * took_s
        self._went_s += grew_s
        if self._free_s < ARM.lags_s:
            return self.lags
        share, self._free_s, self._due_s, self._went_s = self._went_s / self._due_s, 0.0, 0.0, 0.0
        if share >= ARM.lags_share:
            return ""
        return Message(
            "the arm goes at {share} % of the speed that it may: see the pendant's slider, and its driver's pace()",
            share=f"{100 * share:.1f}",
        )

    def _wrong(self, arm: ArmState) -> str:
        """What a sound arm cannot tell."""
        counts = len(arm.positions_rad), len(arm.velocities_rad_s)
        if counts != (len(self._names), len(self._names)):
            return Message(
                "the arm told {positions} positions and {speeds} speeds, not {wanted}",
                positions=counts[0],
                speeds=counts[1],
                wanted=len(self._names),
            )
        path_s = 0.0 if arm.path_s is None else arm.path_s
        if not all(map(math.isfinite, (*arm.positions_rad, *arm.velocities_rad_s, path_s))):
            return "the arm told a value that is not finite"
        positions, speeds = np.array(arm.positions_rad), np.array(arm.velocities_rad_s)
        if ((positions < self._limits_rad[0]) | (positions > self._limits_rad[1])).any():
            return "the arm told a joint beyond its range"
        if arm.mode not in BRAKED and (np.abs(speeds) > self._speed_rad_s).any():
            return "the arm told a joint faster than it can be"
        if path_s < 0:
            return "the arm told a place before the beginning of its path"
        if arm.mode not in MODES:
            return Message("the arm told a mode {mode} that there is not", mode=f"{arm.mode!r}")
        return self._contradicts(arm, positions, speeds)

    def _contradicts(self, arm: ArmState, positions: Array, speeds: Array) -> str:
        """Positions changed otherwise than the told speeds have it."""
        before = self._arm
        took_s = 0.0 if before is None else arm.time_s - before.time_s
        if before is None or not 0 <= took_s <= max(ARM.longest_s, self.reaction_s):
            return ""
        if took_s == 0 and before.positions_rad == arm.positions_rad:  # the same state again
            return ""
        moved = positions - np.array(before.positions_rad)
        far = np.abs(moved) - self._speed_rad_s * took_s
        if far.max() > ARM.jump_rad:
            joint = int(far.argmax())
            return Message(
                "{joint} jumped by {moved} rad in {took_s} s",
                joint=self._names[joint],
                moved=f"{moved[joint]:.2f}",
                took_s=f"{took_s:.2f}",
            )
        if arm.mode in BRAKED:
            self._mismatches[:] = 0
            return ""
        measured, reported = moved / max(took_s, EPS), (speeds + np.array(before.velocities_rad_s)) / 2
        limit = np.maximum(ARM.speed_off_rad_s, ARM.speed_off * np.maximum(np.abs(measured), np.abs(reported)))
        off = ((measured - reported) / limit).clip(-2.0, 2.0).astype(int)  # what is off twice as much counts twice
        self._from_rad = np.where(self._mismatches == 0, before.positions_rad, self._from_rad)
        self._mismatches = np.where(off * self._mismatches > 0, self._mismatches, 0) + off
        shakes = (np.abs(positions - self._from_rad) <= ARM.shakes_rad) & (self._rate == 0 or not arm.moving)
        left = np.where(shakes, ARM.rammed_off, ARM.speeds_off) - np.abs(self._mismatches)
        joint = int(left.argmin())
        if left[joint] > 0:
            return ""
        return Message(
            "{joint} moves at {measured} rad/s and tells {told} rad/s",
            joint=self._names[joint],
            measured=f"{measured[joint]:.2f}",
            told=f"{reported[joint]:.2f}",
        )
