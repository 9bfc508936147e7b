"""Several brackets on the bench at a time: a product file's content with a copy of everything for each of them."""

from __future__ import annotations

from collections import Counter
from itertools import product
from typing import Any

from bracket_ground.files.model import Disagreement

JOINT = "+"  # between the goals of the brackets, as in g0+g2
MOST_GOALS = 400  # of which a plan takes some 10 ms


def with_brackets(file: dict[str, Any]) -> dict[str, Any]:
    """A product file's content without `brackets`: slots are named like left_p1, goals like g0+g2.

    A bracket's goal says nothing of the others': every combination is a goal. Where goals are by slot name, they have
    been listed before.
    """
    offsets, plate, goals = file.get("brackets", {}), file["bracket"], file["goals"]
    if not offsets:
        return file
    names = list(offsets)
    if (combined := len(goals) ** len(names)) > MOST_GOALS:
        what = f"{len(goals)} goals at {len(names)} brackets combine to {combined}, more than {MOST_GOALS}"
        raise Disagreement([(("brackets",), what)])
    holes = {_of(name, slot): _moved(at, offsets[name]) for name in names for slot, at in plate["holes_m"].items()}
    plates = [[_of(name, slot) for slot in plate["holes_m"]] for name in names]
    made = {
        "bracket": {**plate, "holes_m": holes, "plates": plates},
        **_combined(goals, file.get("goal_titles", {}), file.get("goal_quantities", {}), len(names)),
        "accepts": {_of(name, slot): types for name in names for slot, types in file.get("accepts", {}).items()},
        "carried_by": {
            _of(name, slot): _of(name, low) for name in names for slot, low in file.get("carried_by", {}).items()
        },
        "before": [[_of(name, step) for step in pair] for name in names for pair in file.get("before", ())],
        "fastenings": {
            _of(name, step): {**one, "at": [_of(name, slot) for slot in one["at"]]}
            for name in names
            for step, one in file.get("fastenings", {}).items()
        },
        "parts": {name: _times(part, len(names)) for name, part in file.get("parts", {}).items()},
    }
    return {**{key: value for key, value in file.items() if key != "brackets"}, **made}


def _combined(
    goals: dict[str, Any], titles: dict[str, str], limits: dict[str, dict[str, int]], brackets: int
) -> dict[str, Any]:
    """Every combination of goals as a goal, with its title, and its quantities where each of them has some."""
    chosen = {JOINT.join(some): some for some in product(goals, repeat=brackets)}
    return {
        "goals": {name: [choice for goal in some for choice in goals[goal]] for name, some in chosen.items()},
        "goal_titles": {name: ", ".join(titles.get(goal, goal) for goal in some) for name, some in chosen.items()},
        "goal_quantities": {
            name: dict(sum((Counter(limits[goal]) for goal in some), Counter()))
            for name, some in chosen.items()
            if all(goal in limits for goal in some)
        },
    }


def _of(bracket: str, step: str) -> str:
    return f"{bracket}_{step}"


def _moved(at: Any, by: Any) -> list[float]:
    return [a + b for a, b in zip(at, by, strict=True)]


def _times(part: Any, brackets: int) -> Any:
    return {**part, "quantity": part["quantity"] * brackets} if "quantity" in part else part
