"""Demonstrations in a file: JSON lines, a header and then one demonstration a line, checked when they are read.

Header: what the file is, the product it was recorded with, and where it comes from.

    {"format": "cell.demonstrations", "version": 1, "parts": ["o1", "o2", "o3"], "positions": ["p1", ...],
     "goals": {"g0": ["o1", ...], ...}, "source": "cell lab data semantic --seed 0"}

Demonstration: the goal, and the placements in the order in which they were made.

    {"goal": "g0", "placements": [{"part": "o1", "position": "p2", "time_s": 3.1}, {"part": ...}, ...]}

Of a placement, `time_s` (since the demonstration began) and `by` ("person", the default, or "robot") may be left out;
so may, of a demonstration, `unordered_n` (0) and `source` (for example the log that it was taken from).
`unordered_n` says that this many placements at the beginning are known as a state only, in no order: a log that begins
with parts in their holes, or one of the paper's scenarios (a partial state and what was placed next).

The header's goals are the product's, and may be more: those that were learned from finished brackets.

A demonstration need not be complete, but every placement is what its goal wants there: leave out runs whose goal is
not known and placements that were misdetected or corrected. Planners learn from the states after `unordered_n`,
`unordered_n` + 1, ... placements, each with the placement that followed; habits of order only from what people did.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any, Final, Literal

from pydantic import Field, ValidationError

from bracket_cell.learned.records import read_rows
from bracket_ground.errors import InputError, Place, Problem, mistakes
from bracket_ground.files.files import write_whole
from bracket_ground.files.model import Model
from bracket_ground.interfaces.product import Product
from bracket_ground.interfaces.variants import Choice

FORMAT: Final = "cell.demonstrations"


VERSION: Final = 1


class Header(Model):
    """The first line of a file."""

    format: Literal["cell.demonstrations"]
    version: Literal[1]
    parts: tuple[str, ...]
    positions: tuple[str, ...]
    goals: dict[str, tuple[Choice, ...]]
    source: str = ""


class PlacementRecord(Model):
    """A part put into a position.

    Attributes:
        time_s: since the demonstration began.
        by: who put it there.
    """

    part: str
    position: str
    time_s: float | None = Field(default=None, ge=0, allow_inf_nan=False)
    by: Literal["person", "robot"] = "person"


class Demonstration(Model):
    """One assembly, or the part of it that was recorded.

    Attributes:
        placements: in the order in which they were made.
        unordered_n: how many of the first placements are known as a state only.
        source: where it was recorded.
    """

    goal: str
    placements: tuple[PlacementRecord, ...] = Field(min_length=1)
    unordered_n: int = Field(default=0, ge=0)
    source: str = ""

    def misfit(self, product: Product) -> str | None:
        """Why this is no demonstration of the product, or None."""
        if self.goal not in product.goals:
            return f"no goal {self.goal!r}; goals: {', '.join(product.goals)}"
        if self.unordered_n >= len(self.placements):
            return (
                f"unordered_n is {self.unordered_n}, but there are {len(self.placements)} placements: it must be less"
            )
        wanted = product.goal_placements(
            self.goal, {placement.position: placement.part for placement in self.placements}
        )
        filled: set[str] = set()
        for placed in self.placements:
            if placed.position not in wanted:
                return f"no position {placed.position!r}; positions: {', '.join(wanted)}"
            if placed.position in filled:
                return f"position {placed.position} is filled twice"
            if placed.part != wanted[placed.position]:
                return f"{placed.part!r} at {placed.position}, where {self.goal} wants {wanted[placed.position]}"
            filled.add(placed.position)
        return None


def save_demonstrations(path: Path, product: Product, demonstrations: Sequence[Demonstration], source: str) -> None:
    """Write a file; one that was there before stays whole until the new one is.

    Args:
        source: the command or the logs that the demonstrations come from.

    Raises:
        InputError: the file cannot be written, or a demonstration does not fit the product.
    """
    for number, demonstration in enumerate(demonstrations, start=1):
        if what := demonstration.misfit(product):
            raise InputError(f"demonstration {number}: {what}")
    header = Header(
        format=FORMAT,
        version=VERSION,
        parts=tuple(product.parts),
        positions=product.positions,
        goals=product.goals,
        source=source,
    )
    lines = [header.model_dump_json(), *(some.model_dump_json(exclude_defaults=True) for some in demonstrations)]
    write_whole(path, "".join(f"{line}\n" for line in lines).encode())


def load_demonstrations(path: Path, product: Product) -> list[Demonstration]:
    """Read a file and check every line against the product.

    Raises:
        InputError: the file cannot be read, is of another format, version or product, or has mistakes (all of them,
            up to MOST_PROBLEMS, each with file and line).
    """
    known = product

    def header(read: dict[str, Any]) -> None:
        nonlocal known
        known = _known(read, product)

    def made(found: Demonstration) -> Demonstration:
        if what := found.misfit(known):
            raise ValueError(what)
        return found

    demonstrations = read_rows(path, Demonstration, made, header=header)
    if not demonstrations:
        raise InputError(Problem(Place(path, 1), "no demonstration after the header"))
    return demonstrations


def _known(read: dict[str, Any], product: Product) -> Product:
    """The product with the goals that a file's header knows: the product's own, and others that were learned.

    Raises:
        ValueError: it is no such header, or one of another product.
    """
    try:
        found = Header.model_validate(read)
    except ValidationError as error:
        raise ValueError(f"no header of {FORMAT} version {VERSION}: {mistakes(error)[0]}") from None
    for name, here, there in (
        ("parts", found.parts, tuple(product.parts)),
        ("positions", found.positions, product.positions),
        ("goals", {goal: found.goals.get(goal) for goal in product.goals}, product.goals),
    ):
        if here != there:
            raise ValueError(f"recorded with {name} {here}; the product has {there}")
    try:
        return Product.model_validate({**product.model_dump(), "goals": product.goals | found.goals})
    except ValidationError as error:
        raise ValueError(f"goals that the parts cannot make: {error.errors()[0]['msg']}") from None
