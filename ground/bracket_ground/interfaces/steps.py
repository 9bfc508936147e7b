"""Steps of an assembly and their precedence: placements go by the name of their slot, fastenings by their own."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping
from graphlib import CycleError, TopologicalSorter
from typing import Literal

from pydantic import Field

from bracket_ground.files.model import Model


class Fastening(Model):
    """A step that fastens what is placed, done by the person.

    Attributes:
        at: slots whose parts it fastens; their placements come before it.
        how: what is done; the camera sees it as the action `screw`.
        torque_nm: what a tool must report [Nm]; without it the seen action is enough.
        title: its name for people.
    """

    at: tuple[str, ...] = Field(min_length=1)
    how: Literal["screw", "press"] = "screw"
    torque_nm: float | None = Field(default=None, gt=0, le=1000)
    title: str = ""


def in_order(steps: Iterable[str], before: Mapping[str, Collection[str]]) -> list[str]:
    """The steps so that each comes after what must be there before, else in the order in which they were given.

    Raises:
        ValueError: some precede each other.
    """
    names = list(steps)
    sorter = TopologicalSorter({name: [needed for needed in before.get(name, ()) if needed in names] for name in names})
    try:
        sorter.prepare()
    except CycleError as error:
        raise ValueError(" before ".join(reversed(error.args[1]))) from None
    ordered: list[str] = []
    ready: list[str] = []
    while sorter.is_active():
        ready = sorted([*ready, *sorter.get_ready()], key=names.index)
        ordered.append(ready.pop(0))
        sorter.done(ordered[-1])
    return ordered
