"""What a person does at one bracket: which hole comes next, what is mended, and how the robot is waited for."""

from __future__ import annotations

import math
from collections.abc import Callable, Generator, Iterator, Sequence
from dataclasses import replace

import numpy as np

from bracket_ground.interfaces.product import Product
from bracket_sim.scene.person import BesideRobot, Person, bernoulli, sample
from bracket_sim.worker.event_log import EventLog
from bracket_sim.worker.hand_primitives import HandPrimitives, ScrewMotion, Script
from bracket_sim.worker.placing import Placing
from bracket_sim.worker.worker_sight import Sight

PUNCTUATION = str.maketrans(",.;:()", "      ")
HELD_OUT_S = 20.0  # as long as a robot offers a part, and goes again
TOOL_RADIUS_M = 0.003  # a tool that sits on a screw does not leave it


class BracketWork:
    """One bracket in work; made anew for every bracket.

    Args:
        placing: how this person fills holes.
        wanted: type of the part by position; of several that are right, what stands there is wanted from then on.
        order: positions, as this person goes about them.
        product: says what comes before what.
        free: whether no other hand is at work at a position, or fetches the same type for another one.

    Attributes:
        fastened: fastenings that are done.
        rest: brings the hand back to its resting place.
    """

    def __init__(
        self,
        placing: Placing,
        sight: Sight,
        wanted: dict[str, str],
        order: Sequence[str],
        rest: Callable[[], Script],
        product: Product,
        free: Callable[[str], bool],
    ) -> None:
        self._free = free
        self.placing, self.wanted, self.fastened = placing, wanted, list[str]()
        self._product, self._goal = product, product.goal_of(wanted)
        self._sight, self._order, self._rest = sight, order, rest

    def next_position(self, request: str | None) -> str | None:
        """The next in the person's order that can be filled; one that a help request names comes first."""
        done, product = self._done(), self._product
        its_turn = [position for position in self._order if not product.missing_before(position, done, self.wanted)]
        can_be_filled = [position for position in its_turn if self._free(position) and self.placing.possible(position)]
        whole = [position for position in can_be_filled if self.wanted[position] in product.wholes]
        words = (request or "").translate(PUNCTUATION).split()
        asked = [name for name in can_be_filled if name in words or self.wanted[name] in words]
        handed = [name for name in can_be_filled if self.placing.handed(name)]
        left = [] if self._sight.has_arm else whole  # these the robot puts in
        return next(iter(asked + handed + [name for name in can_be_filled if name not in whole] + left), None)

    def agree(self) -> None:
        """Of several arrangements that are right, want the one that what stands belongs to."""
        if self._product.varies and self._goal is not None:
            standing = {name: seen.part for name in self._order if (seen := self._sight.in_hole(name)) is not None}
            self.wanted.update(self._product.goal_placements(self._goal, standing))

    def due(self) -> str | None:
        """A fastening whose turn it is."""
        return next(iter(self._product.unfastened(self.wanted, self._done())), None)

    def _done(self) -> set[str]:
        if not any(self._product.predecessors.values()):
            return set()  # nothing asks for it
        return {*(position for position in self._order if self.placing.right(position)), *self.fastened}

    def empty(self) -> Iterator[str]:
        """Positions in which nothing stands."""
        return (name for name in self._order if self._sight.in_hole(name) is None)

    def filled(self) -> list[str]:
        """Positions in which something stands."""
        return [name for name in self._order if self._sight.in_hole(name) is not None]

    def can_place(self, part: str) -> bool:
        """Whether a part of this type is at hand, and a hole for it is free."""
        return any(self.wanted[name] == part and self.placing.possible(name) for name in self._order)

    def handed(self) -> bool:
        """Whether the robot has handed over a part that fits."""
        return any(self.placing.handed(name) for name in self._order)

    def misplaced(self) -> Iterator[str]:
        """Positions in which the person notices what the robot placed and what does not belong there."""
        return (name for name in self._order if self._free(name) and self.placing.noticed(name))

    def take_away(self, position: str) -> Script:
        """Take out what does not belong there."""
        yield from self.placing.take_away(position)
        yield from self._rest()

    def mend(self, positions: Sequence[str]) -> Generator[None, None, bool]:
        """Take out what is wrong in these holes and set straight what is crooked; returns whether anything was."""
        wrong = [position for position in positions if not self.placing.right(position)]
        for position in wrong:
            yield from self.placing.mend(position)
        if wrong:
            yield from self._rest()
        return bool(wrong)

    def take_brought(self) -> Generator[None, None, bool]:
        """Put what the robot laid before the bracket into its hole; returns whether nothing of it is left there."""
        lying = {part: seen for part in set(self.wanted.values()) if (seen := self._sight.left(part)) is not None}
        for position in self._order:
            if self.placing.left(position) is not None:
                yield from self.placing.fill(position)
                yield from self._rest()
                lying.pop(self.wanted[position], None)
        return not lying


class Screwing:
    """Scripts of the hand; each `yield` is a period.

    Args:
        rng: for motions.
        chance: for what not every person does.
    """

    def __init__(
        self,
        work: HandPrimitives,
        sight: Sight,
        person: Person,
        rng: np.random.Generator,
        chance: np.random.Generator,
        events: EventLog,
    ) -> None:
        self._work, self._sight, self._events = work, sight, events
        self._habits, self._waits = person.screw, person.robot.waits
        self._rng, self._chance = rng, chance
        self._unscrewed = 0

    def wanted(self) -> bool:
        """Whether the person screws after the part that was just placed."""
        self._unscrewed += 1
        wants = self._unscrewed >= self._habits.unscrewed_limit
        wants = self._rng.random() < self._habits.probability or wants
        self._unscrewed = 0 if wants else self._unscrewed
        return wants

    def screw(self, position: str, *, held: bool = False) -> Script:
        """Screw the part in a hole, if there is one; one that the robot holds, beside its fingers."""
        seen = self._sight.in_hole(position)
        if seen is None:
            return
        habits = self._habits
        motion = ScrewMotion(
            duration_s=sample(habits.duration_s, self._rng),
            rate_hz=sample(habits.rate_hz, self._rng),
            radius_m=sample(habits.radius_m, self._rng),
            yaw_rad=sample(habits.yaw_rad, self._rng),
        )
        tool = not held and bernoulli(habits.tool, self._chance)
        if tool:
            motion = replace(motion, radius_m=min(motion.radius_m, TOOL_RADIUS_M))
            self._events.note("tool", position=position)
        polite = not held and bernoulli(self._waits, self._chance)
        if held:
            yield from self._work.reach_beside(seen)
        else:
            yield from self._work.reach_over(seen, sample(habits.height_m, self._rng), tool=tool)
        self._events.begin("screw")
        yield from self._work.screw(motion, stop=lambda: polite and self._sight.arm_over_bracket)
        self._events.begin("transit")
        yield from self._work.back_off()


class Waiting:
    """Scripts of a hand that rests; each `yield` is a period.

    Args:
        habits: beside a robot.
        chance: for what not every person does.
        asked: whether a help request stands that the person has not acted on.
    """

    def __init__(
        self,
        work: HandPrimitives,
        sight: Sight,
        habits: BesideRobot,
        chance: np.random.Generator,
        events: EventLog,
        asked: Callable[[], bool],
    ) -> None:
        self._work, self._sight, self._habits = work, sight, habits
        self._chance, self._events, self._asked = chance, events, asked

    def polite(self) -> bool:
        """Whether the person waits for the arm this time."""
        polite = bernoulli(self._habits.waits, self._chance)
        if not polite:
            self._events.note("does not wait")
        return polite

    def begins(self) -> Script:
        """Until the arm leaves its parking place, or a part is asked for."""
        yield from self.while_true(lambda: self._sight.arm_parked and not self._asked(), self._habits.begins_s)

    def works(self, handed: Callable[[], bool]) -> Script:
        """While the arm moves or is not parked; not where it just stands there, asks for help or holds a part out.

        Who goes on with an arm that leaves does not wait until it is parked. What is held out to nobody is in the way
        between hand and bracket: it is waited for, but not for ever.
        """
        still_s, out_s, brisk = 0.0, 0.0, self._habits.goes_on == "leaving"
        while not self._sight.arm_parked and still_s < self._habits.stands_s:
            if handed() or (self._asked() and not self._sight.arm_over_bracket):
                return
            if brisk and self._sight.arm_leaves:
                return
            out = self._sight.held_out_m() is not None and out_s < HELD_OUT_S
            out_s += self._work.dt_s * out
            busy = self._sight.arm_moving or self._sight.arm_over_bracket or out
            still_s = 0.0 if busy else still_s + self._work.dt_s
            yield

    def while_true(self, condition: Callable[[], bool], longest_s: float = math.inf) -> Script:
        """As long as something is so, but not for ever."""
        waited_s = 0.0
        while condition() and waited_s < longest_s:
            waited_s += self._work.dt_s
            yield
