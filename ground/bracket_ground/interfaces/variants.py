"""Variants of a product family: what each slot of a goal takes, and arrangements of parts that make it."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from itertools import islice, product
from math import prod
from pathlib import Path
from typing import Any

from pydantic import BaseModel, ValidationError

from bracket_ground.files.model import Disagreement, Model
from bracket_ground.files.units import Coordinate
from bracket_ground.interfaces.wholes import parts_of_wholes

EMPTY = "empty"  # in a goal: nothing goes into this slot
Choice = str | tuple[str, ...]  # a part type, several of which any one is right, or EMPTY
Accepted = Mapping[str, tuple[str, ...]]  # part types by slot, of slots that take something


def types_of(choice: Choice) -> tuple[str, ...]:
    """Part types that are right in a slot; none where it stays empty."""
    if isinstance(choice, tuple):
        return choice
    return () if choice == EMPTY else (choice,)


def written(choice: Choice) -> str:
    """A choice in a word, like "o1", "o1|o2" or "empty"."""
    return choice if isinstance(choice, str) else "|".join(choice)


def arrangements_n(choices: Sequence[Choice]) -> int:
    """Number of arrangements where no quantity limits them."""
    return prod(len(types_of(choice)) or 1 for choice in choices)


def arrangements(choices: Sequence[Choice], quantities: Mapping[str, int], most: int) -> list[tuple[str, ...]]:
    """Up to `most` arrangements of a goal within its quantities: a part type or EMPTY for each slot."""
    every: Iterator[tuple[str, ...]] = product(*(types_of(choice) or (EMPTY,) for choice in choices))
    if quantities:
        every = (row for row in every if all(Counter(row)[part] <= count for part, count in quantities.items()))
    return list(islice(every, most))


def completed(accepted: Accepted, quantities: Mapping[str, int], placed: Mapping[str, str]) -> dict[str, str] | None:
    """An arrangement that keeps as much of what is placed as belongs there; None where the quantities allow none.

    Args:
        quantities: most parts of a type; types that are not named are not limited.
        placed: part type by slot.
    """
    fixed: dict[str, str] = {}
    for slot, part in placed.items():
        within = sum(kept == part for kept in fixed.values()) < quantities.get(part, len(accepted))
        if part in accepted.get(slot, ()) and within:
            fixed[slot] = part
    found = _assigned(accepted, quantities, fixed)
    return _assigned(accepted, quantities, {}) if found is None else found


def places(
    accepted: Accepted, quantities: Mapping[str, int], placed: Mapping[str, str], stock: Mapping[str, int]
) -> dict[str, tuple[str, ...]]:
    """By part type, the open slots that take it: first those of one arrangement, then those where it does as well.

    Args:
        quantities, placed: as those of `completed`.
        stock: how many parts of each type there are; of none more are named than are left.
    """
    chosen = completed(accepted, quantities, placed) or {}
    open_slots = {slot: types for slot, types in accepted.items() if slot not in placed}
    found = {}
    for part, there in stock.items():
        first = [slot for slot in open_slots if chosen.get(slot) == part]
        others = [
            slot
            for slot, types in open_slots.items()
            if part in types and slot not in first
            if (completed(accepted, quantities, {**placed, slot: part}) or {}).get(slot) == part
        ]
        left = min(there, quantities.get(part, there)) - sum(placed_part == part for placed_part in placed.values())
        found[part] = (*first, *others)[: max(left, len(first))]
    return found


def _assigned(accepted: Accepted, quantities: Mapping[str, int], fixed: Mapping[str, str]) -> dict[str, str] | None:
    """Bipartite assignment of slots to types with capacities, by augmenting paths; `fixed` ones stay."""
    taken = dict(fixed)

    def assign(slot: str, tried: set[str]) -> bool:
        for part in accepted[slot]:
            if part in tried:
                continue
            tried.add(part)
            holders = [other for other, holder in taken.items() if holder == part]
            if len(holders) < quantities.get(part, len(accepted)):
                taken[slot] = part
                return True
            if any(other not in fixed and assign(other, tried) for other in holders):
                taken[slot] = part
                return True
        return False

    if all(slot in taken or assign(slot, set()) for slot in accepted):
        return {slot: taken[slot] for slot in accepted}
    return None


_Place = tuple[float, float]


class OtherBracket(Model):
    """A bracket beside others on the bench.

    Attributes:
        at_m: where it stands (x, y), in the frame of the file's own.
        file: product file whose bracket it is, beside this file: its holes, goals and steps; by default this file's.
        may_stay_empty: nothing may be built on it; goals are then named like g0+empty.
    """

    at_m: tuple[Coordinate, Coordinate]
    file: Path | None = None
    may_stay_empty: bool = False


class _Plate(BaseModel):
    holes_m: dict[str, _Place]


class _Part(BaseModel):
    quantity: int = 1
    made_of: tuple[str, ...] = ()


class _Fastened(BaseModel):
    at: tuple[str, ...]


class _Shape(BaseModel):
    """What the shorthands of a product file are made of; nothing is said of other keys."""

    parts: dict[str, _Part]
    bracket: _Plate
    goals: dict[str, tuple[Choice, ...]]
    goal_titles: dict[str, str] = {}
    goal_quantities: dict[str, dict[str, int]] = {}
    accepts: dict[str, tuple[str, ...]] = {}
    fastenings: dict[str, _Fastened] = {}
    before: tuple[tuple[str, str], ...] = ()
    carried_by: dict[str, str] = {}
    brackets: dict[str, _Place | OtherBracket] = {}


def can_be_expanded(file: dict[str, Any]) -> bool:
    """Whether a product file's content has the shape that shorthands need; else its fields say what is wrong."""
    try:
        _Shape.model_validate(file)
    except ValidationError:
        return False
    return True


def with_listed_goals(file: dict[str, Any]) -> dict[str, Any]:
    """A product file's content in which goals by slot name are lists in the order of the slots."""
    goals, plate = file.get("goals"), file.get("bracket")
    holes = plate.get("holes_m") if isinstance(plate, dict) else None
    if not isinstance(goals, dict) or not isinstance(holes, dict):
        return file
    return {**file, "goals": {name: _listed(name, goal, list(holes)) for name, goal in goals.items()}}


def _listed(name: str, goal: Any, slots: list[str]) -> Any:
    if not isinstance(goal, dict):
        return goal
    if unknown := [slot for slot in goal if slot not in slots]:
        what = f"no slot {unknown[0]} in the bracket; slots: {', '.join(slots)}"
        raise Disagreement([(("goals", name, unknown[0]), what)])
    return [goal.get(slot, EMPTY) for slot in slots]


def with_quantities(file: dict[str, Any]) -> dict[str, Any]:
    """A product file's content in which part types without a quantity have what the goals take of them at most."""
    most: Counter[str] = Counter()
    for name, goal in file["goals"].items():
        limits = file.get("goal_quantities", {}).get(name, {})
        taken = Counter(part for parts in goal for part in types_of(parts if isinstance(parts, str) else tuple(parts)))
        most |= Counter({part: min(n, int(limits.get(part, n))) for part, n in taken.items()})
    for part, count in parts_of_wholes(file["parts"], Counter(most)):
        most[part] += count
    bare = {name: part for name, part in file["parts"].items() if "quantity" not in part and most[name]}
    return {**file, "parts": file["parts"] | {name: {**part, "quantity": most[name]} for name, part in bare.items()}}
