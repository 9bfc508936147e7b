"""Learns goals from the brackets that are finished."""

from __future__ import annotations

from pathlib import Path

from bracket_cell.learned.semantic.goals import OpenGoals
from bracket_cell.watching.observer import Observer, Outcome, TickRecord
from bracket_ground.errors import InputError
from bracket_ground.interfaces.perception import BenchView
from bracket_ground.interfaces.product import Product


class FinishedBrackets(Observer):
    """An observer that learns from how a run ended; what the cameras saw in the holes counts, not what was believed.

    Attributes:
        learned: the goal that the bracket ended in; None where it was not finished.
    """

    def __init__(self, path: Path, product: Product) -> None:
        self._path = path
        self._product = product
        self._view: BenchView | None = None
        self._shift = False  # brackets are noted one by one
        self.learned: str | None = None

    def tick(self, record: TickRecord) -> None:
        self._view = record.observation.bench or self._view
        for topic, fields in record.notes:
            if topic == "bracket":
                self._shift = True
                if fields.get("finished"):
                    self._learn()

    def close(self, outcome: Outcome) -> None:
        if outcome.end == "finished" and not self._shift:
            self._learn()

    def _learn(self) -> None:
        if self._view is None:
            return
        seen = {position: hole.part for position, hole in self._view.holes.items()}
        there = {at: part for at, part in seen.items() if part is not None}
        if len(there) < len(self._product.positions) and self._product.goal_of(there) is None:
            return
        parts = self._product.as_listed(there)
        try:
            goals = OpenGoals.load(self._path, self._product).with_bracket(parts)
        except InputError:
            return  # a hole was misread, or the file was damaged meanwhile: better nothing than a wrong goal
        goals.save(self._path)
        self.learned = goals.name_of(parts)
