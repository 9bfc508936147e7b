"""The cell's state as digital outputs, and orders of a PLC by digital inputs: one table in the configuration."""

from __future__ import annotations

from collections.abc import Callable, Mapping

from bracket_cell.settings import BitSettings, Shown
from bracket_cell.watching.observer import Observer, Outcome, TickRecord
from bracket_ground.interfaces.devices import Signals
from bracket_ground.interfaces.faults import Action
from bracket_ground.interfaces.operator import OperatorOrder
from bracket_ground.interfaces.product import Product


class PlantBits(Observer):
    """An observer that sets outputs, and orders where an input becomes true.

    Inputs that are true when a run begins order nothing until they were false.

    Args:
        put: takes orders, as those of the page.
    """

    def __init__(
        self, settings: BitSettings, signals: Signals, product: Product, put: Callable[[OperatorOrder], None]
    ) -> None:
        self._settings, self._signals, self._put = settings, signals, put
        self._goals = tuple(product.goals)
        self._set: dict[str, bool] = {}
        self._was: Mapping[str, bool] = {}
        self._asks = False
        self._recipe = 0

    def tick(self, record: TickRecord) -> None:
        self._order(record.observation.signals)
        seen, judged = record.observation, record.judgement
        held = judged is not None and judged.action >= Action.HOLD
        if record.command.display is not None:
            self._asks = bool(record.command.display.questions)
        self._show(
            {
                "running": not held and seen.operator.pause == "none",
                "held": held,
                "question": self._asks,
                "holding": seen.gripper.holding,
                "over": False,
                "watchdog": int(seen.time_s) % 2 == 1,
            }
        )

    def close(self, outcome: Outcome) -> None:  # noqa: ARG002 - a PLC is told that it is over, not how
        self._show({"running": False, "held": False, "question": False, "over": True})

    def _show(self, states: Mapping[Shown, bool]) -> None:
        for state, name in self._settings.shows.items():
            if state in states and self._set.get(name) is not states[state]:
                self._signals.write(name, states[state])
                self._set[name] = states[state]

    def _order(self, known: Mapping[str, bool]) -> None:
        for kind, name in self._settings.orders.items():
            if known.get(name) and self._was.get(name) is False:
                self._put(OperatorOrder(kind, "now" if kind == "pause" else ""))
        recipe = sum(1 << digit for digit, name in enumerate(self._settings.recipe) if known.get(name))
        if recipe != self._recipe and 0 < recipe <= len(self._goals):
            self._put(OperatorOrder("goal", self._goals[recipe - 1]))
        self._recipe = recipe
        self._was = known
