"""One labelled picture of a stack from one number."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass

import mujoco
import numpy as np
from numpy.typing import NDArray

from bracket_ground.errors import CellError
from bracket_ground.interfaces.stacks import StackedObject, StackedScene
from bracket_lab.stacks.kinds import KINDS, draw_thing
from bracket_lab.stacks.photograph import HEIGHT_PX, WIDTH_PX, photograph
from bracket_lab.stacks.trial import Rests, relations
from bracket_sim.stacks.settings import StackSettings
from bracket_sim.stacks.stacking import Stack
from bracket_sim.stacks.stage import Stage, table_with

TRIES = 100  # heaps that are begun for one picture


@dataclass(frozen=True)
class Standing:
    """Objects at rest, and which rests on which.

    Attributes:
        names: their kinds.
        rests: (n, n), [b, a] whether b rests on a.
    """

    stage: Stage
    names: tuple[str, ...]
    rests: Rests


@dataclass(frozen=True, eq=False)
class DrawnStack:
    """A labelled picture (height, width, 3), RGB."""

    scene: StackedScene
    image: NDArray[np.uint8]


def draw_stack(number: int, settings: StackSettings, seed: int = 0) -> DrawnStack:
    """The picture of this number of those that a seed gives.

    Raises:
        CellError: none came to rest in many tries.
    """
    rng = np.random.default_rng([seed, number, _STREAM])
    count = _count(rng, settings)
    for _ in range(TRIES):
        standing = _begun(rng, settings, count)
        view = None
        if standing is not None:
            view = photograph(standing.stage, rng, rng.random() < settings.slanted_share)
        if standing is not None and view is not None:
            objects = tuple(_labelled(standing, number, view.boxes[number]) for number in range(len(standing.names)))
            scene = StackedScene(f"{number:06d}", (WIDTH_PX, HEIGHT_PX), objects, view.grasps, settings.kinds)
            return DrawnStack(scene, view.image)
    raise CellError(f"stack {number} of seed {seed}: nothing came to rest in {TRIES} tries with {settings!r}")


def stand(number: int, settings: StackSettings, seed: int = 0) -> Standing:
    """One of a seed's stacks without a picture, for trials with it; raises as `draw_stack`."""
    rng = np.random.default_rng([seed, number, _STREAM])
    count = _count(rng, settings)
    for _ in range(TRIES):
        if (standing := _begun(rng, settings, count)) is not None:
            return standing
    raise CellError(f"stack {number} of seed {seed}: nothing came to rest in {TRIES} tries with {settings!r}")


_STREAM = 11  # of random numbers


def _count(rng: np.random.Generator, settings: StackSettings) -> int:
    """How many objects a picture has; drawn once, as large heaps fail more often."""
    return int(rng.integers(settings.fewest, settings.most + 1))


def _begun(rng: np.random.Generator, settings: StackSettings, count: int) -> Standing | None:
    """Set so many objects down, and try who rests on whom; None where one falls, or it is doubtful."""
    names = tuple(KINDS[index] for index in rng.permutation(settings.kinds)[:count])
    things = [draw_thing(name, rng) for name in names]
    stage = table_with(things, rng)
    with _unheard():
        if not Stack(stage, [thing.stances for thing in things], settings, rng).build():
            return None
        rests = relations(stage)
    return None if rests is None or stage.diverged else Standing(stage, names, rests)


@contextmanager
def _unheard() -> Iterator[None]:
    """MuJoCo's warnings of physics that diverge go nowhere: such a scene is not taken."""
    mujoco.set_mju_user_warning(lambda _: None)
    try:
        yield
    finally:
        mujoco.set_mju_user_warning(None)


def _labelled(standing: Standing, number: int, box_px: tuple[float, float, float, float]) -> StackedObject:
    rests = standing.rests
    return StackedObject(
        number + 1,
        standing.names[number],
        box_px,
        tuple(int(one) + 1 for one in np.flatnonzero(rests[number])),
        tuple(int(one) + 1 for one in np.flatnonzero(rests[:, number])),
        round(float(standing.stage.points(number)[:, 2].max()), 4),
    )
