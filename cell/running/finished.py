"""Notes every finished bracket in the file of goals, so that a shift teaches the next one."""

from __future__ import annotations

from pathlib import Path

from cell.interfaces.errors import InputError
from cell.interfaces.perception import BenchView, Frame
from cell.interfaces.product import Product
from cell.observer import Level, Outcome, TickRecord
from learned.semantic.goals import OpenGoals


class FinishedBrackets:
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

    def frame(self, frame: Frame) -> None:
        """Detectors have read it."""

    def tick(self, record: TickRecord) -> None:
        self._view = record.observation.bench or self._view
        for topic, fields in record.notes:
            if topic == "bracket":
                self._shift = True
                if fields.get("finished"):
                    self._learn()

    def message(self, time_s: float, level: Level, text: str) -> None:
        """Nothing to learn."""

    def close(self, outcome: Outcome) -> None:
        if outcome.end == "finished" and not self._shift:
            self._learn()

    def _learn(self) -> None:
        if self._view is None:
            return
        seen = {position: hole.part for position, hole in self._view.holes.items()}
        parts = tuple(part for part in map(seen.get, self._product.positions) if part is not None)
        if len(parts) < len(self._product.positions):
            return
        try:
            goals = OpenGoals.load(self._path, self._product).with_bracket(parts)
        except InputError:
            return  # a hole was misread, or the file was damaged meanwhile: better nothing than a wrong goal
        goals.save(self._path)
        self.learned = next(name for name, goal in goals.finished.items() if goal.parts == parts)
