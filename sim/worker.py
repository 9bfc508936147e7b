"""The simulated person at the bench: fetches parts, places and screws them, and waits while the robot works.

The behaviour is a script of generators: each `yield` lets one control period pass. The person knows the goal and sees
the bench as it is; parts are carried by friction alone.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Generator
from dataclasses import dataclass
from typing import Literal

import numpy as np

from cell.interfaces.bench import Bench
from cell.interfaces.command import Display
from cell.interfaces.perception import ActionKind
from cell.interfaces.pose import Array
from cell.interfaces.product import Product
from cell.interfaces.truth import TruthEvent
from sim.hand import Hand, hand_rest_m
from sim.handwork import ARCH_M, MOST_YAW_RAD, RELAXED_GAP_M, Handwork, ScrewMotion, Script, fold_yaw
from sim.intrusion import Intrusion, Sequel
from sim.person import Person, drawn
from sim.worker_sight import GRASPABLE_TILT_RAD, SeenPart, Sight, WorkerWorld

BEHIND_BRACKET_M = 0.26  # where the hand waits with a part while the arm is over the bracket
AT_REST_M = 0.02
OVER = object()
PUNCTUATION = str.maketrans(",.;:()", "      ")


@dataclass(frozen=True)
class ActionEvent:
    """Truth for labelling: an action of the hand begins or ends.

    Attributes:
        part, position: of an assembly action, which lasts from grasp to release.
    """

    time_s: float
    kind: ActionKind
    edge: Literal["start", "end"]
    part: str | None = None
    position: str | None = None


class Worker:
    """Moves the hand, and implements `Panel`: a person who sees guidance and help requests.

    Attributes:
        hand: where it is, for labels.
        events: what the hand did so far, in order.
        acts: what the person did besides, mistakes and bad habits among it, in order.
        done: nothing is left that the person can do now, and the hand rests.

    Args:
        rng: for motions and order.
        chance: for what not every person does; apart, so that it does not change the rest.
    """

    def __init__(
        self,
        world: WorkerWorld,
        product: Product,
        bench: Bench,
        person: Person,
        goal: str,
        rng: np.random.Generator,
        chance: np.random.Generator | None = None,
    ) -> None:
        self._person = person
        self._rng = rng
        self._sight = Sight(world, product, bench)
        self.hand = Hand(world.model, world.data)
        self._work = Handwork(self.hand, self._sight, product, person.motion, rng)
        self._rest_m = np.array(hand_rest_m(bench))
        self._behind_m = bench.bracket.position_m[0] + BEHIND_BRACKET_M
        self._wanted = product.goal_placements(goal)
        self._order = list(product.positions)
        if person.order == "random":
            self._order = [self._order[index] for index in rng.permutation(len(self._order))]
        self._tries = dict.fromkeys(product.positions, 0)
        self._unscrewed = 0
        self._request: str | None = None
        self._answered: str | None = None
        self._time_s = 0.0
        self._action: tuple[ActionKind, str | None, str | None] | None = None
        self._chance = chance or np.random.default_rng(0)
        self._intrusion = Intrusion(self._work, self._sight, person.robot, self._chance, self._note)
        self._intruding: Script | None = None
        self._script = self._assemble()
        self._told = 0, 0
        self.events: list[ActionEvent] = []
        self.acts: list[TruthEvent] = []
        self.done = False

    def show(self, display: Display) -> None:
        """The person reads the panel; a help request that is new gets them going at once."""
        self._request = display.help_request
        if self._request is None:
            self._answered = None

    def alarm(self, text: str) -> None:
        """The person goes on: what troubles the cell does not trouble their work."""

    def update(self, time_s: float, dt_s: float) -> None:
        """Let one control period pass."""
        self._time_s, self._work.dt_s = time_s, dt_s
        if self._intruding is None and self._tempted(dt_s):
            self.intrude()
        if self._intruding is None or next(self._intruding, OVER) is OVER:
            self._intruding = None
            next(self._script, None)
        self._work.send()

    def intrude(self, sequel: Sequel | None = None, speed_m_s: float | None = None) -> None:
        """Go into the arm's way now, whatever the hand was doing; what is not given is drawn from the habits."""
        if self._intruding is None and self._sight.has_arm:
            self._intruding = self._intrusion.script(sequel, speed_m_s)

    @property
    def intruding(self) -> bool:
        """Whether the hand is in the arm's way on purpose, or on its way there or back."""
        return self._intruding is not None

    def news(self) -> list[TruthEvent]:
        """Actions and acts since the last call, in order."""
        actions, acts = self.events[self._told[0] :], self.acts[self._told[1] :]
        self._told = len(self.events), len(self.acts)
        return sorted([*map(_truth, actions), *acts], key=lambda event: event.time_s)

    def _tempted(self, dt_s: float) -> bool:
        """Whether the hand goes into the arm's way in this period: the arm moves, and the hand is free."""
        often = self._person.robot.intrusions_per_min
        if not often or not self._sight.arm_moving or self._action is None or self._action[0] == "assembly":
            return False
        return self._chance.random() < often / 60 * dt_s

    def _polite(self) -> bool:
        """Whether the person waits for the arm this time."""
        share = self._person.robot.waits
        polite = share >= 1 or self._chance.random() < share
        if not polite:
            self._note("does not wait")
        return polite

    def _note(self, act: str, **fields: object) -> None:
        self.acts.append(TruthEvent(self._time_s, "act", {"act": act, **fields}))

    def _assemble(self) -> Script:
        self._begin("idle")
        while True:
            yield from self._pause()
            yield from self._let_robot_work()
            position = self._next_position()
            if position is None:
                yield from self._go_to_rest()
                self.done = True
                yield
                continue
            self.done = False
            placed = yield from self._fill(position)
            if placed and self._wants_to_screw():
                yield from self._screw(position)
                yield from self._go_to_rest()
                yield from self._wait_for_robot_to_begin()

    def _next_position(self) -> str | None:
        """The next in the person's order that can be filled; one that a help request names comes first."""
        can_be_filled = [position for position in self._order if self._can_fill(position)]
        words = (self._request or "").translate(PUNCTUATION).split()
        self._answered = self._request
        asked = [name for name in can_be_filled if name in words or self._wanted[name] in words]
        return next(iter(asked + can_be_filled), None)

    def _can_fill(self, position: str) -> bool:
        if self._tries[position] > self._person.retries:
            return False
        seen = self._sight.in_hole(position)
        if seen is None:
            return any(_graspable(spare) for spare in self._sight.spares(self._wanted[position]))
        crooked = seen.part == self._wanted[position] and not self._sight.seated(seen, position)
        return crooked and _graspable(seen)

    def _fill(self, position: str) -> Generator[None, None, bool]:
        """Fill one position, or set a crooked part straight; returns whether the part sits as it should."""
        self._tries[position] += 1
        part = self._wanted[position]
        seen = self._sight.in_hole(position) or next(filter(_graspable, self._sight.spares(part)))
        self._begin("transit")
        yield from self._work.grasp(seen)
        if self._work.holds(seen.body):
            yield from self._bring(seen, position)
        yield from self._work.let_go(part)
        self._begin("transit")
        yield from self._work.back_off()
        now = self._sight.in_hole(position)
        return now is not None and self._sight.seated(now, position)

    def _bring(self, seen: SeenPart, position: str) -> Script:
        """Take a held part to a hole, or back where it came from if the robot has filled the hole meanwhile."""
        target_m = self._sight.holes_m[position]
        self._begin("assembly", seen.part, position)
        yield from self._carry_to_bracket(seen.body, target_m)
        there = self._sight.in_hole(position)
        if there is not None and there.body != seen.body:
            self._begin("transit")
            target_m = np.array(seen.pose.position_m)
            yield from self._work.carry(seen.body, target_m)
        if self._work.holds(seen.body):
            yield from self._work.insert(seen.body, target_m)

    def _carry_to_bracket(self, body: str, target_m: Array) -> Script:
        """Carry a part over its hole; while the arm is over the bracket, wait behind it."""
        while True:
            if self._sight.arm_over_bracket and self._polite():
                _, y, z = self._work.position_m
                yield from self._work.reach(np.array([self._behind_m, y, max(float(z), self._work.clear_height_m)]))
                yield from self._wait_while(lambda: self._sight.arm_over_bracket)
            yield from self._work.carry(body, target_m)
            if not self._sight.arm_over_bracket or not self._polite():
                return

    def _wants_to_screw(self) -> bool:
        habits = self._person.screw
        self._unscrewed += 1
        wants = self._unscrewed >= habits.unscrewed_limit
        wants = self._rng.random() < habits.probability or wants
        self._unscrewed = 0 if wants else self._unscrewed
        return wants

    def _screw(self, position: str) -> Script:
        seen = self._sight.in_hole(position)
        if seen is None:
            return
        habits = self._person.screw
        motion = ScrewMotion(
            duration_s=drawn(habits.duration_s, self._rng),
            rate_hz=drawn(habits.rate_hz, self._rng),
            radius_m=drawn(habits.radius_m, self._rng),
            yaw_rad=drawn(habits.yaw_rad, self._rng),
        )
        polite = self._person.robot.waits >= 1 or self._chance.random() < self._person.robot.waits
        yield from self._work.reach_over(seen)
        self._begin("screw")
        yield from self._work.screw(motion, stop=lambda: polite and self._sight.arm_over_bracket)
        self._begin("transit")
        yield from self._work.back_off()

    def _go_to_rest(self) -> Script:
        if float(np.linalg.norm(self._work.position_m - self._rest_m)) > AT_REST_M:
            self._begin("transit")
            yield from self._work.reach(self._rest_m, 0.0, RELAXED_GAP_M, arch_m=ARCH_M)
        self._begin("idle")

    def _pause(self) -> Script:
        yield from self._work.wait(drawn(self._person.pause_s, self._rng))

    def _wait_for_robot_to_begin(self) -> Script:
        yield from self._wait_while(lambda: self._sight.arm_parked and not self._asked, self._person.robot.begins_s)

    def _let_robot_work(self) -> Script:
        """Rest while the arm moves or is not parked; go on if it just stands there or asks for help."""
        if self._sight.arm_parked or not self._polite():
            return
        yield from self._go_to_rest()
        still_s = 0.0
        while not self._sight.arm_parked and still_s < self._person.robot.stands_s:
            if self._asked and not self._sight.arm_over_bracket:
                return
            busy = self._sight.arm_moving or self._sight.arm_over_bracket
            still_s = 0.0 if busy else still_s + self._work.dt_s
            yield

    def _wait_while(self, condition: Callable[[], bool], longest_s: float = math.inf) -> Script:
        waited_s = 0.0
        while condition() and waited_s < longest_s:
            waited_s += self._work.dt_s
            yield

    @property
    def _asked(self) -> bool:
        """A help request stands that the person has not acted on."""
        return self._request is not None and self._request != self._answered

    def _begin(self, kind: ActionKind, part: str | None = None, position: str | None = None) -> None:
        """Note that one action ends and another begins."""
        if self._action == (kind, part, position):
            return
        if self._action is not None:
            self.events.append(ActionEvent(self._time_s, self._action[0], "end", *self._action[1:]))
        self._action = (kind, part, position)
        self.events.append(ActionEvent(self._time_s, kind, "start", part, position))


def _graspable(seen: SeenPart) -> bool:
    return seen.tilt_rad < GRASPABLE_TILT_RAD and abs(fold_yaw(seen.pose.yaw_rad)) < MOST_YAW_RAD


def _truth(event: ActionEvent) -> TruthEvent:
    fields = {"action": event.kind, "edge": event.edge, "part": event.part, "position": event.position}
    return TruthEvent(event.time_s, "action", fields)
