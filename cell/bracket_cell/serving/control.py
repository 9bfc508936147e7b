"""What may be asked and ordered of a served cell: of the run that goes on, and between runs of its book."""

from __future__ import annotations

import asyncio
import json
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

from bracket_cell.production.book import Book, BracketRow
from bracket_cell.production.samples import Sample, Samples
from bracket_cell.running.work_orders import WorkOrders
from bracket_cell.serving.launcher import Launcher
from bracket_cell.serving.relay import asked
from bracket_ground.errors import InputError


class CellControl:
    """One cell.

    Args:
        book: of all runs.
        titles: of the product's variants, for people.
        may_begin: runs may be begun by others, with these further options for each; None where they may not.
    """

    def __init__(
        self, launcher: Launcher, book: Book, titles: Mapping[str, str], may_begin: Callable[[], list[str]] | None
    ) -> None:
        self.launcher, self.book, self.titles, self.may_begin = launcher, book, titles, may_begin
        self._between = Samples(book)

    @property
    def busy(self) -> bool:
        """A run goes on, begins or ends."""
        return self.launcher.busy

    @property
    def ended(self) -> str | None:
        """How the last run ended, "" where it was killed; None where there was none."""
        runs = self.book.runs(1)
        return runs[-1].ended if runs else None

    async def samples(self) -> Sequence[Sample]:
        """The numbers as they are now.

        Raises:
            TimeoutError: a run goes on and does not answer.
        """
        if (answer := await self._of_the_run("/samples")) is None:
            return await asyncio.to_thread(self._between)
        status, body = answer
        if status >= 400:
            raise TimeoutError("the run is of another version, and has no numbers")
        return [(name, labels, value) for name, labels, value in json.loads(body)]

    async def order(self, order: Mapping[str, Any]) -> None:
        """Give an order; a work order is taken between runs, too.

        Raises:
            InputError: it is refused.
            TimeoutError: a run goes on and does not answer.
        """
        if (answer := await self._of_the_run("/order", json.dumps(order).encode())) is not None:
            status, body = answer
            if status >= 400:
                raise InputError(body.decode("utf-8", "replace"))
            return
        if order.get("kind") != "job" or self.busy:
            raise InputError("no run goes on")
        WorkOrders(self.titles, book=self.book).put(str(order.get("value")))

    async def _of_the_run(self, target: str, body: bytes | None = None) -> tuple[int, bytes] | None:
        """Status and answer of the run; None where none goes on."""
        try:
            async with asked(self.launcher.socket, target, "operate", body) as answer:
                return answer.status, await answer.body()
        except TimeoutError:
            raise
        except OSError:
            return None

    def orders(self) -> list[dict[str, Any]]:
        """Work orders that are open."""
        return [order for order in self.book.orders() if not order["cancelled"] and order["done"] < order["amount"]]

    def brackets(self, last: int) -> Sequence[BracketRow]:
        """The newest of the book, in order."""
        return self.book.brackets(last=last)

    def begin(self, operator: str, *, resume: bool) -> None:
        """Begin a run, or go on with the last one.

        Raises:
            InputError: one goes on, or nobody may.
        """
        if self.may_begin is None:
            raise InputError("runs are begun at the cell alone: page.begin in the configuration")
        runs = self.book.runs(1)
        self.launcher.begin(operator, Path(runs[-1].log) if resume and runs else None, self.may_begin())
