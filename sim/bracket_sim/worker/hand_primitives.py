"""What a hand can do with parts: reach, grasp, carry, insert, let go, screw; generators, each `yield` is a period."""

from __future__ import annotations

import math
from collections.abc import Callable, Generator, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace

import numpy as np

from bracket_ground.interfaces.pose import Array
from bracket_ground.interfaces.product import Product
from bracket_ground.interfaces.solid import span_m
from bracket_sim.scene.hand import Hand
from bracket_sim.scene.hand_motion import at_pace, min_jerk, plan_reach
from bracket_sim.scene.person import HandOvers, Person, bernoulli, sample
from bracket_sim.worker.going_round import WAITS_S, GoingRound
from bracket_sim.worker.gripping import Gripping, fold_yaw, top_m, turn
from bracket_sim.worker.worker_sight import SeenPart, Sight

Script = Iterator[None]

CLEAR_M = 0.025  # between a carried part's peg and the tallest part in the bracket
HOVER_M = 0.03  # of the fingertips over a part before they close around it
RELAXED_GAP_M = 0.025
BEFORE_PART_M = 0.06  # in front of a part that is held out
BESIDE_FINGERS_M = 0.0275  # of the fingertips from the tool: half its fingers' width, and what is ahead of the pinch
GIVEN_M = 0.008  # of a part that is given ends so far beyond the tool, for the robot's fingers to hold
ROOM_M = 0.03  # of fingertips that work beside the robot's fingers, and do not touch them
DRAWN_BACK_M = (0.16, 0.10, 0.0)  # from an arm that gave a part
TIP_AHEAD_M = 0.006  # so far ahead of the pinch fingertips are as thick as at it, and hold an edge beside other fingers
TIP_M = 0.004  # of a part that must lie between fingertips
COMES_M = 0.012  # farther than an arm that holds on gives way to a pull
MOST_YAW_RAD = 1.3
BEFORE_HOLE_M = 0.012  # of the peg's tip over the plate before the insertion
PRESS_M = 0.001
NOT_IN_M = 0.004  # a body this far above its place has not gone in
SEARCH_M, SEARCH_S, SEARCH_HZ = 0.0025, 1.2, 2.5
FINGERS_S, LOOK_S = 0.25, 0.12
BACK_OFF_M = 0.07
CAREFUL, STEADY = 0.45, 0.7  # haste
ARCH_M = 0.04
TOOL_M = 0.068  # from the fingertips to the end of a tool
TOOL_PRESS_M = 0.001  # how far the hand goes on when the tool meets the part: 8 N
TAKE_TOOL_S = 0.4
SCREW_EASE_S = 0.4


@dataclass(frozen=True)
class ScrewMotion:
    """A small circle of the fingertips with a turn of the wrist."""

    duration_s: float
    rate_hz: float
    radius_m: float
    yaw_rad: float


class HandPrimitives:
    """Runs one hand; owns what is commanded: position, yaw and gap.

    Attributes:
        position_m, yaw_rad, gap_m: commanded to the hand at the end of each period.
        wrist_rad: tilt, roll and curl (3,), commanded with them.
        tool_out: there is a tool in the hand.
        forceful: it goes into the arm's way, and does not give way.
        pace: how fast this person is, as a factor.
        clear_height_m: of a carried body's bottom, at which it passes over everything in the bracket.
        dt_s: length of a period.
    """

    def __init__(
        self,
        hand: Hand,
        sight: Sight,
        product: Product,
        person: Person,
        rng: np.random.Generator,
        chance: np.random.Generator,
        turned_rad: float = 0.0,
        minds_arm: bool = True,
    ) -> None:
        self._hand = hand
        self._round = GoingRound(hand, sight, turned_rad, minds_arm)
        self._meant = self.forceful = False
        self._room, self._waits = True, False  # for the hand where it is going; it waits for that
        self._sight = sight
        self._product = product
        self._rng, self._chance = rng, chance
        self.become(person)
        kinds = product.parts.values()
        top_m = max(float(hole[2]) for hole in sight.holes_m.values())
        self.clear_height_m = (
            top_m + max(kind.size_m[2] for kind in kinds) + max(kind.peg_length_m for kind in kinds) + CLEAR_M
        )
        self.dt_s = 0.0
        self.position_m = hand.position_m
        self.yaw_rad = hand.yaw_rad
        self.gap_m = RELAXED_GAP_M
        self.wrist_rad = np.zeros(3)
        self.tool_out = False

    def become(self, person: Person) -> None:
        """From now on the hand is this person's."""
        self.pace = sample(person.pace, self._chance)
        self._motion = at_pace(person.motion, self.pace)
        self._gripping = Gripping(self._hand, self._product, person.grip, self._chance)

    def send(self) -> None:
        """Command the hand."""
        grasp = self._gripping.style.grasp
        meant = self._meant or self.forceful
        self._round.update(self.position_m, self.yaw_rad, self.dt_s, meant=meant, room=self._room, waits=self._waits)
        goal_m = self._round.goes_to(self.position_m, not self.forceful)
        self._hand.command(goal_m, self.yaw_rad, self.gap_m, *self.wrist_rad, tool=self.tool_out, grasp=grasp)

    @contextmanager
    def at_arm(self) -> Iterator[None]:
        """Meanwhile the hand goes to the arm on purpose, and not round it."""
        was, self._meant = self._meant, True
        try:
            yield
        finally:
            self._meant = was

    def wait(self, duration_s: float) -> Script:
        """Stay for a while."""
        elapsed_s = 0.0
        while elapsed_s < duration_s:
            elapsed_s += self.dt_s
            yield

    def reach(
        self,
        target_m: Array,
        yaw_rad: float | None = None,
        gap_m: float | None = None,
        *,
        arch_m: float = 0.0,
        haste: float = 1.0,
        duration_s: float | None = None,
        wrist_rad: tuple[float, float, float] | None = None,
    ) -> Script:
        """One reach; wrist and fingers move along with it. It takes as long as is drawn, or as it is told.

        An arm that stands where the hand is going is waited for, out of its way, but not for ever.
        """
        goes, waited_s = self.yaw_rad if yaw_rad is None else yaw_rad, 0.0
        if not self._room and self._round.in_the_way(self.position_m, self.yaw_rad):
            waited_s = WAITS_S
        while not (self._meant or self.forceful) and waited_s < WAITS_S and self._round.in_the_way(target_m, goes):
            waited_s += self.dt_s
            self._room = self._waits = True
            yield
        self._room, self._waits = waited_s < WAITS_S, False
        path = plan_reach(self.position_m, target_m, self._motion, self._rng, arch_m=arch_m, haste=haste)
        if duration_s is not None:
            path = replace(path, duration_s=max(duration_s, self.dt_s), skew=0.0)
        yaw_from, gap_from = self.yaw_rad, self.gap_m
        yaw_by = 0.0 if yaw_rad is None else yaw_rad - yaw_from
        gap_by = 0.0 if gap_m is None else gap_m - gap_from
        wrist_from = self.wrist_rad
        wrist_by = np.zeros(3) if wrist_rad is None else np.array(wrist_rad) - wrist_from
        elapsed_s = 0.0
        while elapsed_s < path.duration_s:
            elapsed_s += self.dt_s * self._round.care
            done = min_jerk(min(elapsed_s / path.duration_s, 1.0))
            self.position_m, self.wrist_rad = path.at(elapsed_s), wrist_from + done * wrist_by
            self.yaw_rad, self.gap_m = yaw_from + done * yaw_by, gap_from + done * gap_by
            yield

    def grasp(self, seen: SeenPart, *, at_end: bool = False) -> Script:
        """Reach over a standing part, close the fingers around its end, for another's fingers the very end; lift it."""
        self._gripping.another()
        yaw_rad = fold_yaw(seen.pose.yaw_rad)
        grip_m, across_m, top_m = self._gripping.around(seen, yaw_rad)
        if at_end:
            end_m = self._product.parts[seen.part].size_m[0] / 2 - self._gripping.place(seen.part)[0][0]
            grip_m += turn(yaw_rad, np.array([max(end_m - TIP_M, 0.0), 0.0, 0.0]))
        over_m = np.array([grip_m[0], grip_m[1], top_m + HOVER_M])
        style = self._gripping.style
        wrist_rad = (style.tilt_rad, style.roll_rad, style.curl_rad)
        yield from self.reach(over_m, yaw_rad, across_m + style.open_m, arch_m=ARCH_M, wrist_rad=wrist_rad)
        yield from self.reach(grip_m, haste=STEADY)
        yield from self.pinch(self._gripping.closed_m(seen.part))
        yield from self.wait(LOOK_S)
        if self.holds(seen.body):
            lift_m = max(self.clear_height_m - seen.pose.position_m[2], 0.02)
            yield from self.reach(self.position_m + np.array([0.0, 0.0, lift_m]), haste=STEADY)

    def take_over(self, seen: SeenPart, habits: HandOvers) -> Script:
        """Take a part that the robot holds out: from the front, and pull until it comes, but not for ever."""
        self._gripping.another()
        grip_m, yaw_rad, across_m = self._beside_fingers(seen)
        back_m = turn(yaw_rad, np.array([BEFORE_PART_M, 0.0, 0.0]))
        before_m = grip_m + (3 * back_m if self._sight.arm_moving else back_m)
        yield from self.reach(before_m, yaw_rad, across_m + self._gripping.style.open_m, arch_m=ARCH_M)
        waited_s = 0.0
        while self._sight.arm_moving and waited_s < habits.holds_on_s:
            waited_s += self.dt_s
            yield
        grip_m, yaw_rad, _ = self._beside_fingers(self._sight.part(seen.body))
        yield from self.reach(grip_m + back_m, yaw_rad, haste=STEADY)
        yield from self.reach(grip_m, haste=STEADY)
        yield from self.pinch(self._gripping.closed_m(seen.part))
        yield from self.wait(sample(habits.waits_s, self._chance))
        if bernoulli(habits.pulls, self._chance) and (yield from self._pulled(back_m, habits)):
            yield from self.reach(self.position_m + back_m, haste=STEADY)
            yield from self._draw_back(habits.stands_back_s)
        else:
            yield from self.let_go(seen.part)
            yield from self.reach(self.position_m + 2 * back_m, haste=STEADY)

    def _beside_m(self, seen: SeenPart, grip_m: Array, wanted_m: float) -> float:
        """How far ahead of a grip (3,) to pinch, to be beside the robot's fingers: as far as there is part."""
        x, _, z = seen.pose.inverse().transform(grip_m)
        solids = self._product.parts[seen.part].solids
        ahead = 1.0 if abs(fold_yaw(seen.pose.yaw_rad) - seen.pose.yaw_rad) < 1.0 else -1.0
        for beside_m in np.arange(max(wanted_m, 0.0), 0.0, -TIP_M):
            at = x + ahead * beside_m
            tip, back = sorted((at - ahead * TIP_AHEAD_M, at + ahead * TIP_M))
            low_m, high_m = span_m(solids, 1, {0: (tip, back), 2: (z, z)}) or (0.0, 0.0)
            if high_m - low_m > self._gripping.closed_m(seen.part):
                return float(beside_m)
        return 0.0

    def _beside_fingers(self, seen: SeenPart) -> tuple[Array, float, float]:
        """Where to pinch a part beside the robot's fingers, how the hand is turned then, how wide the part is there."""
        yaw_rad = fold_yaw(seen.pose.yaw_rad)
        grip_m, across_m, _ = self._gripping.around(seen, yaw_rad)
        ahead_m = float((grip_m - self._sight.tool()[0]) @ turn(yaw_rad, np.array([1.0, 0.0, 0.0])))
        beside_m = self._beside_m(seen, grip_m, BESIDE_FINGERS_M - ahead_m)
        return grip_m + turn(yaw_rad, np.array([beside_m, 0.0, 0.0])), yaw_rad, across_m

    def reach_beside(self, seen: SeenPart) -> Script:
        """Bring the fingertips to the front of a part that the robot holds in its hole, where they have room."""
        grip_m, yaw_rad, _ = self._beside_fingers(seen)
        ahead_m = turn(yaw_rad, np.array([ROOM_M, 0.0, 0.0]))
        yield from self.reach(grip_m + 3 * ahead_m, yaw_rad, RELAXED_GAP_M, arch_m=ARCH_M)
        yield from self.reach(grip_m + ahead_m, haste=STEADY)

    def _draw_back(self, longest_s: float) -> Script:
        """Out of the way of an arm that is held out, until it has gone."""
        yield from self.reach(self.position_m + np.array(DRAWN_BACK_M))
        waited_s = 0.0
        while waited_s < longest_s and self._sight.held_out_m(brought=True) is not None:
            waited_s += self.dt_s
            yield

    def _pulled(self, way_m: Array, habits: HandOvers) -> Generator[None, None, bool]:
        """Pull along a way (3,) ever harder; returns whether the part, or the hand without it, came."""
        pull_m = sample(habits.pull_n, self._chance) / self._hand.stiffness_n_m
        rises_s, along = sample(habits.pull_s, self._chance), way_m / np.linalg.norm(way_m)
        start_m, was_m, elapsed_s = self.position_m, self._hand.position_m, 0.0
        while elapsed_s < rises_s + habits.holds_on_s:
            elapsed_s += self.dt_s
            came_m = float((self._hand.position_m - was_m) @ along)
            self.position_m = start_m + along * (came_m + pull_m * min(elapsed_s / rises_s, 1.0))
            if came_m > COMES_M:
                return True
            yield
        self.position_m = start_m
        return False

    def give(
        self, body: str, tool_m: Array, taken: Callable[[], bool], longest_s: float
    ) -> Generator[None, None, bool]:
        """Bring a held part between open fingers, from the front, and let go once they are closed on it.

        Args:
            tool_m: (3,) between the fingers.
        """
        target_m = self._between_fingers(body, tool_m)
        before_m = target_m + np.array([2 * BEFORE_PART_M, 0.0, 0.0])
        yield from self.reach(*self._hand_for(body, before_m), arch_m=ARCH_M / 2)
        yield from self.wait(LOOK_S)
        yield from self.reach(*self._hand_for(body, target_m), haste=CAREFUL)
        waited_s = 0.0
        while waited_s < longest_s and not taken():
            waited_s += self.dt_s
            yield
        if given := taken():
            yield from self.let_go(self._sight.part(body).part)
        yield from self.reach(self.position_m + np.array([2 * BEFORE_PART_M, 0.0, 0.0]), haste=STEADY)
        return given

    def _between_fingers(self, body: str, tool_m: Array) -> Array:
        """Where a held part's bottom goes (3,), for open fingers to close on it beside the own ones."""
        length_m, _, height_m = self._product.parts[self._sight.part(body).part].size_m
        target_m: Array = tool_m - np.array([0.0, 0.0, height_m / 2])
        ahead_m = float((self._hand_for(body, target_m)[0] - tool_m)[0])
        target_m[0] += np.clip(BESIDE_FINGERS_M - ahead_m, 0.0, max(length_m / 2 - GIVEN_M, 0.0))
        return target_m

    def pinches(self, body: str) -> bool:
        """Whether the fingers are closed around a part."""
        return self._gripping.closed_around(self._sight.part(body))

    def holds(self, body: str) -> bool:
        """Whether a part is between the fingers."""
        return self._gripping.holds(self._sight.part(body))

    def carry(self, body: str, target_m: Array) -> Script:
        """Bring a held part over its target."""
        clear_m = np.array([target_m[0], target_m[1], self.clear_height_m])
        yield from self.reach(*self._hand_for(body, clear_m), arch_m=ARCH_M / 2)

    def insert(self, body: str, target_m: Array) -> Script:
        """Lower a held part to its target (the body's bottom), search a little where the peg meets no hole."""
        peg_m = self._product.parts[self._sight.part(body).part].peg_length_m
        before_m = target_m + np.array([0.0, 0.0, peg_m + BEFORE_HOLE_M])
        yield from self.reach(*self._hand_for(body, before_m), haste=STEADY)
        yield from self.wait(LOOK_S)
        yield from self.reach(*self._hand_for(body, before_m), haste=CAREFUL)
        yield from self.reach(*self._hand_for(body, target_m - np.array([0.0, 0.0, PRESS_M])), haste=CAREFUL)
        if self._sight.part(body).pose.position_m[2] > target_m[2] + NOT_IN_M:
            yield from self._search()

    def pinch(self, gap_m: float) -> Script:
        """Move the fingers to a gap."""
        gap_from, elapsed_s = self.gap_m, 0.0
        duration_s = FINGERS_S / min(self.pace, 1.0)
        while elapsed_s < duration_s:
            elapsed_s += self.dt_s
            self.gap_m = gap_from + min_jerk(min(elapsed_s / duration_s, 1.0)) * (gap_m - gap_from)
            yield

    def let_go(self, part: str) -> Script:
        """Open the fingers."""
        yield from self.pinch(self._gripping.opened_m(part))

    def back_off(self) -> Script:
        """Move the fingers up and away towards the person, and put a tool away."""
        away_m = turn(self.yaw_rad, np.array([BACK_OFF_M, 0.0, BACK_OFF_M]))
        yield from self.reach(self.position_m + away_m, 0.0, haste=STEADY, wrist_rad=(0.0, 0.0, 0.0))
        self.tool_out = False

    def reach_over(self, seen: SeenPart, height_m: float, *, tool: bool) -> Script:
        """Bring the fingertips, or the tool's end, over a placed part, where they screw, or down on it."""
        part = self._product.parts[seen.part]
        self._gripping.another()
        pinch_m = self._gripping.place(seen.part)[0]
        place_m = np.array(seen.pose.position_m) + np.array([pinch_m[0], pinch_m[1], part.size_m[2] + height_m])
        if not tool:
            yield from self.reach(place_m, 0.0, RELAXED_GAP_M, arch_m=ARCH_M / 2)
            return
        over_m = np.array([place_m[0], place_m[1], self.clear_height_m + TOOL_M])
        yield from self.reach(over_m, 0.0, RELAXED_GAP_M, arch_m=ARCH_M / 2)
        self.tool_out = True
        yield from self.wait(TAKE_TOOL_S)
        place_m[2] = seen.pose.position_m[2] + top_m(part, pinch_m[0]) + TOOL_M - TOOL_PRESS_M
        yield from self.reach(place_m, haste=CAREFUL)

    def screw(self, motion: ScrewMotion, stop: Callable[[], bool]) -> Script:
        """Circle where the fingertips or the tool are until the time is up or `stop` says so."""
        centre_m, elapsed_s = self.position_m, 0.0
        while elapsed_s < motion.duration_s and not stop():
            elapsed_s += self.dt_s
            ease = min(1.0, elapsed_s / SCREW_EASE_S, max(motion.duration_s - elapsed_s, 0.0) / SCREW_EASE_S)
            phase = 2 * math.pi * motion.rate_hz * elapsed_s
            circle = np.array([math.cos(phase), math.sin(phase), 0.0])
            self.position_m = centre_m + ease * motion.radius_m * circle
            self.yaw_rad = ease * motion.yaw_rad * math.sin(phase)
            yield

    def _hand_for(self, body: str, target_m: Array) -> tuple[Array, float]:
        return self._gripping.hand_for(self._sight.part(body).pose, target_m)

    def _search(self) -> Script:
        """Press on and move in a growing circle."""
        centre_m, elapsed_s = self.position_m, 0.0
        while elapsed_s < SEARCH_S:
            elapsed_s += self.dt_s
            phase = 2 * math.pi * SEARCH_HZ * elapsed_s
            radius_m = SEARCH_M * min(elapsed_s / SEARCH_S, 1.0)
            self.position_m = centre_m + radius_m * np.array([math.cos(phase), math.sin(phase), 0.0])
            yield
