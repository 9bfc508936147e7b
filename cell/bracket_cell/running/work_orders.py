"""Work orders: which brackets are wanted, from a file that may grow and from an operator; changes of them are told."""

from __future__ import annotations

import json
import math
from collections import Counter
from collections.abc import Mapping
from dataclasses import asdict, replace
from datetime import datetime
from pathlib import Path
from typing import Any

from bracket_cell.production.book import Book
from bracket_ground.errors import InputError, Place, Problem, mistakes
from bracket_ground.files.files import read_text
from bracket_ground.files.words.message import Message
from bracket_ground.interfaces.operator import WorkOrder

LOOK_S = 1.0  # so often the file is looked at
NEXT_N = 5  # orders that a tick knows of
MOST_N, AMOUNT_MOST, ID_MOST, DIGITS = 10_000, 100_000, 60, 4000  # of a number; Python reads no more
TOLD_N = 20  # lines that are no orders, of one look: a tick has no time for a file of them
REST = "mend those before, and write these anew at the end"
DUE = "2026-11-26T14:00"
KEYS: dict[str, tuple[type, str]] = {
    "id": (str, 'text, as "A17"'),
    "variant": (str, "text"),
    "amount": (int, "a whole number"),
    "due": (str, f'text, as "{DUE}"'),
    "cancelled": (bool, "true or false"),
}
ORDER = f'a line is an order, as {{"id": "A17", "variant": "%s", "amount": 2, "due": "{DUE}"}}'


class WorkOrders:
    """The queue of orders; what was finished for each is in the book.

    A later line with the same id changes its order, whatever was finished of it stays; so does a line that is edited.

    Args:
        variants: that the product has, with their titles for people; either names a variant.
        path: JSON lines, one order each; None where orders come from an operator alone. Where the book outlives the
            run, each has its id: the next run reads the file again.
        book: that has the brackets; orders are written there, and those of earlier runs are read from it.

    Attributes:
        news: changes that people are to be told of.

    Raises:
        InputError: the file cannot be read, or a line of it is no order.
    """

    def __init__(self, variants: Mapping[str, str], path: Path | None = None, book: Book | None = None) -> None:
        self._variants, self._path, self._book = dict(variants), path, book or Book()
        self._example = f"; {ORDER % next(iter(variants), '')}"
        self._orders = self._written()
        self._looked_s, self._text, self._unread = -math.inf, "", ""
        self._open: tuple[WorkOrder, ...] = ()
        self._known = -1  # changes of the book that are known
        self.news: list[Message] = []
        if path is not None:
            problems = self._look()
            if problems:
                raise InputError(*problems)
        self.news.clear()

    def open(self, time_s: float) -> tuple[WorkOrder, ...]:
        """Orders that are to be built, the next one first; looks now and then whether the file has grown."""
        if self._path is not None and time_s - self._looked_s >= LOOK_S:
            self._looked_s = time_s
            self._look_again()
        if self._known != self._book.changes:
            self._known = self._book.changes
            self._orders = self._written()
            left = [order for order in self._orders.values() if order.open and order.variant in self._variants]
            self._open = tuple(sorted(left, key=lambda order: (not order.due, order.due))[:NEXT_N])
        return self._open

    def put(self, text: str) -> None:
        """Take an order as JSON; one without an id gets a number.

        Raises:
            InputError: it is none.
        """
        self._take(self.checked(text))

    def checked(self, text: str, named: bool = False) -> WorkOrder:
        """An order as JSON.

        Args:
            named: it must have an id.

        Raises:
            InputError: it is none.
        """
        try:
            read = json.loads(text, parse_int=lambda digits: int(digits[:DIGITS]), object_pairs_hook=_fields)
        except (ValueError, RecursionError) as error:
            raise InputError(f"this is no work order: it {mistakes(error)[0]}{self._example}") from None
        try:
            return self._order(read, named)
        except ValueError as error:
            raise InputError(f"this is no work order: {error}") from None

    def _written(self) -> dict[str, WorkOrder]:
        return {row["id"]: WorkOrder(**row) for row in self._book.orders()}

    def _take(self, order: WorkOrder) -> None:
        before = self._orders.get(order.id)
        if order == before:
            return
        self._orders[order.id] = order
        self._book.order(order.id, order.variant, order.amount, order.due, cancelled=order.cancelled)
        about = {"id": order.id, "variant": self._variants[order.variant], "amount": order.amount}
        if order.cancelled:
            self.news.append(Message("work order {id} was cancelled", id=order.id))
        elif before is None:
            self.news.append(Message("work order {id}: {amount} of {variant}", **about))
        else:
            self.news.append(Message("work order {id} was changed: {amount} of {variant}", **about))

    def _look_again(self) -> None:
        try:
            problems, self._unread = self._look(), ""
        except InputError as error:
            if str(error) != self._unread:
                self._unread = str(error)
                self.news.append(Message("{problem}; the orders that are known stay", problem=self._unread))
            return
        self.news += [Message("{problem}; this line is passed over", problem=str(problem)) for problem in problems]

    def _look(self) -> list[Problem]:
        """Take lines that came to the file, or were edited, since it was read last; of a growing one whole lines only.

        Raises:
            InputError: it cannot be read.
        """
        assert self._path is not None
        text = read_text(self._path).removeprefix("\ufeff")
        whole = text[: text.rfind("\n") + 1] if self._looked_s > -math.inf else text
        if whole in ("", self._text):
            return []
        known, self._text, problems, example = Counter(self._text.split("\n")), whole, [], self._example
        for number, line in enumerate(whole.split("\n"), 1):
            known[line] -= 1
            if known[line] < 0 and line.strip():
                try:
                    self._take(self.checked(line, named=self._book.path is not None))
                except InputError as error:
                    text = str(error)
                    if self._example in text:  # once is enough
                        text, example = text.replace(self._example, example), ""
                    problems.append(Problem(Place(self._path, number), text))
            if len(problems) == TOLD_N:
                problems.append(Problem(Place(self._path, number + 1), "lines from here on were not read", REST))
                break
        return problems

    def _order(self, read: Any, named: bool) -> WorkOrder:
        if not isinstance(read, Mapping):
            raise ValueError(f"it is an object with the keys {', '.join(KEYS)}")
        if unknown := [str(key) for key in read if key not in KEYS]:
            raise ValueError(f"no key {unknown[0]!r}; legal: {', '.join(KEYS)}")
        for key, value in read.items():
            kind, legal = KEYS[key]
            if type(value) is not kind:
                raise ValueError(f"{key} is {json.dumps(value)}, not {legal}")
        before = self._orders.get(read.get("id", ""))
        fields = {**({} if before is None else asdict(before)), **read}
        if named and "id" not in read:
            raise ValueError("id is missing: by it the next run of this cell knows the order")
        if before is None and "id" not in read:
            fields["id"] = next(name for name in map(str, range(1, MOST_N + 2)) if name not in self._orders)
        order = WorkOrder(**{**fields, "variant": self._variant(fields.get("variant", ""))})
        if not (0 < len(order.id) <= ID_MOST and order.id.isprintable()):
            raise ValueError(f"id is {order.id!r}; it has 1 to {ID_MOST} letters")
        if not 0 < order.amount <= AMOUNT_MOST:
            raise ValueError(f"amount is {order.amount}; legal: 1 to {AMOUNT_MOST}")
        if before is None and len(self._orders) >= MOST_N:
            raise ValueError(f"there are {MOST_N} orders already")
        return replace(order, due=order.due and _time(order.due))

    def _variant(self, named: object) -> str:
        """A variant by its name or its title."""
        found = [name for name, title in self._variants.items() if named in (name, title)]
        if not found:
            legal = ", ".join(f"{name} ({title})" if title != name else name for name, title in self._variants.items())
            raise ValueError(f"variant is {named!r}; legal: {legal}")
        return found[0]


def _fields(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    if len(fields := dict(pairs)) < len(pairs):
        raise ValueError("has a key twice")
    return fields


def _time(text: str) -> str:
    """A time in any writing of ISO 8601 as orders are sorted by, and browsers read it: of this place, in minutes."""
    try:
        time = datetime.fromisoformat(text)
        return (time.astimezone() if time.tzinfo else time).replace(tzinfo=None).isoformat(timespec="minutes")
    except (ValueError, OverflowError):
        raise ValueError(f"due is {text!r}; write it as {DUE}") from None
