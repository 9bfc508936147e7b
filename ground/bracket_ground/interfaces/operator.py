"""The operator's channel: questions that the cell asks, what an operator says, and the state that follows from it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Literal

OrderKind = Literal[
    "acknowledge", "answer", "fastened", "finish", "goal", "job", "other", "pause", "place", "resume", "speed", "stop"
]
Pause = Literal["none", "now", "after part"]
QuestionKind = Literal["help", "mend", "goal", "where", "bracket", "choice", "text"]

ORDERS: dict[OrderKind, str] = {
    "acknowledge": "acknowledge what holds the cell",
    "answer": "answer the question with this number",
    "fastened": "a tool reports that a fastening is done: its name and the torque in Nm",
    "finish": "end the shift after this bracket",
    "goal": "say which goal is being built",
    "job": "take a work order: JSON with variant, amount and, if wanted, id, due, cancelled",
    "other": "say that it is not this goal, which it was taken for",
    "pause": "now: stand still at once; after part: take no further part",
    "place": "I place the part that the robot asks for or is about to fetch",
    "resume": "go on after a pause",
    "speed": "share of the arm's speed in percent, 10 to 100; separation may allow less",
    "stop": "end the run in a safe stop",
}
LETTERS_MAX = 200  # of an answer in words of one's own
HELP_GIVEN, PLACED_BY_HAND, IS_RIGHT = "done", "placed", "right"
SLOWEST, FASTEST = 10, 100  # percent of the arm's speed


@dataclass(frozen=True)
class Answer:
    """One way to answer a question.

    Attributes:
        value: what is said.
        words: the same for people.
        placements: of a goal, the part type by position.
    """

    value: str
    words: str
    placements: Mapping[str, str] = field(default_factory=dict)


@dataclass(frozen=True)
class Question:
    """What the cell asks a person.

    Attributes:
        number: tells the questions of a run apart, from 1.
        kind: "help" with a part, to "mend" what is wrong in the bracket, which "goal" is built, "where" a part
            goes, to change the "bracket", a "choice" of a tree's own, or a "text" that anybody may write.
        reason: why it asks.
        tried: what the robot tried before; empty where it tried nothing.
        todo: what the person should do.
        part: type of the part concerned, or empty.
        positions: holes of the bracket that are concerned.
        answers: the legal ones; none for a text, or where the cameras see what was done.
    """

    number: int
    kind: QuestionKind
    reason: str
    tried: str = ""
    todo: str = ""
    part: str = ""
    answers: tuple[Answer, ...] = ()
    positions: tuple[str, ...] = ()


@dataclass(frozen=True)
class OperatorOrder:
    """Something an operator says or presses.

    Attributes:
        value: a pause's "now" or "after part", a goal's name, a part's type, percent of speed, a work order as JSON,
            a fastening with its torque, or the answer.
        question: number of the question that is answered, None for an order that answers none.
        time_s: when the cell took it.
    """

    kind: OrderKind
    value: str = ""
    question: int | None = None
    time_s: float = 0.0


@dataclass(frozen=True)
class WorkOrder:
    """Brackets that somebody ordered: what is expected to be built next, not a command.

    Attributes:
        id: its name in log and report.
        variant: name of the goal.
        amount: how many brackets.
        due: when they are wanted (ISO 8601), or empty.
        done: how many are finished.
        cancelled: they are not wanted any more.
    """

    id: str
    variant: str
    amount: int = 1
    due: str = ""
    done: int = 0
    cancelled: bool = False

    @property
    def open(self) -> bool:
        """Whether some of it is still to be built."""
        return not self.cancelled and self.done < self.amount


@dataclass(frozen=True)
class OperatorState:
    """What the cell knows of the operator in a tick.

    Attributes:
        present: somebody is there who answers questions.
        pause: whether the cell stands still, or takes no further part.
        brackets: how many are to be made in this shift; None for until it is stopped.
        said: the newest orders, oldest first: nodes that are not ticked in every tick find them here.
        speed: share of the arm's speed that is wanted, 0.1 to 1.
        jobs: work orders that are open, the next one first; the nearest few.
    """

    present: bool = False
    pause: Pause = "none"
    brackets: int | None = None
    said: tuple[OperatorOrder, ...] = ()
    speed: float = 1.0
    jobs: tuple[WorkOrder, ...] = ()

    @property
    def job(self) -> WorkOrder | None:
        """The work order that is expected to be built now."""
        return self.jobs[0] if self.jobs else None

    def newest(self, kind: OrderKind, after_s: float) -> OperatorOrder | None:
        """The newest order of a kind that came after a time."""
        found = [order for order in self.said if order.kind == kind and order.time_s > after_s]
        return found[-1] if found else None

    def answer(self, question: int) -> str | None:
        """What was answered to a question, None as long as nothing was."""
        return next((order.value for order in self.said if order.kind == "answer" and order.question == question), None)
