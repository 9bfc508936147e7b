"""Several brackets on the bench at a time: a product file's content with everything that each of them has."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from itertools import product
from math import prod
from pathlib import Path
from typing import Any

from bracket_ground.files.model import Disagreement
from bracket_ground.interfaces.variants import EMPTY, OtherBracket

JOINT = "+"  # between the goals of the brackets, as in g0+g2
MOST_GOALS = 400  # of which a plan takes some 10 ms

File = Mapping[str, Any]  # a product file's content, its goals by list


@dataclass(frozen=True)
class _Bracket:
    """One on the bench.

    Attributes:
        file: whose holes, goals and steps it has.
        goals: by name, what each slot takes; of one that may stay empty also that.
    """

    name: str
    at: tuple[float, float]
    file: File
    goals: Mapping[str, Any]

    def of(self, step: str) -> str:
        return f"{self.name}_{step}"


def with_brackets(file: dict[str, Any], read: Callable[[Path], dict[str, Any]]) -> dict[str, Any]:
    """A product file's content without `brackets`: slots are named like left_p1, goals like g0+g2.

    A bracket's goal says nothing of the others': every combination is a goal. Where goals are by slot name, they have
    been listed before.

    Args:
        read: content of the product file of another bracket.

    Raises:
        Disagreement: there are too many combinations, or another file's parts or plate are not as this one's.
    """
    if not file.get("brackets"):
        return file
    some = [_bracket(name, entry, file, read) for name, entry in file["brackets"].items()]
    if (combined := prod(len(bracket.goals) for bracket in some)) > MOST_GOALS:
        each = {len(bracket.goals) for bracket in some}
        goals = f"{each.pop()} goals at" if len(each) == 1 else "the goals of"
        what = f"{goals} {len(some)} brackets combine to {combined}, more than {MOST_GOALS}"
        raise Disagreement([(("brackets",), what)])
    holes = {
        bracket.of(slot): _moved(hole, bracket.at) for bracket in some for slot, hole in _holes(bracket.file).items()
    }
    plates = [[bracket.of(slot) for slot in _holes(bracket.file)] for bracket in some]
    made = {
        "parts": _parts(file, some),
        "bracket": {**file["bracket"], "holes_m": holes, "plates": plates},
        **_combined(some),
        **_steps(some),
    }
    return {**{key: value for key, value in file.items() if key != "brackets"}, **made}


def _combined(some: list[_Bracket]) -> dict[str, Any]:
    """Every combination of goals as a goal, with its title, and its quantities where each of them has some."""
    chosen = [goals for goals in product(*(bracket.goals for bracket in some)) if set(goals) != {EMPTY}]
    each = {JOINT.join(goals): list(zip(some, goals, strict=True)) for goals in chosen}
    titles = {
        name: ", ".join(bracket.file.get("goal_titles", {}).get(goal, goal) for bracket, goal in pairs)
        for name, pairs in each.items()
    }
    return {
        "goals": {
            name: [choice for bracket, goal in pairs for choice in bracket.goals[goal]] for name, pairs in each.items()
        },
        "goal_titles": titles,
        "goal_quantities": {name: dict(found) for name, pairs in each.items() if (found := _limits(pairs))},
    }


def _steps(some: list[_Bracket]) -> dict[str, Any]:
    """What the slots of all take and carry, their fastenings, and what comes before what."""
    carried = [(bracket, bracket.file.get("carried_by", {})) for bracket in some]
    fastenings = [(bracket, bracket.file.get("fastenings", {})) for bracket in some]
    return {
        "accepts": {
            bracket.of(slot): types for bracket in some for slot, types in bracket.file.get("accepts", {}).items()
        },
        "carried_by": {bracket.of(slot): bracket.of(low) for bracket, slots in carried for slot, low in slots.items()},
        "before": [[bracket.of(step) for step in pair] for bracket in some for pair in bracket.file.get("before", ())],
        "fastenings": {
            bracket.of(step): {**fastening, "at": [bracket.of(slot) for slot in fastening["at"]]}
            for bracket, steps in fastenings
            for step, fastening in steps.items()
        },
    }


def _bracket(name: str, entry: Any, file: File, read: Callable[[Path], dict[str, Any]]) -> _Bracket:
    other = OtherBracket.model_validate(entry) if isinstance(entry, dict) else OtherBracket(at_m=tuple(entry))
    of = file if other.file is None else read(other.file)
    own, its = file["bracket"].get("thickness_m"), of["bracket"].get("thickness_m")
    if own != its:
        raise Disagreement([(("brackets", name), f"{other.file} has a plate of {its} m, this file one of {own} m")])
    empty = {EMPTY: [EMPTY] * len(_holes(of))} if other.may_stay_empty else {}
    return _Bracket(name, other.at_m, of, {**of["goals"], **empty})


def _parts(file: File, some: list[_Bracket]) -> dict[str, Any]:
    """Types of all files, by what all brackets take of them together, where a file says how many lie ready."""
    found: dict[str, Any] = {}
    for bracket in some:
        for name, part in bracket.file["parts"].items():
            before = found.setdefault(name, {**part, "quantity": 0} if "quantity" in part else part)
            if bracket.file is not file and name in file["parts"] and _unlike(part, file["parts"][name]):
                raise Disagreement([(("parts", name), f"type {name} is another in the file of bracket {bracket.name}")])
            if "quantity" in before and "quantity" in part:
                found[name] = {**before, "quantity": int(before["quantity"]) + int(part["quantity"])}
            else:
                found[name] = {key: value for key, value in before.items() if key != "quantity"}
    return found


def _unlike(part: File, own: File) -> bool:
    """Whether two entries of a type differ in what both say, but for the quantity."""
    return any(
        _plain(part[key]) != _plain(own[key]) for key in own.keys() & part.keys() - {"quantity", "mesh", "shape"}
    )


def _plain(value: Any) -> Any:
    return list(value) if isinstance(value, tuple) else value


def _limits(pairs: list[tuple[_Bracket, str]]) -> Counter[str]:
    """Quantities of a combination; none where one of its goals has none."""
    each = [{} if goal == EMPTY else bracket.file.get("goal_quantities", {}).get(goal) for bracket, goal in pairs]
    if None in each:
        return Counter()
    return sum((Counter({name: int(n) for name, n in own.items()}) for own in each), Counter())


def _holes(file: File) -> dict[str, Any]:
    holes: dict[str, Any] = file["bracket"]["holes_m"]
    return holes


def _moved(at: Any, by: Any) -> list[float]:
    return [float(a) + float(b) for a, b in zip(at, by, strict=True)]
