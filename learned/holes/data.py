"""Labelled stills of the plate: plates.jsonl of `cell lab data plates` or `cell label`."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from pydantic import Field, StrictBool

from cell.files.model import Model
from cell.interfaces.product import Product
from learned.training.rows import one_of
from learned.training.still_dataset import Still, StillRow, load_stills


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


@dataclass(frozen=True)
class Plate(Still):
    """One image of the plate.

    Attributes:
        holes: in the order of the product.
    """

    holes: tuple[Hole, ...]


def load_plates(folders: Sequence[Path], product: Product) -> list[Plate]:
    """All images of some folders.

    Raises:
        InputError: a file is missing or wrong; the message names file and line.
    """

    def labelled(still: Still, row: PlateRow) -> Plate:
        return Plate(**vars(still), holes=holes_of(row.holes, product))

    return load_stills(folders, "plates", PlateRow, labelled)


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
