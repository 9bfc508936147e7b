"""Rows of files about what is in the holes."""

from __future__ import annotations

from collections.abc import Sequence

from pydantic import Field, StrictBool

from bracket_cell.learned.records import StillRow, one_of
from bracket_ground.files.model import Model
from bracket_ground.interfaces.product import Product


class Hole(Model):
    """What one hole holds.

    Attributes:
        part: type of the part in or on it; None where it is empty.
        upright: it stands in the hole as it should; also where the hole is empty.
        covered: share of what is seen around it that hand, arm or a held part hides.
    """

    position: str
    part: str | None
    upright: StrictBool = True
    covered: float = Field(default=0.0, ge=0, le=1)


class PlateRow(StillRow):
    """An image of the plate and all of its holes, in any order."""

    holes: tuple[Hole, ...]


def holes_of(given: Sequence[Hole], product: Product) -> tuple[Hole, ...]:
    """Holes by their names, in the order of the product.

    Raises:
        ValueError: a hole is missing, named twice or unknown, or holds a part of no known type.
    """
    named: dict[str, Hole] = {}
    for hole in given:
        one_of("holes: no position", hole.position, product.positions)
        if hole.position in named:
            raise ValueError(f"holes: {hole.position} stands there twice")
        if hole.part is not None:
            one_of(f"holes: {hole.position}: no part", hole.part, tuple(product.parts))
        named[hole.position] = hole
    if missing := [position for position in product.positions if position not in named]:
        raise ValueError(f"holes: {', '.join(missing)} missing; each hole of the plate needs a label")
    return tuple(named[position] for position in product.positions)
