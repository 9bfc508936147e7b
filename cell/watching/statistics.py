"""Counts what a run's summary shows."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable

from cell.watching.observer import Observer, TickRecord
from trees.engine.node import FAILURE, StatusChange

KEPT = 200  # reasons whose counts are remembered


class FailureCause:
    """Follows the status changes of a run; the deepest cause is the last failure that has a reason.

    In the tick in which a tree fails the leaf comes first; what stands above it has no reason of its own.
    """

    def __init__(self) -> None:
        self._last: StatusChange | None = None
        self._counts: Counter[tuple[int, str]] = Counter()

    def add(self, changes: Iterable[StatusChange]) -> None:
        """The changes of one more tick, in order."""
        for change in changes:
            if change.new is FAILURE and change.old is not FAILURE and change.feedback:
                self._last = change
                self._count(change.uid, change.feedback)

    def _count(self, uid: int, feedback: str) -> None:
        """One more; of the reasons that came long ago nobody will ask."""
        self._counts[uid, feedback] = self._counts.pop((uid, feedback), 0) + 1
        if len(self._counts) > KEPT:
            del self._counts[next(iter(self._counts))]

    def __str__(self) -> str:
        """Like "FindPart: no o9 in the tray (16 times)"; empty where nothing failed with a reason."""
        if self._last is None:
            return ""
        name = self._last.path.rpartition("/")[2].partition("::")[0]
        count = self._counts[self._last.uid, self._last.feedback]
        return f"{name}: {self._last.feedback}" + (f" ({count} times)" if count > 1 else "")


class RunStatistics(Observer):
    """An observer that keeps the last belief and counts calls for help and refused plans.

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

    def tick(self, record: TickRecord) -> None:
        self.cause.add(record.changes)
        self.help_requests += sum(topic == "help" for topic, _ in record.notes)
        self.plans_refused += sum(fields.get("decision") == "refused" for _, fields in record.notes)
        display = record.command.display
        if display is not None:
            self.goal_belief = dict(display.goal_belief) or self.goal_belief

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
