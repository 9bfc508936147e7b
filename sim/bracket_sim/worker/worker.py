"""The simulated person at the bench: fetches parts, places and screws them, and waits while the robot works.

The behaviour is a script of generators: each `yield` lets one control period pass. The person knows the goal and sees
the bench as it is; parts are carried by friction alone.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from bracket_ground.interfaces.bench import Bench
from bracket_ground.interfaces.command import Display
from bracket_ground.interfaces.devices import TruthEvent
from bracket_ground.interfaces.operator import OperatorOrder
from bracket_ground.interfaces.product import Product
from bracket_sim.scene.hand import Hand, hand_rest_m
from bracket_sim.scene.person import Person, bernoulli, sample
from bracket_sim.worker.bench_chores import (
    BenchChores,
    OperatorAnswers,
    choice_answer,
    goal_answer,
    help_answer,
    mend_answer,
    where_answer,
)
from bracket_sim.worker.bracket_work import PUNCTUATION, BracketWork, Screwing, Waiting
from bracket_sim.worker.event_log import ActionEvent, EventLog
from bracket_sim.worker.hand_primitives import ARCH_M, RELAXED_GAP_M, HandPrimitives, Script
from bracket_sim.worker.hands import Hands
from bracket_sim.worker.intrusion import Intrusion, Sequel
from bracket_sim.worker.placing import Placing, positions_in_order
from bracket_sim.worker.stock import Stock
from bracket_sim.worker.worker_sight import Sight, WorkerWorld

AT_REST_M = 0.02
OUT_OF_VIEW_M = 1.75  # x of a hand that has left the bench
ASKS_AGAIN_S = 6.0  # how long the person waits for a part that only the robot can bring
POINTS_M, CLOSED_GAP_M, POINTS_S = 0.10, 0.005, 5.0  # over the parts that stand there, and how long at most
SEEN_S = 6.0  # how long the person waits for the cell to see the empty bracket
OVER = object()


@dataclass(frozen=True)
class WorkerContext:
    """What happens around the bracket.

    Attributes:
        change: called when the person has the finished bracket in hand; the part type by position of the next one.
        goes_on: brackets follow one another: one that nobody asks to be changed is changed after a while.
        rng: for errands and answers.
        people: who take turns, a bracket each, the first one first; none: one person makes them all.
    """

    stock: Stock
    change: Callable[[], Mapping[str, str]]
    goes_on: bool
    rng: np.random.Generator
    people: Sequence[Person] = ()


class Worker:
    """Moves the hand, and implements `Panel`: a person who sees guidance and help requests.

    Attributes:
        hand: where it is, for labels.
        done: nothing is left that the person can do now, and the hand rests.
        away: the person has not come yet.

    Args:
        wanted: type of the part by position.
        rng: for motions and order.
        chance: for what not every person does; apart, so that it does not change the rest.
        around: what happens around the bracket; None for a person who does nothing but assemble one.
        number: of the hand; 0 is the first one.
        hands: what all hands are about.
        minds_arm: it goes round an arm that stands; where nothing touches, nobody needs to.
    """

    def __init__(
        self,
        world: WorkerWorld,
        product: Product,
        bench: Bench,
        person: Person,
        wanted: Mapping[str, str],
        rng: np.random.Generator,
        chance: np.random.Generator | None = None,
        around: WorkerContext | None = None,
        number: int = 0,
        hands: Hands | None = None,
        *,
        minds_arm: bool = True,
    ) -> None:
        self._number, self._hands = number, hands or Hands()
        other = person.other_hands[number - 1] if number else None
        self._turned_rad = 0.0 if other is None else other.turned_rad
        person = person if other is None else person.model_copy(update={"rest_m": other.rest_m})
        self._person, self._rng, self._product = person, rng, product
        self._tool_says: list[OperatorOrder] = []
        self._chance = chance or np.random.default_rng(0)
        self._sight = Sight(world, product, bench)
        self.hand = Hand(world.model, world.data, number)
        self.hand.turn(self._turned_rad)
        self._events = EventLog()
        chance, turned_rad = self._chance, self._turned_rad
        self._work = HandPrimitives(self.hand, self._sight, product, person, rng, chance, turned_rad, minds_arm)
        self._events.note("person", pace=self._work.pace)
        self._bench = bench
        self._bracket = 0
        self._request: str | None = None
        self._answered: str | None = None
        self._message = self._wished = ""  # what the panel says, and what of it was answered by hand
        self._set_habits(person)
        self.begin(wanted)
        self._around = around
        self._replies = None if around is None else OperatorAnswers(person.shift, around.rng)
        self._errands = None if around is None else self._bench_chores(around)
        self._intruding: Script | None = None
        self._script = self._assemble()
        self.done = self.away = False

    def _bench_chores(self, around: WorkerContext) -> BenchChores:
        return BenchChores(
            self._work,
            self._sight,
            self._bench,
            around.stock,
            self._person.shift,
            around.rng,
            self._events,
            self._change_job,
            lambda: self._waiting.polite(),
        )

    def show(self, display: Display) -> None:
        """The person reads the panel; a help request that is new gets them going at once."""
        self._message = display.message
        self._wished = self._wished if self._wished == self._message else ""
        if self._replies is not None:
            self._replies.show(display.questions, self._events.time_s)
        if self._replies is None or not display.questions:  # a question is noticed after a while, see OperatorAnswers
            self._request = display.help_request
        if display.help_request is None:
            self._request = self._answered = None

    def pressed(self) -> list[OperatorOrder]:
        """What the person, and the tool in their hand, said to the cell since the last call."""
        said, self._tool_says = self._tool_says, []
        return said + (self._replies.pressed() if self._replies is not None else [])

    def alarm(self, text: str) -> None:
        """A trouble that waits for somebody: the person acknowledges it after a while."""
        if self._replies is not None:
            self._replies.alarm(text, self._events.time_s)

    def update(self, time_s: float, dt_s: float) -> None:
        """Let one control period pass."""
        self._events.time_s, self._work.dt_s = time_s, dt_s
        if self.away:
            return
        if self._occupied:
            self._idle_since_s = time_s
        if self._intruding is None and self._tempted(dt_s):
            self.intrude()
        self._work.forceful = self.intruding
        if self._intruding is None or next(self._intruding, OVER) is OVER:
            self._intruding, self._work.forceful = None, False
            next(self._script, None)
            if self._replies is not None:
                self._replies.acknowledge(time_s)
        self._work.send()

    def intrude(self, sequel: Sequel | None = None, speed_m_s: float | None = None) -> None:
        """Go into the arm's way now, whatever the hand was doing; what is not given is drawn from the habits."""
        if self._intruding is None and self._sight.has_arm:
            self._intruding = self._intrusion.script(sequel, speed_m_s)

    @property
    def intruding(self) -> bool:
        """Whether the hand is in the arm's way on purpose, or on its way there or back."""
        return self._intruding is not None

    @property
    def busy(self) -> bool:
        """Whether the hand is occupied with a part."""
        return self._events.doing is None or self._events.doing[0] == "assembly"

    @property
    def events(self) -> list[ActionEvent]:
        """What the hand did so far, in order."""
        return self._events.actions

    @property
    def acts(self) -> list[TruthEvent]:
        """What the person did besides, mistakes and bad habits among it, in order."""
        return self._events.acts

    def news(self) -> list[TruthEvent]:
        """Actions and acts since the last call, in order."""
        return self._events.news()

    def _tempted(self, dt_s: float) -> bool:
        """Whether the hand goes into the arm's way in this period: the arm moves, and the hand is free."""
        often = self._person.robot.intrusions_per_min
        if not often or not self._sight.arm_moving or self.busy:
            return False
        return self._chance.random() < often / 60 * dt_s

    def _assemble(self) -> Script:
        self._events.begin("idle")
        while True:
            yield from self._work.wait(sample(self._person.pause_s, self._rng))
            yield from self._answer()
            if self._errands is not None:
                yield from self._errands.tidy_up()
            yield from self._let_robot_work()
            yield from self._help_with_part()
            self._job.agree()
            for misplaced in self._job.misplaced():
                self.done = False
                self._hands.takes(self._number, misplaced, "")
                yield from self._job.take_away(misplaced)
                self._hands.leaves(self._number)
            self._answered = self._request
            if (fastening := self._job.due()) is not None:
                yield from self._fasten(fastening)
                continue
            if (whole := self._sight.unbuilt(self._job.wanted.values())) is not None:
                yield from self._job.placing.build(whole)
                yield from self._go_to_rest()
                continue
            position = self._job.next_position(self._request)
            if position is None:
                yield from self._go_to_rest()
                self.done = True
                yield from self._go_on()
                yield
                continue
            self.done = False
            self._hands.takes(self._number, position, self._job.wanted[position])
            placed = yield from self._job.placing.fill(position)
            yield from self._turn_away()
            if placed and self._screwing.wanted():
                yield from self._screwing.screw(position)
                yield from self._go_to_rest()
                self._hands.leaves(self._number)
                yield from self._waiting.begins()
            self._hands.leaves(self._number)

    @property
    def _wants_hand(self) -> str | None:
        """What the robot asks for with its fingers: a type of part between them, or a hole to fasten at; else None.

        The person answers each such wish once, until the robot asks for something else.
        """
        words, habits = self._message.translate(PUNCTUATION).split(), self._person.handing
        if self._message == self._wished:
            return None
        if (held := self._sight.held_in_hole()) is not None and "fasten" in words:
            return held
        if not ({"put", "between"} <= set(words) and habits.gives and self._sight.open_fingers_m is not None):
            return None
        return next((word for word in words if word in self._product.parts), None)

    def _help_with_part(self) -> Script:
        """Put a part between the robot's open fingers, or fasten one that it holds."""
        if (wish := self._wants_hand) is None:
            return
        self._wished = self._message
        if wish in self._product.positions:
            with self._work.at_arm():
                yield from self._screwing.screw(wish, held=True)
        elif bernoulli(self._person.handing.gives, self._chance):
            yield from self._job.placing.give(wish)
        yield from self._go_to_rest()

    def _turn_away(self) -> Script:
        """Swap a wrong part in, exchange the tray, or walk off, as this person does after a placement."""
        leaving = self._person.leaving
        if bernoulli(self._person.lapses.swaps, self._chance):
            yield from self._job.placing.swap()
        if self._errands is not None and bernoulli(leaving.exchanges_tray, self._chance):
            yield from self._errands.exchange_tray()
        if bernoulli(leaving.leaves, self._chance):
            self._events.note("leaves")
            self._events.begin("transit")
            yield from self._work.reach(np.array([OUT_OF_VIEW_M, *self._rest_m[1:]]), 0.0, arch_m=ARCH_M)
            self._events.begin("idle")
            yield from self._work.wait(sample(leaving.away_s, self._chance))
            self._events.note("comes back")
            yield from self._go_to_rest()

    def _fasten(self, name: str) -> Script:
        """Fasten at every slot of a step; the tool reports its torque where the step wants some."""
        fastening = self._product.fastenings[name]
        for position in fastening.at:
            yield from self._screwing.screw(position)
        self._events.note("fastened", step=name)
        self._job.fastened.append(name)
        if fastening.torque_nm is not None:
            self._tool_says.append(OperatorOrder("fastened", f"{name} {fastening.torque_nm:g}"))
        yield from self._go_to_rest()
        yield from self._waiting.begins()

    def begin(self, wanted: Mapping[str, str]) -> None:
        """From now on, this is to be built."""
        wanted = dict(wanted)
        order = positions_in_order(self._person.order, wanted, self._rng, self._chance)
        placing = Placing(
            self._work, self._sight, self._person, wanted, self._chance, self._events, self._waiting.polite
        )
        holes_m = self._sight.holes_m

        def free(position: str) -> bool:
            return self._hands.free(self._number, position, wanted[position], holes_m)

        self._job = BracketWork(placing, self._sight, wanted, order, self._go_to_rest, self._product, free)
        self._idle_since_s = self._events.time_s

    @property
    def _occupied(self) -> bool:
        """Whether the person has something to do, or waits for the arm, or is asked for help."""
        asked = self._replies is not None and self._replies.stands("help")
        return not self.done or asked or not self._sight.arm_parked

    def _change_job(self) -> None:
        assert self._around is not None
        if self._around.people:
            self._bracket += 1
            self._become(self._around.people[self._bracket % len(self._around.people)])
        self.begin(self._around.change())

    def _become(self, person: Person) -> None:
        """Somebody else takes over the bench; where the parts are kept stays as it is."""
        self._person = person
        self._work.become(person)
        self._events.note("person", pace=self._work.pace)
        self._set_habits(person)

    def _set_habits(self, person: Person) -> None:
        """What this person does in their own way."""
        self._rest_m = np.array(hand_rest_m(self._bench, person, self._turned_rad))
        self._waiting = Waiting(self._work, self._sight, person.robot, self._chance, self._events, lambda: self._asked)
        self._screwing = Screwing(self._work, self._sight, person, self._rng, self._chance, self._events)
        self._intrusion = Intrusion(self._work, self._sight, person.robot, self._chance, self._events.note)

    def _answer(self) -> Script:
        """Answer what was noticed: words at once, help with a part by hand."""
        if self._replies is None or self._errands is None:
            return
        for question in list(self._replies.noticed(self._events.time_s)):
            if question.kind == "goal":
                self._replies.answer(question, goal_answer(question, self._job.wanted))
            elif question.kind == "where":
                points = bernoulli(self._person.shift.points, self._chance)
                empty = [] if self._job.can_place(question.part) and not points else list(self._job.empty())
                place = where_answer(question, self._job.wanted, empty)
                if points and place in self._sight.holes_m:
                    yield from self._point_at(place)
                self._replies.answer(question, place)
            elif question.kind == "help":
                by_hand = self._job.can_place(question.part) and bernoulli(
                    self._person.shift.places_asked, self._chance
                )
                if by_hand:
                    self._request = question.part
                else:
                    yield from self._errands.help(question.part) if question.part else self._errands.take_held()
                    yield from self._go_to_rest()
                self._replies.answer(question, help_answer(by_hand))
            elif question.kind == "mend":
                yield from self._let_robot_work()
                mended = yield from self._job.mend(question.positions)
                self._replies.answer(question, mend_answer(question, mended))
            elif question.kind == "choice":
                brought = yield from self._job.take_brought()
                self._replies.answer(question, choice_answer(question, brought))

    def _point_at(self, position: str) -> Script:
        """Hold the fingertips over a hole until the cell has understood; who is not understood says it."""
        replies = self._replies
        assert replies is not None
        self._events.note("points", position=position)
        self._events.begin("transit")
        over_m = self._sight.holes_m[position] + np.array([0.0, 0.0, POINTS_M])
        yield from self._work.reach(over_m, 0.0, CLOSED_GAP_M, arch_m=ARCH_M)
        yield from self._waiting.while_true(lambda: replies.stands("where"), POINTS_S)
        yield from self._go_to_rest()

    def _go_on(self) -> Script:
        """Nothing is left to be placed: fill the bins where a part lacks, or change the bracket when it is time."""
        if self._errands is None or self._replies is None or self._around is None:
            return
        complete = self._job.placing.complete()
        if not complete and "bins" in self._errands.due:
            yield from self._errands.fill("bins")
            return
        idle_s = self._events.time_s - self._idle_since_s
        if not complete and idle_s > ASKS_AGAIN_S:
            yield from self._ask_for_part()
            self._idle_since_s = self._events.time_s
            return
        asked = self._replies.asks_for_bracket(self._events.time_s)
        if asked or (self._around.goes_on and idle_s > self._person.shift.gives_up_s):
            yield from self._errands.change_bracket()
            yield from self._go_to_rest()
            replies = self._replies
            yield from self._waiting.while_true(lambda: replies.stands("bracket"), SEEN_S)

    def _ask_for_part(self) -> Script:
        """A part is missing that only the robot can bring: screw once more, which is how it is asked for one."""
        if placed := self._job.filled():
            yield from self._screwing.screw(placed[int(self._chance.integers(len(placed)))])
            yield from self._go_to_rest()
            yield from self._waiting.begins()

    def has(self, body: str) -> bool:
        """Whether a part is between the closed fingers."""
        return self._work.pinches(body)

    def _go_to_rest(self) -> Script:
        if float(np.linalg.norm(self._work.position_m - self._rest_m)) > AT_REST_M:
            self._events.begin("transit")
            yield from self._work.reach(self._rest_m, self._turned_rad, RELAXED_GAP_M, arch_m=ARCH_M)
        self._events.begin("idle")

    def _let_robot_work(self) -> Script:
        """Rest while the arm moves or is not parked; go on if it just stands there or asks for help."""
        if self._sight.arm_parked or not self._waiting.polite():
            return
        yield from self._go_to_rest()
        yield from self._waiting.works(lambda: self._job.handed() or self._wants_hand is not None)

    @property
    def _asked(self) -> bool:
        """A help request stands that the person has not acted on."""
        return self._request is not None and self._request != self._answered
