"""How a part comes into its hole, lapses included; generators, each `yield` is a period."""

from __future__ import annotations

from collections.abc import Callable, Generator, Mapping

import numpy as np

from bracket_ground.interfaces.pose import Array
from bracket_sim.scene.person import Order, Person, bernoulli, sample
from bracket_sim.worker.event_log import EventLog
from bracket_sim.worker.gripping import fold_yaw
from bracket_sim.worker.hand_primitives import MOST_YAW_RAD, HandPrimitives, Script
from bracket_sim.worker.worker_sight import GRASPABLE_TILT_RAD, SeenPart, Sight

BEHIND_BRACKET_M = 0.26  # where the hand waits with a part while the arm is over the bracket


class Placing:
    """Fills positions.

    Args:
        wanted: type of the part by position.
        polite: asked each time whether the person waits for the arm.
    """

    def __init__(
        self,
        work: HandPrimitives,
        sight: Sight,
        person: Person,
        wanted: Mapping[str, str],
        rng: np.random.Generator,
        events: EventLog,
        polite: Callable[[], bool],
    ) -> None:
        self._work, self._sight, self._person, self._wanted = work, sight, person, wanted
        self._rng, self._events, self._polite = rng, events, polite
        self._tries = dict.fromkeys(wanted, 0)
        self._mistakes: dict[str, str] = {}  # body in the wrong hole by position
        self._unnoticed: dict[str, str] = {}  # as long as nobody tells the person
        self._origins_m: dict[str, Array] = {}  # of parts that this person took
        self._answers: dict[str, tuple[bool, bool]] = {}  # to each part that is held out: takes it, and early
        self._passed: dict[str, str] = {}  # body of the robot's wrong part by position, that is overlooked

    def possible(self, position: str) -> bool:
        """Whether there is something to do at a position that the person can do."""
        seen = self._sight.in_hole(position)
        if seen is not None and seen.body == self._mistakes.get(position):
            return _graspable(seen)
        if self._tries[position] > self._person.retries:
            return False
        if seen is None:
            wanted = self._wanted[position]
            return self.handed(position) or any(_graspable(spare) for spare in self._sight.spares(wanted))
        crooked = seen.part == self._wanted[position] and not self._sight.seated(seen, position)
        return crooked and _graspable(seen)

    def handed(self, position: str) -> bool:
        """Whether the robot holds out what belongs there, and the hole is empty."""
        return self._offered(self._wanted[position]) is not None and self._sight.in_hole(position) is None

    def _offered(self, part: str) -> SeenPart | None:
        """What the robot holds out of a type, where this person takes it; also what it still brings, if in a hurry."""
        seen, habits = self._sight.handed(part, brought=True), self._person.handing
        if seen is None:
            return None
        if seen.body not in self._answers:
            self._answers[seen.body] = self._happens(habits.takes), self._happens(habits.early)
        takes, early = self._answers[seen.body]
        return seen if takes and (early or self._sight.handed(part) is not None) else None

    def left(self, position: str) -> SeenPart | None:
        """What belongs there and lies before the bracket, where the robot puts down what it brings."""
        lying = self._sight.left(self._wanted[position])
        empty = self._sight.in_hole(position) is None
        return lying if lying is not None and empty and _graspable(lying) else None

    def complete(self) -> bool:
        """Whether every position has its part, as it should sit, as far as the person notices."""
        return all(self.right(position) or self._overlooked(position) for position in self._wanted)

    def right(self, position: str) -> bool:
        """Whether a position has its part, as it should sit."""
        seen = self._sight.in_hole(position)
        return seen is not None and seen.part == self._wanted[position] and self._sight.seated(seen, position)

    def noticed(self, position: str) -> bool:
        """Whether the robot placed something that does not belong there, and the person sees it and can take it out."""
        seen = self._sight.in_hole(position)
        if seen is None or seen.part == self._wanted[position] or seen.body in self._origins_m:
            return False
        if self._passed.get(position) == seen.body or not _graspable(seen) or not self._sight.arm_parked:
            return False
        if self._happens(self._person.lapses.overlooks):
            self._passed[position] = seen.body
            return False
        return True

    def _overlooked(self, position: str) -> bool:
        seen = self._sight.in_hole(position)
        return seen is not None and seen.body == self._unnoticed.get(position)

    def mend(self, position: str) -> Script:
        """Somebody says that something is wrong there: set the right part straight, take out any other."""
        seen = self._sight.in_hole(position)
        if seen is None or not _graspable(seen):
            return
        if seen.part == self._wanted[position]:
            yield from self.fill(position)
            return
        self._tries[position] = 0
        yield from self.take_away(position)

    def fill(self, position: str) -> Generator[None, None, bool]:
        """Fill one position, or set a crooked part straight; returns whether the part sits as it should."""
        there = self._sight.in_hole(position)
        if there is not None and there.body == self._mistakes.get(position):
            yield from self.take_away(position)
            return False
        self._tries[position] += 1
        seen = there or self._choose(position)
        self._events.begin("transit")
        self._origins_m[seen.body] = np.array(seen.pose.position_m)
        yield from self._take(seen)
        if self._work.holds(seen.body):
            yield from self._bring(seen, position)
        yield from self._let_go(seen, position)
        if seen.part != self._wanted[position]:
            overlooked = self._happens(self._person.lapses.overlooks)
            (self._unnoticed if overlooked else self._mistakes)[position] = seen.body
        now = self._sight.in_hole(position)
        seated = now is not None and self._sight.seated(now, position)
        if seated and self._happens(self._person.lapses.takes_away):
            yield from self.take_away(position)
            return False
        return seated and seen.part == self._wanted[position]

    def build(self, whole: str) -> Script:
        """Build a sub-assembly at its place, from the bottom up."""
        at_m, kinds = self._sight.spot_m(whole), self._sight.kinds
        for part in kinds[whole].made_of:
            seen = next(filter(_graspable, self._sight.spares(part)), None)
            if seen is None:
                return
            self._events.begin("transit")
            yield from self._work.grasp(seen)
            yield from self._work.carry(seen.body, at_m)
            if self._work.holds(seen.body):
                yield from self._work.insert(seen.body, at_m)
            yield from self._let_go(seen, None)
            at_m = at_m + np.array([0.0, 0.0, kinds[part].size_m[2]])

    def swap(self) -> Script:
        """Take out a part that sits well, and put one of a wrong type into its hole, without noticing that."""
        names = [name for name in self._wanted if self.right(name)]
        for position in names[:1]:
            others = sorted(set(self._wanted.values()) - {self._wanted[position]})
            wrong = [spare for part in others for spare in filter(_graspable, self._sight.spares(part))]
            if not wrong:
                return
            yield from self.take_away(position)
            seen = wrong[0]
            self._events.note("swap", part=seen.part, position=position)
            self._events.begin("transit")
            self._origins_m[seen.body] = np.array(seen.pose.position_m)
            yield from self._take(seen)
            if self._work.holds(seen.body):
                yield from self._bring(seen, position)
            yield from self._let_go(seen, position)
            self._unnoticed[position] = seen.body

    def give(self, part: str) -> Script:
        """Put a part of one's own between the robot's open fingers; back where it was, where they do not take it."""
        seen, tool_m = next(filter(_graspable, self._sight.spares(part)), None), self._sight.open_fingers_m
        if seen is None or tool_m is None:
            return
        self._events.note("give", part=part)
        self._events.begin("transit")
        home_m = np.array(seen.pose.position_m)
        yield from self._work.grasp(seen, at_end=True)
        given, self._answers[seen.body] = False, (False, False)  # nobody takes back what they give
        if self._work.holds(seen.body):
            with self._work.at_arm():
                given = yield from self._work.give(
                    seen.body, tool_m, lambda: self._sight.gripped(seen.part), self._person.handing.stands_back_s
                )
        if not given and self._work.holds(seen.body):
            yield from self._work.carry(seen.body, home_m)
            yield from self._work.insert(seen.body, home_m)
        yield from self._let_go(seen, None)

    def take_away(self, position: str) -> Script:
        """Take a part out of its hole and put it back where it came from; one of the robot's before the bracket."""
        seen = self._sight.in_hole(position)
        if seen is None:
            return
        self._mistakes.pop(position, None)
        self._unnoticed.pop(position, None)
        self._events.note("take away", part=seen.part, position=position)
        self._events.begin("transit")
        yield from self._work.grasp(seen)
        if self._work.holds(seen.body):
            home_m = self._origins_m.get(seen.body, self._sight.set_down_m(seen.part))
            yield from self._work.carry(seen.body, home_m)
            if self._work.holds(seen.body):
                yield from self._work.insert(seen.body, home_m)
        yield from self._let_go(seen, None)

    def _happens(self, share: float) -> bool:
        return bernoulli(share, self._rng)

    def _choose(self, position: str) -> SeenPart:
        """The part that is fetched: the right one, seldom a wrong one or one from the tray."""
        if (theirs := self._offered(self._wanted[position])) is not None:
            return theirs
        if (brought := self.left(position)) is not None:
            self._events.note("brought", part=brought.part)
            return brought
        right = next(filter(_graspable, self._sight.spares(self._wanted[position])))
        if self._happens(self._person.lapses.wrong_part):
            others = [name for name in set(self._wanted.values()) if name != self._wanted[position]]
            spares = [spare for name in sorted(others) for spare in filter(_graspable, self._sight.spares(name))]
            if spares:
                wrong = spares[int(self._rng.integers(len(spares)))]
                self._events.note("wrong part", part=wrong.part, position=position)
                return wrong
        if self._happens(self._person.storage.from_tray):
            lying = filter(_graspable, self._sight.in_tray(self._wanted[position]))
            if self._sight.arm_parked and (theirs := next(lying, None)) is not None:
                self._events.note("from tray", part=theirs.part)
                return theirs
        return right

    def _take(self, seen: SeenPart) -> Script:
        if self._offered(seen.part) == seen:
            self._events.note("handed over", part=seen.part)
            with self._work.at_arm():
                yield from self._work.take_over(seen, self._person.handing)
            self._origins_m[seen.body] = self._sight.set_down_m(seen.part)
            return
        yield from self._work.grasp(seen)
        lapses = self._person.lapses
        if self._work.holds(seen.body) and self._happens(lapses.regrips):
            self._events.note("regrip", part=seen.part)
            yield from self._work.insert(seen.body, self._origins_m[seen.body])
            yield from self._work.let_go(seen.part)
            yield from self._work.back_off()
            yield from self._work.grasp(self._sight.part(seen.body))
        if self._work.holds(seen.body) and self._happens(lapses.holds):
            duration_s = sample(lapses.hold_s, self._rng)
            self._events.note("hold", part=seen.part, duration_s=duration_s)
            yield from self._work.wait(duration_s)

    def _bring(self, seen: SeenPart, position: str) -> Script:
        """Take a held part to a hole, or back where it came from if the robot has filled the hole meanwhile."""
        target_m = self._sight.holes_m[position]
        self._events.begin("assembly", seen.part, position)
        if self._happens(self._person.lapses.hesitates):
            yield from self._hesitate(seen, position)
        yield from self._carry_to_bracket(seen.body, target_m)
        there = self._sight.in_hole(position)
        if there is not None and there.body != seen.body:
            self._events.begin("transit")
            target_m = np.array(seen.pose.position_m)
            yield from self._work.carry(seen.body, target_m)
        if self._work.holds(seen.body):
            yield from self._work.insert(seen.body, target_m)

    def _hesitate(self, seen: SeenPart, position: str) -> Script:
        """Stay over another hole first."""
        others = [name for name in self._sight.holes_m if name != position]
        other = others[int(self._rng.integers(len(others)))]
        self._events.note("hesitate", part=seen.part, position=other)
        yield from self._carry_to_bracket(seen.body, self._sight.holes_m[other])
        yield from self._work.wait(sample(self._person.lapses.hesitate_s, self._rng))

    def _let_go(self, seen: SeenPart, position: str | None) -> Script:
        held = self._work.holds(seen.body)
        in_hole = self._events.doing == ("assembly", seen.part, position)
        self._events.note("release", part=seen.part if held else None, position=position if held and in_hole else None)
        yield from self._work.let_go(seen.part)
        self._events.begin("transit")
        yield from self._work.back_off()

    def _carry_to_bracket(self, body: str, target_m: Array) -> Script:
        """Carry a part over its hole; while the arm is over the bracket, wait behind it."""
        behind_m = self._sight.bracket_m[0] + BEHIND_BRACKET_M
        while True:
            if self._sight.arm_over_bracket and self._polite():
                _, y, z = self._work.position_m
                yield from self._work.reach(np.array([behind_m, y, max(float(z), self._work.clear_height_m)]))
                while self._sight.arm_over_bracket:
                    yield
            yield from self._work.carry(body, target_m)
            if not self._sight.arm_over_bracket or not self._polite():
                return


def _graspable(seen: SeenPart) -> bool:
    return seen.tilt_rad < GRASPABLE_TILT_RAD and abs(fold_yaw(seen.pose.yaw_rad)) < MOST_YAW_RAD


def positions_in_order(
    order: Order, wanted: Mapping[str, str], rng: np.random.Generator, chance: np.random.Generator
) -> list[str]:
    """All positions in the order in which a person fills them.

    Args:
        wanted: type of the part by position.
    """
    names = list(wanted)
    if order == "any":
        orders: tuple[Order, ...] = ("random", "positions", "reversed", "parts")
        order = orders[int(chance.integers(len(orders)))]
    if order == "random":
        return [names[index] for index in rng.permutation(len(names))]
    if order == "parts":
        types = sorted(set(wanted.values()))
        turn = {types[index]: place for place, index in enumerate(chance.permutation(len(types)))}
        return sorted(names, key=lambda name: turn[wanted[name]])
    return names[::-1] if order == "reversed" else names
