"""Labelled stills of the plate: plates.jsonl of `cell lab data plates` or `cell label`."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from bracket_cell.learned.holes.records import Hole, PlateRow, holes_of
from bracket_ground.interfaces.product import Product
from bracket_lab.learned.training.still_dataset import Still, load_stills


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
