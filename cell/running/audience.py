"""Tells observers what happens; one that raises is told of and left out of nothing but its own work."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence

from cell.interfaces.clock import Clock
from cell.interfaces.perception import Frame
from cell.observer import Level, Observer, Outcome, TickRecord
from cell.running.reading import describe


class Audience:
    """All observers of a run: none of them has power over it.

    Attributes:
        problems: what observers raised, each sort once, in words.
        took_s: how long they took over the last tick, on the wall.
    """

    def __init__(self, observers: Sequence[Observer], clock: Clock) -> None:
        self._observers = tuple(observers)
        self._clock = clock
        self.problems: list[str] = []
        self.took_s = 0.0

    def frame(self, frame: Frame) -> None:
        """A camera frame arrived."""
        self._tell(lambda observer: observer.frame(frame))

    def tick(self, record: TickRecord) -> None:
        """A tick is done."""
        began_s = time.perf_counter()
        self._tell(lambda observer: observer.tick(record))
        self.took_s = time.perf_counter() - began_s

    def say(self, level: Level, text: str) -> None:
        """The controller says something."""
        self._tell(lambda observer: observer.message(self._clock.now_s(), level, text))

    def close(self, outcome: Outcome) -> None:
        """The run is over."""
        self._tell(lambda observer: observer.close(outcome))

    def _tell(self, what: Callable[[Observer], None]) -> None:
        for observer in self._observers:
            try:
                what(observer)
            except Exception as error:  # a full disk or a broken viewer never changes how the arm moves
                self._note(f"{type(observer).__name__}: {describe(error)}", observer)

    def _note(self, problem: str, failed: Observer) -> None:
        if problem in self.problems:
            return
        self.problems.append(problem)
        for observer in self._observers:
            if observer is failed:
                continue
            try:
                observer.message(self._clock.now_s(), "warning", f"an observer failed: {problem}; the run goes on")
            except Exception:  # it will be noted when it is told something else
                continue
