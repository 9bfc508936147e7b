"""Demonstrations from a log: the placements that lasted, in their order, under the goal that they came to."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from bracket_cell.learned.semantic.records import Demonstration, PlacementRecord
from bracket_cell.log.read.reader import Log
from bracket_cell.log.report.summary import Placed, beliefs, placements
from bracket_cell.recording.parts import whole_path
from bracket_ground.interfaces.product import Product

SURE = 0.9  # least belief in the goal of a run that was not finished
NOTHING = "nothing"  # as the story of a log calls an empty hole
SAME_STATE_S = 0.5  # placements that were read off the holes within this time have no known order


def finished_bracket(log: Log, product: Product) -> tuple[str, ...] | None:
    """The part at every position at the end of a run, whether the product lists such a goal or not, or None."""
    final = {placed.position: placed.part for placed in _lasting(placements(log))}
    found = tuple(final[position] for position in product.positions if position in final)
    return found if len(found) == len(product.positions) else None


@dataclass(frozen=True)
class Taken:
    """A demonstration, or why a log gives none.

    Attributes:
        goal_known_by: "all holes" where every hole holds what the goal wants, "belief" where the planner was sure.
        why_not: empty where there is a demonstration.
    """

    demonstration: Demonstration | None
    goal_known_by: Literal["all holes", "belief", ""] = ""
    why_not: str = ""


def demonstration_of(log: Log, product: Product) -> Taken:
    """What a run shows of how its goal is assembled."""
    if not log.ticks or log.ticks[0].number or log.gaps:
        return Taken(None, why_not="ticks are missing, so what was placed before is unknown")
    lasting = _lasting(placements(log))
    if not lasting:
        return Taken(None, why_not="nothing was placed")
    final = {placed.position: placed.part for placed in lasting}
    goal = product.goal_of(final) or ""
    known_by: Literal["all holes", "belief"] = "all holes"
    if not goal:
        believed = beliefs(log)
        last = believed[-1].goals if believed else {}
        goal, known_by = max(last, key=lambda name: last[name], default=""), "belief"
        if goal not in product.goals or last[goal] < SURE:
            return Taken(None, why_not=f"the goal is not known: not all holes are filled, and no belief reached {SURE}")
    begin_s = log.ticks[0].time_s
    found = Demonstration(
        goal=goal,
        placements=tuple(
            PlacementRecord(
                part=placed.part,
                position=placed.position,
                time_s=round(placed.time_s - begin_s, 3),
                by="robot" if placed.source == "robot" else "person",
            )
            for placed in lasting
        ),
        unordered_n=_unordered(lasting),
        source=whole_path(log.path).name,
    )
    misfit = found.misfit(product)
    return Taken(None, why_not=misfit) if misfit else Taken(found, known_by)


def _lasting(placed: list[Placed]) -> list[Placed]:
    """Placements that were not taken back or corrected, in the order in which they were made."""
    current: dict[str, Placed] = {}
    for placement in placed:
        if placement.confirms:
            continue
        current.pop(placement.position, None)
        if placement.part != NOTHING:
            current[placement.position] = placement
    return list(current.values())


def _unordered(lasting: list[Placed]) -> int:
    """How many of the first were read off the holes together: they were there before anybody looked."""
    first = lasting[0]
    together = [
        placed
        for placed in lasting
        if placed.source == first.source == "seen hole" and placed.time_s - first.time_s <= SAME_STATE_S
    ]
    return len(together) if 1 < len(together) < len(lasting) else 0
