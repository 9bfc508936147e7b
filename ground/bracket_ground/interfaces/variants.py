"""Variants of a product family: what each slot of a goal takes, and arrangements of parts that make it."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from itertools import islice, product
from math import prod
from typing import Any

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
        every = (one for one in every if all(Counter(one)[part] <= count for part, count in quantities.items()))
    return list(islice(every, most))


def completed(accepted: Accepted, quantities: Mapping[str, int], placed: Mapping[str, str]) -> dict[str, str] | None:
    """An arrangement that keeps as much of what is placed as belongs there; None where the quantities allow none.

    Args:
        quantities: most parts of a type; types that are not named are not limited.
        placed: part type by slot.
    """
    fixed: dict[str, str] = {}
    for slot, part in placed.items():
        within = sum(one == part for one in fixed.values()) < quantities.get(part, len(accepted))
        if part in accepted.get(slot, ()) and within:
            fixed[slot] = part
    found = _assigned(accepted, quantities, fixed)
    return _assigned(accepted, quantities, {}) if found is None else found


def _assigned(accepted: Accepted, quantities: Mapping[str, int], fixed: Mapping[str, str]) -> dict[str, str] | None:
    """Bipartite assignment of slots to types with capacities, by augmenting paths; `fixed` ones stay."""
    taken = dict(fixed)

    def assign(slot: str, tried: set[str]) -> bool:
        for part in accepted[slot]:
            if part in tried:
                continue
            tried.add(part)
            holders = [other for other, one in taken.items() if one == part]
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


def with_listed_goals(file: dict[str, Any]) -> dict[str, Any]:
    """A product file's content in which goals by slot name are lists in the order of the slots."""
    goals, holes = file.get("goals"), _of(file.get("bracket"), "holes_m")
    if not isinstance(goals, dict) or not isinstance(holes, dict):
        return file
    return {**file, "goals": {name: _listed(goal, list(holes)) for name, goal in goals.items()}}


def _listed(goal: Any, slots: list[str]) -> Any:
    if not isinstance(goal, dict):
        return goal
    if unknown := [slot for slot in goal if slot not in slots]:
        raise ValueError(f"no slot {unknown[0]} in the bracket; slots: {', '.join(slots)}")
    return [goal.get(slot, EMPTY) for slot in slots]


def with_quantities(file: dict[str, Any]) -> dict[str, Any]:
    """A product file's content in which part types without a quantity have what the goals take of them at most."""
    parts, goals = file.get("parts"), file.get("goals")
    if not isinstance(parts, dict) or not isinstance(goals, dict):
        return file
    most: Counter[str] = Counter()
    for name, goal in goals.items():
        taken = Counter(part for choice in goal if isinstance(choice, str | list | tuple) for part in _named(choice))
        limits = _of(_of(file.get("goal_quantities"), name), None)
        most |= Counter({part: min(n, limits.get(part, n)) for part, n in taken.items()})
    bare = [name for name, part in parts.items() if isinstance(part, dict) and "quantity" not in part and most[name]]
    return {**file, "parts": parts | {name: {**parts[name], "quantity": most[name]} for name in bare}}


def _named(choice: Any) -> tuple[Any, ...]:
    return types_of(choice if isinstance(choice, str) else tuple(choice))


def _of(value: Any, key: Any) -> Any:
    """An entry of what may be a mapping or a model, or the mapping itself where no key is named."""
    found = value if key is None else value.get(key) if isinstance(value, dict) else getattr(value, str(key), None)
    return {} if found is None else found
