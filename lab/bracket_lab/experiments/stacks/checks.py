"""What must be right in every labelled picture of stacked objects, whichever format it came in."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from pydantic import Field

from bracket_ground.errors import InputError, Place, Problem
from bracket_ground.files.model import Model
from bracket_ground.interfaces.stacks import VMRD_CLASSES, StackedObject, StackedScene
from bracket_lab.learned.training.schedule import Schedule

Kind = Literal["default", "paper", "vmrn", "gvmrn_rf"]
LEARNED: tuple[Kind, ...] = ("default", "paper", "vmrn", "gvmrn_rf")
RULES = ("topmost", "always")
WHOLE = 1.0  # the share of the papers' networks
PAPER_HIDDEN = 2048  # of VMRN's fully connected layers
VMRD_PICTURES = 4233  # for training
MOST_EPOCHS = 4.0  # times as many as for VMRD


class StackTraining(Model):
    """Detector first, then planners on its frozen features.

    Attributes:
        classes: that there are, in their order.
        share: of the papers' networks: below 1 EfficientNet-Lite0 at 320 pixels instead of ResNet-101, and so much of
            the width of the heads.
        detector: its training; `epochs` is for as many pictures as VMRD has.
        heads: the planners' training, likewise.
    """

    classes: tuple[str, ...] = VMRD_CLASSES
    share: float = Field(default=0.125, ge=0.05, le=1)
    detector: Schedule = Schedule(epochs=8, batch=16, peak_rate=1e-3)
    heads: Schedule = Schedule(epochs=12, batch=16, peak_rate=1e-3)

    @property
    def hidden(self) -> int:
        """Width of the heads."""
        return round(PAPER_HIDDEN * self.share)

    def fit_to(self, pictures: int) -> StackTraining:
        """With more epochs the fewer pictures there are: as the root of how many are missing."""
        more = min(MOST_EPOCHS, max(1.0, math.sqrt(VMRD_PICTURES / max(1, pictures))))
        longer = {
            name: schedule.model_copy(update={"epochs": round(more * schedule.epochs)})
            for name, schedule in (("detector", self.detector), ("heads", self.heads))
        }
        return self.model_copy(update=longer)


Part = Literal["index", "name", "box", "fathers", "children"]
Where = Callable[[int, Part], Place]  # of a part of the object at a place in the list
BORDER_PX = 1.0  # by which a box may pass the picture's edge: some tools count to the edge, some to the last pixel


@dataclass(frozen=True)
class StackData:
    """Labelled pictures of a folder.

    Attributes:
        trainval, test: scenes by split.
        images: file of each scene's picture, by name.
    """

    trainval: tuple[StackedScene, ...]
    test: tuple[StackedScene, ...]
    images: Mapping[str, Path]

    @property
    def classes(self) -> tuple[str, ...]:
        """VMRD's in their order, where all are of these; else those that there are."""
        names = {item.name for scene in (*self.trainval, *self.test) for item in scene.objects}
        return VMRD_CLASSES if names <= set(VMRD_CLASSES) else tuple(sorted(names))


def faults(scene: StackedScene, where: Where, classes: Sequence[str] | None) -> Iterator[Problem]:
    """Everything that is wrong in a picture.

    Args:
        classes: that are legal; None where any is.
    """
    indices = [item.index for item in scene.objects]
    for place, item in enumerate(scene.objects):
        if item.index in indices[:place]:
            yield Problem(where(place, "index"), f"index {item.index} is taken by another object", "indices differ")
        if classes is not None and item.name not in classes:
            legal = f"legal: {', '.join(classes)}"
            yield Problem(where(place, "name"), f"unknown class {item.name!r}", legal)
        yield from _box_faults(scene, item, where(place, "box"))
        yield from _link_faults(scene, item, place, where)
    yield from _cycle_faults(scene, where)


def _box_faults(scene: StackedScene, obj: StackedObject, place: Place) -> Iterator[Problem]:
    left, top, right, bottom = obj.box_px
    width, height = scene.size_px
    if not (left < right and top < bottom):
        yield Problem(place, f"the box of object {obj.index} is empty: {_told(obj)}", "left < right and top < bottom")
    if min(left, top) < -BORDER_PX or right > width + BORDER_PX or bottom > height + BORDER_PX:
        what = f"the box of object {obj.index} is outside the picture of {width} x {height} pixels: {_told(obj)}"
        yield Problem(place, what)


def _told(obj: StackedObject) -> str:
    return " ".join(f"{value:g}" for value in obj.box_px)


def _link_faults(scene: StackedScene, obj: StackedObject, place: int, where: Where) -> Iterator[Problem]:
    """Fathers and children must be there, and name each other."""
    others = {other.index: other for other in scene.objects}
    sides: tuple[tuple[Part, tuple[int, ...], str, str], ...] = (
        ("fathers", obj.fathers, "father", "child"),
        ("children", obj.children, "child", "father"),
    )
    for part, named, said, back in sides:
        for number in named:
            if number == obj.index:
                yield Problem(where(place, part), f"object {number} is its own {said}")
            elif number not in others:
                legal = f"there are {', '.join(map(str, sorted(others)))}"
                yield Problem(where(place, part), f"object {obj.index} has {said} {number}, which is not there", legal)
            elif obj.index not in (others[number].children if said == "father" else others[number].fathers):
                what = f"object {obj.index} has {said} {number}, but {number} does not have {back} {obj.index}"
                yield Problem(where(place, part), what, "both sides of a relation are written")
        if repeated := sorted({number for number in named if named.count(number) > 1}):
            yield Problem(where(place, part), f"object {obj.index} names {said} {repeated[0]} twice")


def _cycle_faults(scene: StackedScene, where: Where) -> Iterator[Problem]:
    """An object must not lie on itself, by way of others."""
    fathers = {item.index: set(item.fathers) - {item.index} for item in scene.objects}
    while free := [index for index, below in fathers.items() if not below & fathers.keys()]:
        for index in free:
            del fathers[index]
    if fathers:
        ring = _ring(fathers)
        place = next(number for number, item in enumerate(scene.objects) if item.index == ring[0])
        what = f"objects lie on each other in a ring: {' on '.join(map(str, ring))}"
        yield Problem(where(place, "fathers"), what, "what lies on top is taken first, so there must be a topmost one")


def _ring(fathers: Mapping[int, set[int]]) -> list[int]:
    """A closed way along fathers, each of which has a father among them."""
    way = [min(fathers)]
    while (below := min(fathers[way[-1]] & fathers.keys())) not in way:
        way.append(below)
    return [*way[way.index(below) :], below]


def children_first(scene: StackedScene, wanted: int) -> list[int]:
    """Indices of what must be taken before an object, in an order that works: who lies on top goes first."""
    above, objects = above_of(scene), {item.index: item for item in scene.objects}
    left, order = set(above[wanted]), list[int]()
    while left:
        free = min((at for at in left if not above[at] & left), key=lambda at: objects[at].box_px)
        order.append(free)
        left.remove(free)
    return order


def above_of(scene: StackedScene) -> dict[int, set[int]]:
    """By index all that lies on an object, also by way of others."""
    above = {item.index: set(item.children) for item in scene.objects}
    for _ in above:
        above = {index: children.union(*(above[child] for child in children)) for index, children in above.items()}
    return above


def require(problems: Iterable[Problem], at_most: int = 20) -> None:
    """Raises InputError with the first problems, if there are any."""
    found = list(problems)
    if found:
        more = [f"... and {len(found) - at_most} more"] if len(found) > at_most else []
        raise InputError(*found[:at_most], *more)


def require_splits(splits: Mapping[Path, Sequence[str]]) -> None:
    """Check that splits hold something, and nothing twice.

    Args:
        splits: names of pictures by file, a line each.

    Raises:
        InputError: one is empty, or a picture is in two places.
    """
    problems, seen = [], dict[str, Place]()
    for file, names in splits.items():
        if not names:
            problems.append(Problem(Place(file, 1), "the split is empty", "one picture a line"))
        for line, name in enumerate(names, 1):
            if name in seen:
                problems.append(Problem(Place(file, line), f"picture {name} is at {seen[name]}, too"))
            seen.setdefault(name, Place(file, line))
    require(problems)
