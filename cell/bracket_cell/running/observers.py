"""Notifies observers; one that raises is reported, and only its own work is lost."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Sequence

from bracket_cell.running.device_reader import describe
from bracket_cell.watching.observer import Level, Observer, Outcome, TickRecord
from bracket_ground.interfaces.clock import Clock
from bracket_ground.interfaces.faults import ACKNOWLEDGE, HAND_TOO_NEAR, USUAL, SafetyDecision
from bracket_ground.interfaces.frame import Frame

ENCOUNTER_S = 2.0  # a hand that was away for less is in the same encounter
ONCE = ("tick_late",)  # a machine that is too slow is so again and again


class Announcer:
    """Remembers what was said."""

    def __init__(self) -> None:
        self._said: tuple[tuple[str, ...], ...] = ()
        self._met_s = -math.inf  # when the hand was too near last
        self._asked = False
        self._once: set[str] = set()
        self._alarm = ""

    def alarm(self, judgement: SafetyDecision, unacknowledged: bool) -> str | None:
        """The trouble that a panel is to show until somebody acknowledges it; None where it shows that already."""
        text = f"{judgement.words}; {ACKNOWLEDGE}" if unacknowledged else ""
        if bool(text) == bool(self._alarm):
            return None
        self._alarm = text
        return text

    def news(self, judgement: SafetyDecision, time_s: float, unacknowledged: bool = False) -> tuple[Level, str] | None:
        """What is to be said now, if it is something new; a hand that comes again at once is not.

        Args:
            unacknowledged: the cell waits until a person acknowledges it.
        """
        reasons = tuple(
            (signal, *_devices(words))
            for signal, words in judgement.reasons
            if signal not in USUAL and signal not in self._once
        )
        if (HAND_TOO_NEAR,) in reasons:
            self._met_s = time_s
        elif (HAND_TOO_NEAR,) in self._said and time_s - self._met_s < ENCOUNTER_S:
            reasons = (*reasons, (HAND_TOO_NEAR,))
        asks, self._asked = unacknowledged and not self._asked, unacknowledged
        if reasons == self._said and not asks:
            return None
        self._said = tuple(reason for reason in reasons if reason[0] not in ONCE)
        self._once |= {signal for signal, *_ in reasons} & set(ONCE)
        if not reasons:
            return "info", "all clear"
        if not judgement.words:  # only a hand that has just gone is left
            return None
        ending = f"; {ACKNOWLEDGE}" if unacknowledged else ""
        return "warning", f"{judgement.action.name.lower()}: {judgement.words}{ending}"


def _devices(words: str) -> list[str]:
    """Who is named in a reason: another one is news, another number is not."""
    return [part.partition(": ")[0] for part in words.split("; ") if ": " in part]


class Observers:
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
            except Exception:  # it will be noted at the next notification
                continue
