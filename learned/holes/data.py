"""Labelled stills of the plate (plates.jsonl of `cell lab data plates`)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from learned.training.still_dataset import Still, load_stills


@dataclass(frozen=True)
class Hole:
    """What one hole holds.

    Attributes:
        part: type of the part in or on it; None where it is empty.
        covered: share of what is seen around it that hand, arm or a held part hides.
    """

    position: str
    part: str | None
    upright: bool
    covered: float


@dataclass(frozen=True)
class Plate(Still):
    """One image of the plate."""

    holes: tuple[Hole, ...]


def load_plates(folders: Sequence[Path]) -> list[Plate]:
    """All images of some folders.

    Raises:
        InputError: a file is missing or wrong; the message names file and line.
    """
    return load_stills(folders, "plates", _plate)


def _plate(still: Still, row: dict[str, Any]) -> Plate:
    holes = tuple(Hole(hole["position"], hole["part"], hole["upright"], hole["covered"]) for hole in row["holes"])
    return Plate(**vars(still), holes=holes)
