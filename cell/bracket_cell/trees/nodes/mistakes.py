"""Mistakes in the bracket: what looks wrong in which hole, and how it is said to people."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Literal

from bracket_cell.trees.nodes.services import Services
from bracket_ground.files.words.message import Message, listed
from bracket_ground.interfaces.perception import HoleView
from bracket_ground.interfaces.planning import AssemblyPlan, AssemblyState
from bracket_ground.interfaces.product import Product

MistakeKind = Literal["wrong", "surplus", "crooked", "hidden"]
KINDS: tuple[MistakeKind, ...] = ("wrong", "surplus", "crooked", "hidden")  # in the order in which they are reported
TODO: dict[MistakeKind, tuple[str, str]] = {
    "wrong": ("take it out", "take them out"),
    "surplus": ("take it out", "take out what does not belong there, or say which one does not"),
    "crooked": ("set it straight", "set them straight"),
    "hidden": ("clear the view, or take out what does not belong there",) * 2,
}


@dataclass(frozen=True)
class Mistake:
    """Something in one hole that a person should mend.

    Attributes:
        kind: "wrong": the goal has another part there; "surplus": more such parts than a bracket takes; "crooked":
            the part does not stand straight; "hidden": nothing could be read there for a while.
        part: type of the part in the hole; None where that is not known.
        wanted: type of the part that belongs there; None where that is not known.
    """

    position: str
    kind: MistakeKind
    part: str | None = None
    wanted: str | None = None


Mistakes = tuple[Mistake, ...]


def mistakes_in(services: Services, plan: AssemblyPlan, state: AssemblyState) -> Mistakes:
    """What looks wrong now, by holes; without what a person said is right, and without what cannot be read."""
    view, product = services.now.observation.bench, services.tools.product
    holes = view.holes if view else {}
    seen = {name: hole for name, hole in holes.items() if hole.part and state.known_wrong.get(name) != hole.part}
    goal = services.tools.guard.sure_goal(plan, state)
    there = {name: hole.part for name, hole in seen.items() if hole.part is not None}
    wanted = product.goal_placements(goal, there) if goal is not None else {}
    return tuple(_judged(product, seen, wanted, state.kept))


def _judged(
    product: Product, seen: Mapping[str, HoleView], wanted: Mapping[str, str], kept: Mapping[str, str | None]
) -> Iterator[Mistake]:
    counts = Counter(hole.part for hole in seen.values())  # with what is kept: the others are too many then
    for position, hole in seen.items():
        part = hole.part
        if kept.get(position) == part:
            continue
        if part not in product.parts:
            yield Mistake(position, "surplus", part)
        elif wanted and wanted.get(position) != part:
            yield Mistake(position, "wrong" if position in wanted else "surplus", part, wanted.get(position))
        elif counts[part] > product.most[part] and not wanted:
            yield Mistake(position, "surplus", part)
        elif not hole.upright:
            yield Mistake(position, "crooked", part)


def reason_of(product: Product, mistakes: Mistakes) -> str:
    """What is wrong, for people."""
    kind, names = mistakes[0].kind, _listed([mistake.position for mistake in mistakes])
    if kind == "wrong":
        return listed(
            [
                Message(
                    "{position} holds the {part}, where this bracket needs the {wanted}",
                    position=mistake.position,
                    part=product.title(mistake.part or ""),
                    wanted=product.title(mistake.wanted or ""),
                )
                for mistake in mistakes
            ]
        )
    if kind == "surplus":
        there = Counter(mistake.part or "" for mistake in mistakes)
        takes = {part: product.most[part] for part in there}
        return listed(
            [
                Message("{names} holds the {part}, which is one too many", names=names, part=product.title(part))
                if there[part] == 1 and takes[part]
                else Message(
                    "{names} hold the {part}, and a bracket takes {takes} of them",
                    names=_listed([mistake.position for mistake in mistakes if mistake.part == part]),
                    part=product.title(part),
                    takes=takes[part] or "none",
                )
                for part in there
            ]
        )
    if kind == "crooked":
        return Message(
            "the {part} in {names} does not stand straight", part=product.title(mistakes[0].part or ""), names=names
        )
    return Message("I have not been able to see into {names} for a while", names=names)


def todo_of(mistakes: Mistakes) -> str:
    """What the person should do."""
    single, several = TODO[mistakes[0].kind]
    return single if len(mistakes) == 1 else several


def _listed(names: list[str]) -> str:
    if len(names) == 1:
        return names[0]
    return Message("{first} and {last}", first=", ".join(names[:-1]), last=names[-1])
