"""Once for each: detected part, hole of the bracket, row of a table."""

from __future__ import annotations

import csv
import io
from dataclasses import replace
from typing import Any

from bracket_cell.trees.vocabulary import Hole, Part
from bracket_ground.interfaces.perception import PartsView
from btxml.engine.errors import NodeError
from btxml.engine.node import FAILURE, RUNNING, SUCCESS, Decorator
from btxml.engine.ports import InputPort, OutputPort, Port, further_of
from btxml.engine.status import Status


class ForEach(Decorator):
    """Base: ticks its child once for every item; the items are those of its first tick. A failed round ends it."""

    abstract = True

    if_empty = InputPort(Status, "result if there is no item", default=SUCCESS)
    number = OutputPort(int, "number of this round, from 0")
    services: Any

    _items: list[Any]
    _round = 0
    _child_runs = False

    def setup(self, **kwargs: Any) -> None:
        """Take the services."""
        self.services = kwargs["services"]

    def items(self) -> list[Any]:
        """What there is to go through."""
        raise NotImplementedError

    def begin(self, item: Any) -> None:
        """Write what the round is about."""
        raise NotImplementedError

    def run(self) -> Status:
        if self.status is not RUNNING:
            self._items, self._round, self._child_runs = self.items(), 0, False
            if not self._items:
                return self.if_empty.get()
        if not self._child_runs:
            self.number.set(self._round)
            self.begin(self._items[self._round])
        self.set_status(RUNNING)
        status = self.decorated.execute()
        self._child_runs = status is RUNNING
        if not self._child_runs:
            self.decorated.reset_status()
        if status is RUNNING or status is FAILURE:
            return status
        self._round += 1
        return RUNNING if self._round < len(self._items) else SUCCESS


class ForEachPart(ForEach):
    """Ticks its child once for each part of a view; each round sees the remaining parts."""

    seen = InputPort(PartsView, "parts seen in the tray")
    wanted = InputPort(Part, "only this type; any type if left out", optional=True, name="type")
    parts = OutputPort(PartsView, "the view without the parts of the rounds before")
    index = OutputPort(int, "number of this round's part in that view")
    part = OutputPort(Part, "its type")

    def items(self) -> list[Any]:
        wanted = self.wanted.get_or("")
        self._view = self.seen.get()
        return [seen for seen in self._view.detections if wanted in ("", seen.part)]

    def begin(self, item: Any) -> None:
        done = self._items[: self._round]
        left = tuple(seen for seen in self._view.detections if not any(seen is earlier for earlier in done))
        self.parts.set(replace(self._view, detections=left))
        self.index.set(next(number for number, seen in enumerate(left) if seen is item))
        self.part.set(Part(item.part))


class ForEachType(ForEach):
    """Ticks its child once for each part type of the product."""

    part = OutputPort(Part, "the type of this round", name="type")

    def items(self) -> list[Any]:
        if self.services is None:  # a tree that is tried without a cell: once, for no type in particular
            return [""]
        return list(self.services.tools.product.parts)

    def begin(self, item: Any) -> None:
        self.part.set(Part(item))


class ForEachHole(ForEach):
    """Ticks its child once for each hole of the bracket, or for each that is named."""

    positions = InputPort(list[Hole], "these holes, in this order: p1;p3; all if left out", optional=True)
    position = OutputPort(Hole, "the hole of this round")

    def items(self) -> list[Any]:
        named = self.positions.get_or(None)
        known = self.services.tools.product.positions
        wrong = [name for name in named or () if name not in known]
        if wrong:
            raise NodeError(f"the product has no position '{wrong[0]}'; one of {', '.join(known)}")
        return list(known) if named is None else list(named)

    def begin(self, item: Any) -> None:
        self.position.set(Hole(item))


class ForEachRow(ForEach):
    """Ticks its child once for each row of a CSV file; further ports name its columns: part="{part}"."""

    file = InputPort(str, "CSV file below the working folder; its first line names the columns")

    @classmethod
    def further_port(cls, name: str) -> Port | None:
        """A column of the table."""
        return OutputPort(str, f"the column '{name}' of this round's row")

    def items(self) -> list[Any]:
        path = self.file.get()
        text = self.services.tools.files.read(path, self.services.tools.journal)
        if text is None:
            raise NodeError(f"there is no file {path}")
        return rows_of(text, path, tuple(further_of(self)))

    def begin(self, item: Any) -> None:
        for column, port in further_of(self).items():
            port.set(item[column])


def rows_of(text: str, path: str, columns: tuple[str, ...]) -> list[dict[str, str]]:
    """Rows of a CSV table by column; what stands around a cell is cut off, empty lines are left out.

    Raises:
        NodeError: the table lacks a column, or a row has more or fewer cells than the first line.
    """
    try:
        lines = [[cell.strip() for cell in line] for line in csv.reader(io.StringIO(text.removeprefix("\ufeff")))]
    except csv.Error as error:
        raise NodeError(f"{path} is not a CSV table: {error}") from None
    head = lines[0] if lines else []
    if missing := [column for column in columns if column not in head]:
        raise NodeError(f"{path} has no column '{missing[0]}'; it has: {', '.join(head) or 'none'}")
    rows = [(number, line) for number, line in enumerate(lines[1:], start=2) if any(line)]
    if odd := next((number for number, line in rows if len(line) != len(head)), None):
        raise NodeError(f"{path}:{odd}: this row has not {len(head)} cells, as the first line has")
    return [dict(zip(head, line, strict=True)) for _, line in rows]
