"""Where the run of a log was left off; reads one part after the other, so that a long shift needs no more memory."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

from bracket_cell.log.read.reader import Log, LoggedTick, files_of, json_of, read_log
from bracket_cell.log.read.ticks import holding
from bracket_ground.errors import InputError, LogError
from bracket_ground.interfaces.planning import UNKNOWN_GOAL
from bracket_ground.interfaces.product import Product
from bracket_ground.interfaces.resume import ResumeState


def read_resume_state(path: Path, product: Product, told: Callable[[LoggedTick], None] = lambda _: None) -> ResumeState:
    """What the log says about the work that it broke off in.

    Args:
        told: every tick, in order.

    Raises:
        LogError: it cannot be read.
        InputError: it is of another product.
    """
    left, remembers = ResumeState(), False
    for number, log in enumerate(_parts(path)):
        if (name := log.metadata.get("product", product.name)) != product.name:
            raise InputError(f"{path}: the run was with product {name!r}, this one is with {product.name!r}")
        if number == 0:
            left = json_of(log.path, log.metadata, "left_off", ResumeState.of) or left
        for tick in log.ticks:
            told(tick)
            remembers = remembers or any(topic == "memory" for topic, _ in tick.notes)
            left = after_tick(left, tick, product, log.path, remembers=remembers)
    return left


def after_tick(left: ResumeState, tick: LoggedTick, product: Product, path: Path, *, remembers: bool) -> ResumeState:
    """What is known after the notes of one more tick.

    Args:
        path: of the log, for messages.
        remembers: the log has notes of what nodes remember, which tell better what is held than skills do.

    Raises:
        LogError: a note does not hold what it should.
    """
    with holding(path, f"a note of tick {tick.number} at {tick.time_s:.2f} s"):
        for topic, fields in tick.notes:
            if not (remembers and topic == "skill"):
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


def _after(left: ResumeState, topic: str, fields: dict[str, Any], product: Product) -> ResumeState:
    """What is known after one more note."""
    if topic == "bracket" and fields["edge"] == "begin":
        if fields.get("resumed"):
            return replace(left, bracket=fields["number"], ended=False)
        begun = ResumeState(held_part=left.held_part, finished=left.finished)
        return replace(begun, bracket=fields["number"])
    if topic == "bracket":
        return _ended(left, fields, product)
    if topic == "belief":
        return _believed(left, fields)
    if topic == "memory":
        return replace(left, held_part=fields.get("held_part", left.held_part))
    if topic == "skill":  # of older logs: "grasping o1", "carrying o1"
        named = [word for word in str(fields.get("reason")).split() if word in product.parts]
        return replace(left, held_part=named[-1]) if named else left
    return left


def _believed(left: ResumeState, fields: dict[str, Any]) -> ResumeState:
    graph = left.graph
    if fields.get("edge"):
        part, position = fields["edge"]
        if part is not None:
            return replace(left, graph=graph.with_placement(part, position))
        return _seen(left, placed={name: kind for name, kind in graph.placed.items() if name != position})
    if "told" in fields:
        return _seen(left, told_goal=fields["told"], denied=())
    if "denied" in fields:
        without = graph.without(fields["denied"])
        return _seen(left, told_goal=without.told_goal, denied=without.denied)
    if "told_part" in fields:
        part, position = fields["told_part"]
        return _seen(left, told_parts={**graph.told_parts, position: part})
    if "fastened" in fields:
        return _seen(left, fastened=tuple(fields["fastened"]))
    if "taken_out" in fields:
        return _seen(left, taken_out=fields["taken_out"], replaced=fields.get("replaced", {}))
    if "kept" in fields:
        wrong = fields["kept"] if fields["known_wrong"] else {}
        return _seen(left, kept={**graph.kept, **fields["kept"]}, known_wrong={**graph.known_wrong, **wrong})
    return left


def _seen(left: ResumeState, **changes: Any) -> ResumeState:
    """With another assembly graph."""
    return replace(left, graph=replace(left.graph, **changes))


def _ended(left: ResumeState, fields: dict[str, Any], product: Product) -> ResumeState:
    learned = fields.get("goal")
    if not learned or learned == UNKNOWN_GOAL or learned in product.goals:
        return replace(left, ended=True)
    known = (*left.finished, product.as_listed(fields["placed"])) if fields.get("finished") else left.finished
    return replace(left, ended=True, finished=tuple(dict.fromkeys(known)))
