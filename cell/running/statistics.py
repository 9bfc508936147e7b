"""Counts what a run's summary tells."""

from __future__ import annotations

from cell.interfaces.perception import Frame
from cell.observer import Level, Outcome, TickRecord
from cell.running.cause import FailureCause


class RunStatistics:
    """A observer that keeps the last belief and counts calls for help and refused plans.

    Attributes:
        goal_belief: as last shown to the person.
        cause: why the tree failed, if it did.
        plans_refused: answers of learned planners that could not be used, so that the rule-based one answered.
    """

    def __init__(self) -> None:
        self.goal_belief: dict[str, float] = {}
        self.help_requests = 0
        self.cause = FailureCause()
        self.plans_refused = 0

    def frame(self, frame: Frame) -> None:
        """Images are not counted."""

    def tick(self, record: TickRecord) -> None:
        self.cause.add(record.changes)
        self.help_requests += sum(topic == "help" for topic, _ in record.notes)
        self.plans_refused += sum(fields.get("decision") == "refused" for _, fields in record.notes)
        display = record.command.display
        if display is not None:
            self.goal_belief = dict(display.goal_belief) or self.goal_belief

    def message(self, time_s: float, level: Level, text: str) -> None:
        """Messages are not counted."""

    def close(self, outcome: Outcome) -> None:
        """Nothing to do."""

    def report(self) -> dict[str, object]:
        """What was counted, by keys of `cell run --json`."""
        return {
            "inferred_goal": self.inferred_goal,
            "help_requests": self.help_requests,
            "plans_refused": self.plans_refused,
        }

    @property
    def inferred_goal(self) -> str | None:
        """The most probable goal, None before the first belief."""
        return max(self.goal_belief, key=lambda goal: self.goal_belief[goal]) if self.goal_belief else None
