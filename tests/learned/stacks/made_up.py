"""Made-up scenes of stacks."""

from __future__ import annotations

import numpy as np

from bracket_ground.interfaces.stacks import VMRD_CLASSES, StackedObject, StackedScene


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
