"""Orders that an operator types into the terminal, or pipes in: the same as on the page, one a line."""

from __future__ import annotations

import os
import threading
from collections.abc import Callable, Iterable, Iterator, Sequence

from bracket_ground.errors import InputError
from bracket_ground.interfaces.operator import ORDERS, OperatorOrder, Question
from bracket_ground.interfaces.planning import UNKNOWN_GOAL

HELP = (
    "orders: pause, pause after part, resume, goal NAME, goal new, place PART, acknowledge, finish, stop, NUMBER ANSWER"
)
SHORT = {"ack": "acknowledge", "p": "pause", "r": "resume"}
NEW = {"new": UNKNOWN_GOAL, "a new one": UNKNOWN_GOAL}


def typed_lines(descriptor: int) -> Iterator[str]:
    """Lines of a terminal or a pipe, until it ends.

    Read without the interpreter's own buffer: a thread that waits in that one makes the interpreter abort as it ends.
    """
    rest = b""
    while piece := os.read(descriptor, 4096):
        *lines, rest = (rest + piece).split(b"\n")
        yield from (line.decode("utf-8", "replace") for line in lines)
    if rest:
        yield rest.decode("utf-8", "replace")


class TypedOrders:
    """Reads lines in a thread of its own, until they end.

    Args:
        lines: what is typed.
        obey: takes an order; raises InputError for one that makes no sense now.
        questions: that stand now.
        say: answers the one who types.
    """

    def __init__(
        self,
        lines: Iterable[str],
        obey: Callable[[OperatorOrder], None],
        questions: Callable[[], Sequence[Question]],
        say: Callable[[str], None],
    ) -> None:
        self._lines, self._obey, self._questions, self._say = lines, obey, questions, say
        threading.Thread(target=self._listen, name="typed orders", daemon=True).start()

    def _listen(self) -> None:
        for line in self._lines:
            if line.strip():
                self.take(line)

    def take(self, line: str) -> None:
        """Obey one line, or say why not."""
        try:
            self._obey(order_of(line, self._questions()))
        except InputError as error:
            self._say(f"{error}\n{HELP}")


def order_of(line: str, questions: Sequence[Question] = ()) -> OperatorOrder:
    """The order in a line; an answer may leave out the number where one question stands.

    A text of one's own needs the number, so that no order is taken for one.

    Raises:
        InputError: there is none in it.
    """
    words = line.strip().lower()
    first, _, rest = words.partition(" ")
    rest = rest.strip()
    first = SHORT.get(first, first)
    number, answer = (int(first), rest) if first.isdecimal() else (None, words)
    asked = [one for one in questions if one.answers and number in (None, one.number)]
    for question in asked:
        for choice in question.answers:
            if NEW.get(answer, answer) in (choice.value, choice.words):
                return OperatorOrder("answer", choice.value, question.number)
    if number is not None:
        wants_text = any(one.kind == "text" and one.number == number for one in questions)
        return OperatorOrder("answer", line.strip().partition(" ")[2].strip() if wants_text else answer, number)
    if first == "pause":
        return OperatorOrder("pause", "now" if rest in ("", "now") else "after part")
    if first == "goal":
        return OperatorOrder("goal", NEW.get(rest, rest))
    if first == "other":
        return OperatorOrder("other", rest)
    if first == "place":
        return OperatorOrder("place", rest)
    if first in ("acknowledge", "finish", "resume", "stop") and not rest:
        return OperatorOrder(first)  # type: ignore[arg-type]
    raise InputError(f"no order {line.strip()!r}; there are {', '.join(ORDERS)}")
