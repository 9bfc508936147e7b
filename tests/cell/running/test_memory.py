"""What counts during a run needs no more memory for a long one: a shift of 8 hours has 720 000 ticks."""

from __future__ import annotations

import gc
import tracemalloc
from collections.abc import Callable

import pytest

from bracket_cell.viewing.moments import Moments
from bracket_cell.watching.lateness import Lateness
from bracket_cell.watching.observer import Observer, SentCommand, TickRecord
from bracket_cell.watching.statistics import Fluency, RunStatistics
from bracket_ground.interfaces.command import Command, Display
from bracket_ground.interfaces.devices import TruthEvent
from bracket_ground.interfaces.observation import Observation
from bracket_sim.worker.event_log import EventLog
from btxml.engine.node import StatusChange
from btxml.engine.status import Status
from tests.cell.running.test_brackets import Note
from tests.cell.running.test_finished import ARM, GRIPPER

WARM, TICKS = 4000, 16_000
LEAST_GROWTH_BYTES = 40_000  # of something that keeps 8 bytes or more a tick it would be 128 000


def growth_bytes(step: Callable[[int], object]) -> int:
    """By how much memory grows in the later ticks."""
    tracemalloc.start()
    try:
        for number in range(WARM):
            step(number)
        gc.collect()
        before = tracemalloc.get_traced_memory()[0]
        for number in range(WARM, WARM + TICKS):
            step(number)
        gc.collect()
        return tracemalloc.get_traced_memory()[0] - before
    finally:
        tracemalloc.stop()


def record(number: int) -> TickRecord:
    """A tick with everything that comes now and then, never twice the same."""
    time_s = number * 0.04
    seen = Observation(number, time_s, ARM, GRIPPER, late_s=number % 97 * 1e-4)
    change = StatusChange(f"Tree/Leaf::{number % 50}", number % 50, Status.RUNNING, Status.FAILURE, f"after {time_s} s")
    notes: tuple[Note, ...] = (
        ("help", {"text": f"question {number}"}),
        ("skill", {"status": "failure", "reason": f"no way {number}"}),
    )
    belief = {"g0": number % 10 / 10, "g1": 1 - number % 10 / 10}
    command = Command(display=Display(message=f"message {number}", goal_belief=belief))
    return TickRecord(seen, "RUNNING", (change,), notes, command, SentCommand(), 0.001, False)


@pytest.mark.long
def test_observers_that_count_stay_small() -> None:
    observers: list[Observer] = [RunStatistics(), Lateness(0.04), Fluency(lambda _: (0.0, 0.0)), Moments()]

    def step(number: int) -> None:
        one = record(number)
        for observer in observers:
            observer.tick(one)

    assert growth_bytes(step) < LEAST_GROWTH_BYTES


def test_what_the_person_did_is_forgotten_once_it_was_told() -> None:
    events = EventLog()
    told: list[TruthEvent] = []

    def step(number: int) -> None:
        events.time_s = number * 0.04
        events.begin("screw" if number % 2 else "transit")
        events.note("slip", part=f"o{number}")
        told[:] = events.news()

    assert growth_bytes(step) < LEAST_GROWTH_BYTES
    assert [event.fields.get("act") for event in told if event.kind == "act"] == ["slip"]
    assert len(told) == 3, "nothing is told twice, nothing is left out"
