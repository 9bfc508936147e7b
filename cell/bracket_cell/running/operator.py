"""The operator channel: questions go out to whoever shows them, orders come in from panel, page and terminal."""

from __future__ import annotations

import re
from collections import deque
from collections.abc import Iterable, Sequence
from dataclasses import replace
from typing import get_args

from bracket_cell.running.work_orders import WorkOrders
from bracket_ground.errors import InputError
from bracket_ground.files.words.message import Message
from bracket_ground.interfaces.command import Display
from bracket_ground.interfaces.operator import (
    FASTEST,
    LETTERS_MAX,
    SLOWEST,
    OperatorOrder,
    OperatorState,
    OrderKind,
    Question,
)
from bracket_ground.interfaces.planning import UNKNOWN_GOAL

KEPT = 8  # orders that nodes may still want to read
TORQUE = re.compile(r"\d{1,4}(\.\d{1,3})?")
WAITING = 64  # orders that may wait for a tick


class OperatorChannel:
    """Takes orders from any thread; a tick takes them over, in the order in which they came.

    Args:
        goals: names that may be said.
        present: somebody is there who answers questions.
        brackets: how many are to be made; None for until it is stopped.
        shift: one bracket after the other is made, so that there is something to finish.
        jobs: the work orders.
        fastenings: names of the product's.

    Attributes:
        questions: that stand now.
        acknowledged: since the state was asked for last; also by the order to go on that has to follow.
        stopped: the operator ended the run.
        jobs: the work orders.
    """

    def __init__(
        self,
        goals: Iterable[str] = (),
        present: bool = False,
        brackets: int | None = None,
        shift: bool = True,
        jobs: WorkOrders | None = None,
        fastenings: Iterable[str] = (),
    ) -> None:
        goals = tuple(goals)
        self._goals = {*goals, UNKNOWN_GOAL}
        self._shift, self._asked, self._fastenings = shift, False, tuple(fastenings)
        self.jobs = WorkOrders({goal: goal for goal in goals}) if jobs is None else jobs
        self._state = OperatorState(present, brackets=brackets)
        self._waiting: deque[OperatorOrder] = deque()
        self.questions: tuple[Question, ...] = ()
        self.acknowledged = self.stopped = self._reset = False

    def put(self, order: OperatorOrder) -> None:
        """Take an order; the next tick knows of it.

        Raises:
            InputError: there is nothing like that to be said now.
        """
        if problem := self.refusal(order):
            raise InputError(problem)
        self._waiting.append(order)

    def press(self, order: OperatorOrder) -> None:
        """Take an order of a person who must hear whether it changes anything.

        Raises:
            InputError: it would not, or there is nothing like that to be said now.
        """
        if problem := self._in_vain(order):
            raise InputError(problem)
        self.put(order)

    def refusal(self, order: OperatorOrder) -> str:
        """Why an order cannot be taken now; empty where it can."""
        said, kinds = f"{order.value!r}", get_args(OrderKind)
        if order.kind not in kinds:
            return Message("no order {kind}; legal: {legal}", kind=f"{order.kind!r}", legal=", ".join(kinds))
        if len(self._waiting) >= WAITING:
            return "too many orders at once"
        if order.kind == "pause" and order.value not in ("now", "after part"):
            return Message("a pause is 'now' or 'after part', not {value}", value=said)
        if order.kind in ("goal", "other") and order.value not in self._goals:
            return Message("no goal {value}; legal: {goals}", value=said, goals=", ".join(sorted(self._goals)))
        if order.kind == "speed" and not (order.value.isdecimal() and SLOWEST <= int(order.value) <= FASTEST):
            return Message("a speed is {least} to {most} percent", least=SLOWEST, most=FASTEST)
        if order.kind == "fastened" and not self._fastening(order.value):
            legal = ", ".join(self._fastenings) or "none"
            return Message("no fastening and torque in Nm: {value}; fastenings: {legal}", value=said, legal=legal)
        if order.kind == "job":
            try:
                self.jobs.checked(order.value)
            except InputError as error:
                return str(error)
        return self._no_answer(order) if order.kind == "answer" else ""

    def _fastening(self, value: str) -> bool:
        """Whether a value is a fastening's name, and a torque [Nm] where it has one."""
        name, _, torque = value.partition(" ")
        return name in self._fastenings and (not torque or TORQUE.fullmatch(torque) is not None)

    def _in_vain(self, order: OperatorOrder) -> str:
        """Why an order would change nothing now; empty where it would."""
        state = self._state
        if order.kind == "resume" and state.pause == "none" and not self._reset:
            return "nothing is paused"
        if order.kind == "pause" and state.pause == ("now" if order.value == "now" else "after part"):
            return "it is paused already"
        if order.kind == "acknowledge" and not self._asked:
            return "nothing waits to be acknowledged"
        if order.kind == "finish" and not self._shift:
            return "this run makes one bracket, and ends after it in any case"
        if order.kind == "finish" and state.brackets == 0:
            return "this bracket is the last one already"
        if order.kind == "place" and not order.value:
            return "no part is asked for"
        return ""

    def _no_answer(self, order: OperatorOrder) -> str:
        said, number = f"{order.value!r}", order.question
        question = next((asked for asked in self.questions if asked.number == number), None)
        if question is None:
            standing = ", ".join(str(asked.number) for asked in self.questions) or "none"
            return Message(
                "no question {question} is asked now; questions: {standing}", question=number, standing=standing
            )
        if question.kind == "text":
            legal_text = 0 < len(order.value.strip()) <= LETTERS_MAX and order.value.isprintable()
            return "" if legal_text else Message("an answer is a line of 1 to {most} letters", most=LETTERS_MAX)
        answers = [answer.value for answer in question.answers]
        legal = ", ".join(answers) or "nothing"
        if order.value in answers:
            return ""
        return Message(
            "{value} answers no question {question}; legal: {legal}", value=said, question=number, legal=legal
        )

    def shown(self, display: Display) -> None:
        """What the cell shows from now on, questions among it."""
        self.questions = display.questions
        self._goals |= set(display.goal_belief)

    def take(self, time_s: float, pressed: Sequence[OperatorOrder] = (), *, asked: bool = False) -> OperatorState:
        """The state with everything that was said since the last call.

        Args:
            pressed: at the bench itself; what makes no sense now is passed over.
            asked: something waits for a person. To acknowledge it starts no motion: the cell is paused from then on,
                and goes on by a second order (ISO 13849-1, manual reset).
        """
        self.acknowledged, self._asked = False, asked
        orders = [order for order in pressed if not self.refusal(order)]
        while self._waiting:
            orders.append(self._waiting.popleft())
        for order in orders:
            self._obey(replace(order, time_s=time_s), asked)
        jobs = self.jobs.open(time_s)
        if jobs != self._state.jobs:
            self._state = replace(self._state, jobs=jobs)
        return self._state

    def _obey(self, order: OperatorOrder, asked: bool) -> None:
        state = self._state
        if order.kind == "acknowledge":
            self.acknowledged = True
            self._reset |= asked
            state = replace(state, pause="now") if asked else state
        elif order.kind == "stop":
            self.stopped = True
        elif order.kind == "pause":
            state = replace(state, pause="now" if order.value == "now" else "after part")
        elif order.kind == "resume":
            self.acknowledged |= self._reset
            self._reset = False
            state = replace(state, pause="none")
        elif order.kind == "speed":
            state = replace(state, speed=int(order.value) / 100)
        elif order.kind == "job":
            self.jobs.put(order.value)
        elif order.kind == "finish":
            state = replace(state, brackets=0)
        else:
            state = replace(state, said=(*state.said, order)[-KEPT:])
        self._state = state
