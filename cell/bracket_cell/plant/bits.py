"""The cell's state as digital outputs, and orders of a PLC by digital inputs: one table in the configuration."""

from __future__ import annotations

import threading
from collections.abc import Callable, Collection, Mapping
from contextlib import AbstractContextManager, suppress
from typing import Protocol

from bracket_cell.settings import BitSettings, Shown
from bracket_cell.watching.observer import Observer, Outcome, TickRecord
from bracket_ground.errors import CellError, DeviceFault
from bracket_ground.interfaces.devices import Signals
from bracket_ground.interfaces.faults import Action
from bracket_ground.interfaces.operator import OperatorOrder
from bracket_ground.interfaces.product import Product

LOOKS_S, AGAIN_S, STOPS_S, BLINKS_N = 0.05, 5.0, 10.0, 40  # [s], [s], [s], looks of a watchdog's two halves
LESS = ("pause", "finish", "stop")  # orders after which the cell does less
PLC = "PLC"  # who begins a run, for the book


class PlantBits(Observer):
    """An observer that sets outputs, and orders where an input becomes true.

    Inputs that are true when a run begins order nothing until they were false. What rose while the PLC was silent
    orders late only where the cell does less for it: who pressed to go on may stand elsewhere by now.

    Args:
        put: takes orders, as those of the page.
    """

    def __init__(
        self, settings: BitSettings, signals: Signals, product: Product, put: Callable[[OperatorOrder], None]
    ) -> None:
        self._settings, self._signals, self._put = settings, signals, put
        self._goals = tuple(product.goals)
        self._set: dict[str, bool] = {}
        self._was: Mapping[str, bool] = {}  # as last heard
        self._heard: Collection[str] = ()  # in the tick before
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
                "ready": False,
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
            heard = name in self._heard or kind in LESS
            if known.get(name) and self._was.get(name) is False and heard:
                self._put(OperatorOrder(kind, "now" if kind == "pause" else ""))
        if all(name in known for name in self._settings.recipe):  # else nobody knows the number
            recipe = sum(1 << digit for digit, name in enumerate(self._settings.recipe) if known[name])
            if recipe != self._recipe and 0 < recipe <= len(self._goals):
                self._put(OperatorOrder("goal", self._goals[recipe - 1]))
            self._recipe = recipe
        self._was, self._heard = {**self._was, **known}, known.keys()


class Control(Protocol):
    """A cell that is served."""

    @property
    def busy(self) -> bool:
        """A run goes on, begins or ends."""
        ...

    def begin(self, operator: str, *, resume: bool) -> None:
        """Begin a run; raises InputError where that is refused."""
        ...


class WaitingBits:
    """The same between the runs of a served cell, where no run has the signals: a PLC begins the next.

    An input that is true as this begins to look begins nothing until it was false. A recipe that stays set is taken by
    the run itself.

    Args:
        opened: the signals, which are let go of while a run goes on.
        say: what a person should know.
    """

    def __init__(
        self,
        settings: BitSettings,
        opened: Callable[[], AbstractContextManager[Signals]],
        control: Control,
        say: Callable[[str], None],
    ) -> None:
        self._settings, self._opened, self._control, self._say = settings, opened, control, say
        self._told = ""
        self._over = threading.Event()
        self._thread = threading.Thread(target=self._run, name="bits", daemon=True)
        self._thread.start()

    def close(self) -> None:
        """Begin nothing more."""
        self._over.set()
        self._thread.join(STOPS_S)

    def _run(self) -> None:
        while not self._over.wait(LOOKS_S):
            if self._control.busy:
                continue
            try:
                with self._opened() as signals:
                    begins = self._asked(signals)
                if begins:
                    self._control.begin(PLC, resume=False)
                self._tell("")
            except CellError as error:
                self._tell(f"signals: {error}")
                self._over.wait(AGAIN_S)

    def _asked(self, signals: Signals) -> bool:
        """Wait until the PLC begins a run, or somebody else did."""
        was: bool | None = None
        number, ready = 0, self._settings.shows.get("ready")
        while not (self._over.wait(LOOKS_S) or self._control.busy):
            with suppress(DeviceFault):  # silent: nobody begins
                now = signals.read().get(self._settings.begin)
                if now and was is False:
                    return True
                was = now
            self._show(signals, ready, True)
            self._show(signals, self._settings.shows.get("watchdog"), number % BLINKS_N < BLINKS_N / 2)
            number += 1
        return False

    @staticmethod
    def _show(signals: Signals, name: str | None, value: bool) -> None:
        if name is not None:
            signals.write(name, value)

    def _tell(self, text: str) -> None:
        if text and text != self._told:
            self._say(text)
        self._told = text
