"""What takes the person away from the bracket: changing it, filling bins and tray, answering and helping the robot."""

from __future__ import annotations

from collections.abc import Callable, Container, Iterator, Mapping

import numpy as np

from bracket_ground.interfaces.bench import Bench
from bracket_ground.interfaces.operator import HELP_GIVEN, IS_RIGHT, PLACED_BY_HAND, OperatorOrder, Question
from bracket_ground.interfaces.planning import UNKNOWN_GOAL
from bracket_sim.scene.person import ShiftHabits, bernoulli, sample
from bracket_sim.worker.event_log import EventLog
from bracket_sim.worker.hand_primitives import ARCH_M, RELAXED_GAP_M, HandPrimitives, Script
from bracket_sim.worker.intrusion import within_reach
from bracket_sim.worker.stock import Stock
from bracket_sim.worker.worker_sight import Sight

OVER_TRAY_M, TRAY_HEIGHT_M = (0.06, 0.10), 0.24  # of the hand over the tray, from its middle towards the person
OVER_BINS_M = 0.22


class OperatorAnswers:
    """Notices what the cell asks, each question after a while of its own, and keeps what the person presses.

    Args:
        rng: for how long it takes.
    """

    def __init__(self, habits: ShiftHabits, rng: np.random.Generator) -> None:
        self._habits, self._rng = habits, rng
        self._due_s: dict[int, float] = {}
        self._standing: tuple[Question, ...] = ()
        self._acknowledges_s: float | None = None
        self._resumes_s: float | None = None
        self._said = False  # a trouble was acknowledged, and the cell was not let go on so far
        self._pressed: list[OperatorOrder] = []

    def show(self, questions: tuple[Question, ...], time_s: float) -> None:
        """The cell asks these now."""
        self._standing = questions
        for question in questions:
            if question.number not in self._due_s:
                self._due_s[question.number] = time_s + self._reaction_s(question)
        self._due_s = {question.number: self._due_s[question.number] for question in questions}

    def alarm(self, text: str, time_s: float) -> None:
        """The panel shows a trouble from now on, or none."""
        self._acknowledges_s = time_s + float(self._rng.exponential(self._habits.answers_s)) if text else None
        self._resumes_s = time_s + self._habits.answers_s if self._said and not text else None

    def acknowledge(self, time_s: float) -> None:
        """Press it where a trouble was noticed, and again while it still stands; let the cell go on when it is gone."""
        if self._resumes_s is not None and time_s >= self._resumes_s:
            self._pressed.append(OperatorOrder("resume"))
            self._resumes_s, self._said = None, False
        if self._acknowledges_s is not None and time_s >= self._acknowledges_s:
            self._pressed.append(OperatorOrder("acknowledge"))
            self._acknowledges_s, self._said = time_s + self._habits.answers_s, True

    def _reaction_s(self, question: Question) -> float:
        if question.kind == "bracket":
            return sample(self._habits.pause_s, self._rng)
        return float(self._rng.exponential(self._habits.answers_s))

    def noticed(self, time_s: float) -> Iterator[Question]:
        """Questions that stand, that the person has noticed, and that are not answered yet."""
        return (question for question in self._standing if self._due_s[question.number] <= time_s)

    def asks_for_bracket(self, time_s: float) -> bool:
        """Whether it was noticed that an empty bracket is wanted; each question counts once."""
        found = [question for question in self.noticed(time_s) if question.kind == "bracket"]
        for question in found:
            self._due_s[question.number] = float("inf")
        return bool(found)

    def stands(self, kind: str) -> bool:
        """Whether such a question is asked now."""
        return any(question.kind == kind for question in self._standing)

    def answer(self, question: Question, value: str) -> None:
        """Say it; the cell hears it in its next tick."""
        self._pressed.append(OperatorOrder("answer", value, question.number))
        self._due_s[question.number] = float("inf")

    def pressed(self) -> list[OperatorOrder]:
        """What was said since the last call."""
        pressed, self._pressed = self._pressed, []
        return pressed


class BenchChores:
    """Scripts of the hand; each `yield` is a period.

    Args:
        change: told when the finished bracket is in the person's hands; what is to be built next follows from it.
        polite: asked each time whether the person waits for the arm.
    """

    def __init__(
        self,
        work: HandPrimitives,
        sight: Sight,
        bench: Bench,
        stock: Stock,
        habits: ShiftHabits,
        rng: np.random.Generator,
        events: EventLog,
        change: Callable[[], None],
        polite: Callable[[], bool],
    ) -> None:
        self._work, self._sight, self._bench, self._stock = work, sight, bench, stock
        self._habits, self._rng, self._events, self._change, self._polite = habits, rng, events, change, polite
        self.due: set[str] = set()  # "bins" and "tray", to be filled later

    def change_bracket(self) -> Script:
        """Finished bracket out, empty one in; bins and tray are filled now, in any order, or when something lacks."""
        self._events.begin("transit")
        yield from self._wait_for_arm(lambda: self._sight.arm_over_bracket)
        x, y, _ = self._sight.bracket_m
        half_s = sample(self._habits.exchange_s, self._rng) / 2
        yield from self._over(np.array([x + 0.03, y, self._work.clear_height_m + 0.08]), half_s)
        self._change()
        self._stock.take_bracket()
        self._events.note("change bracket")
        yield from self._work.wait(half_s)
        self.due = {"bins", "tray"}
        for place in ("bins", "tray") if self._rng.random() < 0.5 else ("tray", "bins"):
            if bernoulli(self._habits.fills_at_once, self._rng):
                yield from self.fill(place)

    def fill(self, place: str) -> Script:
        """Fill the bins or the tray."""
        self.due.discard(place)
        self._events.begin("transit")
        duration_s = sample(self._habits.fill_s, self._rng)
        if place == "tray":
            yield from self._at_tray(duration_s, lambda: self._stock.fill_tray())
            return
        spots = np.array(list(self._bench.bins_m.values()))
        middle = spots.mean(axis=0)
        middle[2] = OVER_BINS_M
        yield from self._over(middle, duration_s / 2)
        self._stock.fill_bins()
        self._events.note("fill bins")
        yield from self._work.wait(duration_s / 2)

    def exchange_tray(self) -> Script:
        """Put another tray there: the parts that are left in it, each in another place."""
        self._events.begin("transit")
        yield from self._at_tray(sample(self._habits.exchange_s, self._rng), self._stock.exchange_tray)
        self._events.note("exchange tray")

    def tidy_up(self) -> Script:
        """Pick up what fell over on the bench, if anything did, and put it back where such parts are kept."""
        if not self._stock.fallen():
            return
        self._events.begin("transit")
        yield from self._wait_for_arm(lambda: self._sight.arm_over_bracket)
        x, y, _ = self._sight.bracket_m
        half_s = sample(self._habits.fill_s, self._rng) / 2
        yield from self._over(np.array([x + 0.03, y, self._work.clear_height_m + 0.08]), half_s)
        fallen = self._stock.fallen()
        self._stock.take(fallen)
        self._events.note("tidy up", parts=[body.part for body in fallen])
        yield from self._work.wait(half_s)
        owners = {body.owner for body in fallen}
        for owner, place in (("person", "bins"), ("robot", "tray")):
            if owner in owners:
                yield from self.fill(place)

    def help(self, part: str) -> Script:
        """Set a part of this type into the tray so that the robot can take it."""
        self._events.begin("transit")
        yield from self._at_tray(sample(self._habits.fill_s, self._rng), lambda: self._free(part))

    def take_held(self) -> Script:
        """Take what is at the robot's fingers out of them."""
        self._events.begin("transit")
        tool_m, _ = self._sight.tool()
        half_s = sample(self._habits.fill_s, self._rng) / 2
        with self._work.at_arm():
            yield from self._over(within_reach(tool_m), half_s)
        self._stock.take_held()
        self._events.note("take out of the gripper")
        yield from self._work.wait(half_s)

    def _free(self, part: str) -> None:
        if "tray" in self.due:
            self.due.discard("tray")
            self._stock.fill_tray()
        self._stock.free(part)

    def _at_tray(self, duration_s: float, act: Callable[[], object]) -> Script:
        yield from self._wait_for_arm(lambda: not self._sight.arm_parked)
        x, y, _ = self._bench.tray.centre_m
        towards_x, towards_y = OVER_TRAY_M
        yield from self._over(np.array([x + towards_x, y + towards_y, TRAY_HEIGHT_M]), duration_s / 2)
        act()
        self._events.note("fill tray")
        yield from self._work.wait(duration_s / 2)

    def _over(self, target_m: np.ndarray[tuple[int], np.dtype[np.float64]], stay_s: float) -> Script:
        yield from self._work.reach(target_m, 0.0, RELAXED_GAP_M, arch_m=ARCH_M)
        yield from self._work.wait(stay_s)

    def _wait_for_arm(self, busy: Callable[[], bool]) -> Script:
        waited_s = 0.0
        while busy() and waited_s < self._habits.gives_up_s and self._polite():
            waited_s += self._work.dt_s
            yield


def goal_answer(question: Question, wanted: Mapping[str, str]) -> str:
    """Which of the offered goals is being built; "none of these" where it is no one."""
    return next((answer.value for answer in question.answers if dict(answer.placements) == dict(wanted)), UNKNOWN_GOAL)


def where_answer(question: Question, wanted: Mapping[str, str], open_positions: Container[str]) -> str:
    """Where the part belongs that is asked for: one of the open positions, or it is placed by hand."""
    legal = [answer.value for answer in question.answers]
    fitting = (name for name in legal if name in open_positions and wanted.get(name) == question.part)
    return next(fitting, PLACED_BY_HAND)


def help_answer(by_hand: bool) -> str:
    """What a person says who helps."""
    return PLACED_BY_HAND if by_hand else HELP_GIVEN


def mend_answer(question: Question, mended: bool) -> str:
    """What a person says who was told that something is wrong: that it was mended, or that it is right so."""
    legal = [answer.value for answer in question.answers]
    return HELP_GIVEN if mended or IS_RIGHT not in legal else IS_RIGHT


def choice_answer(question: Question, done: bool) -> str:
    """The first answer of a tree's own question where what it asks for is done, else the last."""
    return question.answers[0 if done else -1].value
