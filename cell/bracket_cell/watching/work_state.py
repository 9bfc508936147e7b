"""Which state the work is in, from what skills note: faults come in a state, and contacts are told by it."""

from __future__ import annotations

from bracket_cell.watching.observer import TickRecord

# By how a skill's note begins.
STATES = {
    "look": "moving to look",
    "above": "moving above",
    "down": "going down",
    "grasp": "grasping",
    "lift": "lifting",
    "carry": "carrying",
    "lower": "lowering",
    "release": "letting go",
    "leave": "leaving",
    "park": "moving to park",
}
STARTING = "activating"  # of the fingers: not idle yet
OTHER_STATES = ("idle", "waiting_for_help")


class WorkState:
    """Which state the work is in, from what skills note.

    Attributes:
        name: of STATES or OTHER_STATES; "start" before the arm is ready.
        ticks: how long it has been that.
    """

    def __init__(self) -> None:
        self.name, self.ticks = "start", 0

    def see(self, record: TickRecord) -> None:
        """A tick is over."""
        before = self.name
        for topic, fields in record.notes:
            if topic == "help":
                self.name = "waiting_for_help"
            elif topic == "skill":
                reason = str(fields.get("reason", ""))
                other = "start" if reason.startswith(STARTING) or self.name == "start" else "idle"
                self.name = next((name for name, start in STATES.items() if reason.startswith(start)), other)
        self.ticks = self.ticks + 1 if self.name == before else 0
