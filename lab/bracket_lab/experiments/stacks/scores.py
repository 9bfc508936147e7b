"""Scores of planners of stacks: pairs and pictures as VMRN counts them, and the paper's answers."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from bracket_ground.interfaces.pose import Array
from bracket_lab.experiments.stacks.planners import StackPlanner
from bracket_lab.experiments.stacks.views import Labelled, StackView
from bracket_lab.learned.scores import ScoreCounter

LEAST_IOU = 0.5
OBJECTS = (2, 3, 4, 5)  # of a picture: VMRD's bins


@dataclass(frozen=True)
class Seen:
    """A picture with its answer, as it is written and as a planner sees it.

    Attributes:
        view: of the boxes that are written, or of a detector's.
    """

    truth: Labelled
    view: StackView


def score(planner: StackPlanner, pictures: Sequence[Seen], seed: int = 0) -> dict[str, float]:
    """All scores.

    OR, OP, IA as VMRN counts: of the pairs that there are, and of those that are found, how many have both objects and
    the right relation; pictures in which every pair is right and none is false. `answer`, the paper's IA: for one
    object at random of each picture, graspability and, where something lies on it, text right. `graph`: graspability of
    all objects. `decoder`: text of the objects that the graph rightly calls not graspable.
    """
    counter = ScoreCounter()
    for number, picture in enumerate(pictures):
        match = matched(picture)
        _count_pairs(counter, planner, picture, match)
        wanted = int(np.random.default_rng([seed, number, 23]).integers(len(match)))
        _count_answers(counter, planner, picture, match, wanted)
    return counter.scores()


def matched(picture: Seen) -> list[int | None]:
    """For each object the one of the view that has its class and its box, one to one."""
    truth, view = picture.truth.view, picture.view
    if truth is view:
        return list(range(len(view.names)))
    shares, taken = ious(truth.boxes, view.boxes), set[int]()
    match: list[int | None] = [None] * len(truth.names)
    for found in range(len(view.names)):  # the surest detection first
        fits = [
            at
            for at, name in enumerate(truth.names)
            if name == view.names[found] and shares[at, found] > LEAST_IOU and at not in taken
        ]
        if fits:
            best = max(fits, key=lambda fit: float(shares[fit, found]))
            match[best] = found
            taken.add(best)
    return match


def ious(first: Array, second: Array) -> Array:
    """(n, m) of boxes (n, 4) and (m, 4)."""
    low = np.maximum(first[:, None, :2], second[None, :, :2])
    high = np.minimum(first[:, None, 2:], second[None, :, 2:])
    met = np.maximum(high - low, 0).prod(axis=-1)
    areas = [(boxes[:, 2:] - boxes[:, :2]).prod(axis=-1) for boxes in (first, second)]
    found: Array = met / np.maximum(areas[0][:, None] + areas[1][None] - met, 1e-12)
    return found


def _count_pairs(counter: ScoreCounter, planner: StackPlanner, picture: Seen, match: Sequence[int | None]) -> None:
    children, said = picture.truth.children, planner.relations(picture.view)
    count, found = len(match), len(picture.view.names)
    right = 0
    for i in range(count):
        for j in range(i):
            a, b = match[i], match[j]
            same = a is not None and b is not None and (said[a, b], said[b, a]) == (children[i, j], children[j, i])
            counter.add("OR", bool(same))
            right += bool(same)
    for place in range(found * (found - 1) // 2):
        counter.add("OP", place < right)
    whole = right == count * (count - 1) // 2 and found == count and None not in match
    counter.add("IA", whole)
    counter.add(f"IA_{count}", whole)


def _count_answers(
    counter: ScoreCounter, planner: StackPlanner, picture: Seen, match: Sequence[int | None], wanted: int
) -> None:
    for number, found in enumerate(match):
        free = not picture.truth.above[number].any()
        verdict = text = False
        if found is not None:
            plan = planner.plan(picture.view, found)
            verdict = (plan.graspable >= 0.5) == free
            text = free or names_what_lies_on(plan.text, picture.truth, number)
        counter.add("graph", verdict)
        if not free and verdict:
            counter.add("decoder", text)
        if number == wanted:
            for name in ("answer", f"answer_{len(match)}"):
                counter.add(name, verdict and text)


def names_what_lies_on(text: str, truth: Labelled, wanted: int) -> bool:
    """Whether a text names the classes of all that lies on an object and nothing else, in an order that works."""
    said = text.removeprefix("move ").split(" and ") if text.startswith("move ") else []
    left = set(np.flatnonzero(truth.above[wanted]).tolist())
    for name in said:
        free = [at for at in left if truth.view.names[at] == name and not truth.above[at, list(left)].any()]
        if not free:
            return False
        left.remove(free[0])
    return not left


def restricted(pictures: Iterable[Seen], classes: Sequence[str]) -> list[Seen]:
    """The pictures whose objects are all of these classes."""
    return [picture for picture in pictures if set(picture.truth.view.names) <= set(classes)]


def of_classes(pictures: Sequence[Seen], classes: Sequence[str]) -> list[Seen]:
    """The pictures that show how hard so many classes are: drawn from just these, where that is told of any."""
    drawn = [picture for picture in pictures if picture.truth.scene.drawn_from == len(classes)]
    return restricted(drawn or pictures, classes)
