"""How the person waits for the robot: until the arm is out of the way, begins, or has stood still for long."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np

from sim.scene.person import BesideRobot, happens
from sim.worker.event_log import EventLog
from sim.worker.hand_primitives import HandPrimitives, Script
from sim.worker.worker_sight import Sight


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
        polite = happens(self._habits.waits, self._chance)
        if not polite:
            self._events.note("does not wait")
        return polite

    def begins(self) -> Script:
        """Until the arm leaves its parking place, or a part is asked for."""
        yield from self.while_true(lambda: self._sight.arm_parked and not self._asked(), self._habits.begins_s)

    def works(self, handed: Callable[[], bool]) -> Script:
        """While the arm moves or is not parked; not where it just stands there, asks for help or holds a part out."""
        still_s = 0.0
        while not self._sight.arm_parked and still_s < self._habits.stands_s:
            if handed() or (self._asked() and not self._sight.arm_over_bracket):
                return
            busy = self._sight.arm_moving or self._sight.arm_over_bracket
            still_s = 0.0 if busy else still_s + self._work.dt_s
            yield

    def while_true(self, condition: Callable[[], bool], longest_s: float = math.inf) -> Script:
        """As long as something is so, but not for ever."""
        waited_s = 0.0
        while condition() and waited_s < longest_s:
            waited_s += self._work.dt_s
            yield
