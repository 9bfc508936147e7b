"""The cell's state in the terms of PackML (ISA-TR88.00.02): for whoever runs a line of machines."""

from __future__ import annotations

from collections.abc import Iterable
from enum import IntEnum

from bracket_cell.production.samples import Sample

PRODUCTION = 1  # the unit mode; manual motion is no run


class State(IntEnum):
    """States of a machine, with the numbers of PackTags (ISA-TR88.00.02, 5.5)."""

    STOPPED = 2
    STARTING = 3
    IDLE = 4
    SUSPENDED = 5
    EXECUTE = 6
    ABORTED = 9
    HELD = 11
    COMPLETE = 17


OF_A_RUN = {"running": State.EXECUTE, "paused": State.HELD, "held": State.SUSPENDED}
OF_AN_END = {"finished": State.COMPLETE, "interrupted": State.STOPPED}


def state_of(samples: Iterable[Sample], *, busy: bool, ended: str | None) -> State:
    """The cell's state.

    A run that somebody paused is held; one that the cell holds itself waits for something outside: it is suspended.

    Args:
        samples: numbers as they are now.
        busy: a run goes on, begins or ends.
        ended: how the last run ended, "" where it was killed; None where there was none.
    """
    now = next((labels["state"] for name, labels, value in samples if name == "cell_state" and value), "over")
    if now in OF_A_RUN:
        return OF_A_RUN[now]
    if busy:
        return State.STARTING
    return State.IDLE if ended is None else OF_AN_END.get(ended, State.ABORTED)
