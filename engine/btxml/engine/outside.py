"""Leaves that ask something beyond the cell: they wait in a thread, and their answers stand in the log for a replay."""

from __future__ import annotations

import json
import threading
import time
from collections import defaultdict, deque
from collections.abc import Callable, Iterable, Mapping
from contextlib import suppress
from dataclasses import dataclass
from typing import Any, Protocol

from btxml.engine.errors import NodeError
from btxml.engine.node import SUCCESS, Node, TreeNode
from btxml.engine.ports import InputPort, OutputPort
from btxml.engine.status import Status

CALLS_AT_ONCE = 16  # threads of all leaves of a class together; who finds none free waits, within its limit
LENGTH_LIMIT = 100_000  # characters of an answer: it goes into the log
_free: dict[str, threading.BoundedSemaphore] = defaultdict(lambda: threading.BoundedSemaphore(CALLS_AT_ONCE))
_mine = threading.local()  # the call that a thread makes


@dataclass(frozen=True)
class Answer:
    """What came back, as JSON, or why nothing did."""

    text: str = ""
    error: str = ""


class Asked(Protocol):
    """A question that was asked, by a leaf or in a log."""

    def poll(self, polls: int) -> Answer | None:
        """The answer, where there is one; `polls` counts from 1."""
        ...

    def cancel(self) -> None:
        """Nobody wants the answer any more."""
        ...

    @property
    def begun(self) -> bool:
        """Whether the question was asked: every thread of the class may be busy."""
        ...


class Call:
    """One call of `Outside.ask`.

    Args:
        pool: name of the threads that it shares with others.
    """

    def __init__(self, ask: Callable[[Any], Any], question: Any, pool: str = "") -> None:
        self._ask, self._question, self._free = ask, question, _free[pool]
        self.begun = self._cancelled = False
        self._answer: Answer | None = None
        self._closers: list[Callable[[], object]] = []

    def when_cancelled(self, close: Callable[[], object]) -> None:
        self._closers.append(close)
        if self._cancelled:
            self.cancel()

    def poll(self, polls: int) -> Answer | None:  # noqa: ARG002 - a log counts them
        if not self.begun and self._free.acquire(blocking=False):
            self.begun = True
            threading.Thread(target=self._work, daemon=True).start()
        return self._answer

    def cancel(self) -> None:
        self._cancelled = True
        for close in list(self._closers):
            with suppress(Exception):  # what is closed already, or not open yet, raises what it likes
                close()

    def _work(self) -> None:
        try:
            _mine.call = self
            self._answer = Answer(as_text(self._ask(self._question)))
        except Exception as error:  # a library may raise anything; the leaf fails with it
            kind = "" if isinstance(error, NodeError) else f"{type(error).__name__}: "
            self._answer = Answer(error=f"{kind}{error}"[:LENGTH_LIMIT])
        finally:
            self._free.release()


def when_cancelled(close: Callable[[], object]) -> None:
    """What ends the wait of an `ask` at once, such as to close its connection; `close` is called in another thread."""
    call: Call = _mine.call
    call.when_cancelled(close)


class LoggedAnswers:
    """What the leaves of a run were answered, for its replay, in which nobody is asked.

    Args:
        notes: of the topic `outside`, in order.
    """

    def __init__(self, notes: Iterable[Mapping[str, Any]]) -> None:
        self._notes: dict[tuple[str, str], deque[Mapping[str, Any]]] = defaultdict(deque)
        for note in notes:
            self._notes[note["node"], note["question"]].append(note)

    def next(self, node: str, question: str) -> Asked:
        """What came of the question then; asked by another node in a changed tree, it has the same answer."""
        others = (key for key, notes in self._notes.items() if key[1] == question and notes)
        notes = self._notes.get((node, question)) or self._notes.get(next(others, ("", "")))
        return _Logged(notes.popleft() if notes else {"polls": 1, "error": f"the log has no answer to {question}"})


class _Logged:
    begun = True

    def __init__(self, note: Mapping[str, Any]) -> None:
        self._note = note

    def poll(self, polls: int) -> Answer | None:
        if polls < self._note["polls"] or self._note.get("cancelled"):
            return None
        return Answer(self._note.get("answer", ""), self._note.get("error", ""))

    def cancel(self) -> None:
        pass


class Question:
    """What a node asked of somebody beyond the cell, or in a replay of the log; how it ended is noted."""

    def __init__(self, node: TreeNode, question: Any, ask: Callable[[], Asked]) -> None:
        self._runtime, self._node, self._text, self._polls = node.runtime, node.full_path, as_text(question), 0
        log = self._runtime.answers
        self._asked = ask() if log is None else log.next(self._node, self._text)

    def poll(self) -> Answer | None:
        """The answer in the tick in which it is there, else None."""
        self._polls += 1
        answer = self._asked.poll(self._polls)
        if answer is not None:
            self._note(**({"error": answer.error} if answer.error else {"answer": answer.text}))
        return answer

    def give_up(self, why: Callable[[bool], str]) -> Answer:
        """Wait no longer; `why` says it by whether the question was asked at all."""
        self._asked.cancel()
        answer = Answer(error=why(self._asked.begun))
        self._note(error=answer.error)
        return answer

    def cancel(self) -> None:
        """Nobody wants the answer any more."""
        self._asked.cancel()
        self._note(cancelled=True)

    def _note(self, **came: object) -> None:
        if self._runtime.journal is not None:
            self._runtime.journal.note("outside", node=self._node, question=self._text, polls=self._polls, **came)


class Outside(Node):
    """Base of leaves that ask something beyond the cell: a server, a database, a slow computation.

    `question` is asked in the tick and says what to ask, `ask` runs in a thread and may take its time, `take` gets the
    answer in the tick in which it is there. Questions and answers are plain data: they stand in the log. A halt
    cancels the call; so does the limit, and then the leaf fails, as it does where `ask` raises anything.
    """

    abstract = True

    limit_s = InputPort(float, "wall time in [s] after which nobody waits any more", default=10.0)
    result: Any = OutputPort(Any, "what was answered")
    error = OutputPort(str, "why there is no answer; empty where there is one")

    _asked: Question | None = None

    def question(self) -> Any:
        """What to ask: plain data, made of the ports."""
        return None

    def ask(self, question: Any) -> Any:
        """Ask, and wait for the answer; in a thread, so no ports and no services."""
        raise NotImplementedError

    def take(self, answer: Any) -> Status:
        """Do something with the answer."""
        self.result.set(answer)
        return SUCCESS

    def initialise(self) -> None:
        self._until_s, question = time.monotonic() + self.limit_s.get(), self.question()
        self._asked = Question(self, question, lambda: self.call(question))

    def call(self, question: Any) -> Asked:
        """Begin to ask."""
        return Call(self.ask, question, type(self).__name__)

    def update(self) -> Status:
        assert self._asked is not None, "initialise comes first"
        answer = self._asked.poll()
        if answer is None and self.runtime.answers is None and time.monotonic() >= self._until_s:
            answer = self._asked.give_up(self._late)
        if answer is None:
            return Status.RUNNING
        self._asked = None
        self.error.set(answer.error)
        if answer.error:
            raise NodeError(answer.error)
        return self.take(json.loads(answer.text))

    def _late(self, asked: bool) -> str:
        if asked:
            return f"there was no answer within {self.limit_s.get():g} s"
        name = type(self).__name__
        return f"nobody was asked within {self.limit_s.get():g} s: {CALLS_AT_ONCE} earlier calls of {name} do not end"

    def terminate(self, new_status: Status) -> None:  # noqa: ARG002 - whatever ended it
        if self._asked is not None:
            self._asked.cancel()
            self._asked = None


def as_text(value: Any) -> str:
    """Plain data as the log keeps it.

    Raises:
        NodeError: it is none, or too much.
    """
    try:
        text = json.dumps(value, allow_nan=False)
    except (TypeError, ValueError, RecursionError) as error:
        raise NodeError(f"{type(value).__name__} is no plain data, as a log can keep it: {error}") from None
    if len(text) > LENGTH_LIMIT:
        raise NodeError(f"{len(text)} characters are too many for the log; at most {LENGTH_LIMIT}")
    return text
