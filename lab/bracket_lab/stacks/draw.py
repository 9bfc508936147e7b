"""One labelled picture of a stack from one number."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass

import mujoco
import numpy as np
from numpy.typing import NDArray

from bracket_ground.errors import CellError
from bracket_ground.interfaces.stacks import StackedObject, StackedScene
from bracket_lab.stacks import desk, household
from bracket_lab.stacks.photograph import HEIGHT_PX, WIDTH_PX, photograph
from bracket_sim.stacks.pieces import Thing
from bracket_sim.stacks.settings import StackSettings
from bracket_sim.stacks.stacking import Stack, carriers_of
from bracket_sim.stacks.stage import Stage, table_with

LIFT_M, LIFT_M_S = 0.060, 0.20
MOVED_M = 0.003
DOUBTFUL_M = (0.0015, 0.006)  # a scene in which something moves so far is not taken: the next trial may say otherwise

Rests = NDArray[np.bool_]  # (n, n): [b, a] whether b rests on a


def relations(stage: Stage) -> Rests | None:
    """Who rests on whom: a carries b, or b moves by more than MOVED_M when a is lifted by LIFT_M.

    So b rests on a as well where others are between them. The stage is left as it was.

    Returns:
        (n, n), [b, a] whether b rests on a; None where that is doubtful: a movement near the limit, two objects that
        rest on each other, or one that moves without touching anything that leads to the lifted one.
    """
    count, before = len(stage.bodies), stage.state()
    touching, rests = _linked(stage), np.zeros((count, count), dtype=bool)
    for b, carriers in enumerate(carriers_of(stage)):
        rests[b, carriers] = True
    for a in range(count):
        stage.restore(before)
        moved = stage.lift(a, LIFT_M, LIFT_M_S)
        moved[a] = 0.0
        doubtful = (moved > DOUBTFUL_M[0]) & (moved < DOUBTFUL_M[1])
        unlinked = (moved > MOVED_M) & ~touching[a]
        if doubtful.any() or unlinked.any():
            stage.restore(before)
            return None
        rests[:, a] |= moved > MOVED_M
    stage.restore(before)
    return None if (rests & rests.T).any() else rests


def depth(rests: Rests) -> int:
    """Most relations in a chain."""
    count = len(rests)
    longest = np.zeros(count, dtype=int)
    for _ in range(count):
        longest = np.where(rests, longest[None] + 1, 0).max(axis=1, initial=0)
    return int(longest.max(initial=0))


def _linked(stage: Stage) -> Rests:
    """(n, n) whether contacts lead from one object to another, over others perhaps."""
    numbers = {body: number for number, body in enumerate(stage.bodies)}
    linked = np.eye(len(numbers), dtype=bool)
    for first, second in stage.contacts()[0].tolist():
        if first in numbers and second in numbers:
            linked[numbers[first], numbers[second]] = linked[numbers[second], numbers[first]] = True
    for _ in numbers:
        linked = (linked.astype(int) @ linked.astype(int)) > 0
    return linked


Rng = np.random.Generator


def draw_thing(name: str, rng: Rng) -> Thing:
    """A copy of a kind."""
    return _KINDS[name](rng)


_KINDS: dict[str, Callable[[Rng], Thing]] = {
    "box": household.carton,
    "banana": household.banana,
    "notebook": desk.notebook,
    "screwdriver": desk.screwdriver,
    "toothpaste": household.toothpaste,
    "apple": household.apple,
    "stapler": desk.stapler,
    "mobile phone": desk.mobile_phone,
    "bottle": household.bottle,
    "pen": desk.pen,
    "mouse": desk.mouse,
    "umbrella": household.umbrella,
    "remote controller": desk.remote,
    "cans": household.can,
    "tape": desk.tape,
    "knife": desk.knife,
    "wrench": desk.wrench,
    "cup": household.cup,
    "charger": desk.charger,
    "badminton": household.badminton,
    "wallet": household.wallet,
    "wrist developer": household.wrist_developer,
    "glasses": household.glasses,
    "pliers": desk.pliers,
    "headset": household.headset,
    "toothbrush": household.toothbrush,
    "card": desk.card,
    "paper": desk.paper,
    "towel": household.towel,
    "shaver": household.shaver,
    "watch": household.watch,
}
KINDS = tuple(_KINDS)


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
    """Set so many objects down, and try who rests on whom; None where one falls, or it is doubtful or too deep."""
    names = tuple(KINDS[index] for index in rng.permutation(settings.kinds)[:count])
    things = [draw_thing(name, rng) for name in names]
    stage = table_with(things, rng)
    with _unheard():
        if not Stack(stage, [thing.stances for thing in things], settings, rng).build():
            return None
        rests = relations(stage)
    if rests is None or stage.diverged or depth(rests) > settings.deepest:
        return None
    return Standing(stage, names, rests)


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
        tuple(int(at) + 1 for at in np.flatnonzero(rests[number])),
        tuple(int(at) + 1 for at in np.flatnonzero(rests[:, number])),
        round(float(standing.stage.points(number)[:, 2].max()), 4),
    )
