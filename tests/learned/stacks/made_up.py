"""Made-up scenes of stacks with made-up features that tell who lies on whom."""

from __future__ import annotations

from itertools import combinations

import numpy as np

from cell.interfaces.stacks import VMRD_CLASSES, StackedObject, StackedScene
from learned.lab.stacks.views import Labelled, StackView, labelled

WIDTH = 6


def scene(seed: int) -> StackedScene:
    """Two to five objects, each of which lies on all that are in a chain below it, or on nothing."""
    rng = np.random.default_rng(seed)
    count = int(rng.integers(2, 6))
    below: list[tuple[int, ...]] = []
    for number in range(count):
        on = int(rng.integers(-1, number)) if number else -1
        below.append(() if on < 0 else (*below[on], on))
    names = rng.choice(VMRD_CLASSES, count, replace=False)
    boxes = rng.uniform((0, 0, 220, 160), (200, 150, 470, 350), (count, 4)).round(1)
    objects = []
    for number in range(count):
        children = tuple(other + 1 for other in range(count) if number in below[other])
        left, top, right, bottom = boxes[number].tolist()
        fathers = tuple(other + 1 for other in below[number])
        box = (left, top, right, bottom)
        objects.append(StackedObject(number + 1, str(names[number]), box, fathers, children, 0.1 * len(below[number])))
    return StackedScene(f"{seed:06d}", (480, 360), tuple(objects))


def example(seed: int) -> Labelled:
    """A scene whose unions' features say whether the left one of two is on top; regions' first feature is how left."""
    drawn = scene(seed)
    boxes = np.array([one.box_px for one in drawn.objects]) / (480, 360, 480, 360)
    count = len(boxes)
    unions = np.zeros((count, count, WIDTH), np.float16)
    for i, j in combinations(range(count), 2):
        first, second = (i, j) if boxes[i, 0] < boxes[j, 0] else (j, i)
        lies = drawn.objects[second].index in drawn.objects[first].children
        carries = drawn.objects[first].index in drawn.objects[second].children
        unions[i, j, :3] = unions[j, i, :3] = (lies, carries, not (lies or carries))
    regions = np.random.default_rng(seed).normal(size=(count, WIDTH)).astype(np.float16)
    regions[:, 0] = 6 * boxes[:, 0] - 2
    tops = np.array([one.top_m for one in drawn.objects], dtype=float)
    names = tuple(one.name for one in drawn.objects)
    return labelled(drawn, StackView(names, boxes, regions, 3 * unions, tops))
