"""Where the run of a log was left off; reads one part after the other, so that a long shift needs no more memory."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

from cell.errors import InputError, LogError
from cell.interfaces.planning import UNKNOWN_GOAL
from cell.interfaces.product import Product
from cell.interfaces.resume import LeftOff
from cell.log.read.reader import Log, LoggedTick, files_of, read_log


def read_left_off(path: Path, product: Product, told: Callable[[LoggedTick], None] = lambda _: None) -> LeftOff:
    """What the log says about the work that it broke off in.

    Args:
        told: every tick, in order.

    Raises:
        LogError: it cannot be read.
        InputError: it is of another product.
    """
    left = LeftOff()
    for log in _parts(path):
        if (name := log.metadata.get("product", product.name)) != product.name:
            raise InputError(f"{path}: the run was with product {name!r}, this one is with {product.name!r}")
        if "left_off" in log.metadata and not left.bracket and not left.placed:
            left = LeftOff.of(json.loads(log.metadata["left_off"]))
        for tick in log.ticks:
            told(tick)
            for topic, fields in tick.notes:
                left = _after(left, topic, fields, product)
    return left


def world_of(path: Path) -> Path | None:
    """Address of the world that the run worked in; None where it had one of its own."""
    address = read_log(files_of(path)[:1]).metadata.get("world")
    return Path(address) if address else None


def _parts(path: Path) -> Iterator[Log]:
    files = files_of(path)
    for file in files:
        try:
            yield read_log([file])
        except LogError:
            if file == files[0] or file != files[-1]:  # the last part may have been begun and nothing more
                raise


def _after(left: LeftOff, topic: str, fields: dict[str, Any], product: Product) -> LeftOff:
    """What is known after one more note."""
    if topic == "bracket" and fields["edge"] == "begin":
        if fields.get("resumed"):
            return replace(left, bracket=fields["number"], ended=False)
        begun = LeftOff(held_part=left.held_part, finished=left.finished)
        return replace(begun, bracket=fields["number"])
    if topic == "bracket":
        return _ended(left, fields, product)
    if topic == "belief" and fields.get("edge"):
        part, position = fields["edge"]
        others = {name: kind for name, kind in left.placed.items() if name != position}
        return replace(left, placed={**others, position: part} if part is not None else others)
    if topic == "belief" and "told" in fields:
        return replace(left, told_goal=fields["told"])
    if topic == "belief" and "told_part" in fields:
        part, position = fields["told_part"]
        return replace(left, told_parts={**left.told_parts, position: part})
    if topic == "belief" and "taken_out" in fields:
        return replace(left, taken_out=fields["taken_out"])
    if topic == "belief" and "kept" in fields:
        wrong = fields["kept"] if fields["known_wrong"] else {}
        return replace(left, kept={**left.kept, **fields["kept"]}, known_wrong={**left.known_wrong, **wrong})
    if topic == "skill":  # "grasping o1", "carrying o1"
        named = [word for word in str(fields.get("reason")).split() if word in product.parts]
        return replace(left, held_part=named[-1]) if named else left
    return left


def _ended(left: LeftOff, fields: dict[str, Any], product: Product) -> LeftOff:
    learned = fields.get("goal")
    if not learned or learned == UNKNOWN_GOAL or learned in product.goals:
        return replace(left, ended=True)
    parts = tuple(fields["placed"].get(position) for position in product.positions)
    known = left.finished if None in parts else (*left.finished, parts)
    return replace(left, ended=True, finished=tuple(dict.fromkeys(known)))
