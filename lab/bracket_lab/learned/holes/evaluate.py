"""Scores of a hole reader on labelled stills of the plate."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from bracket_cell.fleet.intervals import wilson
from bracket_cell.learned.holes.model import Reading
from bracket_cell.learned.records import Hole, PlateRow, holes_of
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


BARE, COVERED = 0.04, 0.15  # share hidden up to which an answer is due, and from which none is

Read = Callable[[Sequence[Plate]], Mapping[str, Reading | None]]


@dataclass
class HoleFindings:
    """What a reader said about holes, against the truth.

    Attributes:
        bare: holes that nothing hides; said: those of them with an answer; right: with part or emptiness right.
        filled, called_empty: all filled holes, hidden or not, and those that were called empty.
        upright_said, upright_right: filled holes with the right part, and those with the right posture.
        astray, astray_told: those of them that do not stand upright, and those that were told not to.
        covered, covered_said, covered_wrong: holes that are hidden, those with an answer, and a wrong one.
        seconds: of processor time an image.
    """

    bare: int = 0
    said: int = 0
    right: int = 0
    filled: int = 0
    called_empty: int = 0
    upright_said: int = 0
    upright_right: int = 0
    astray: int = 0
    astray_told: int = 0
    covered: int = 0
    covered_said: int = 0
    covered_wrong: int = 0
    seconds: list[float] = field(default_factory=list)

    def add(self, hole: Hole, reading: Reading | None) -> None:
        """One more hole."""
        right = reading is not None and reading.part == hole.part
        self.filled += hole.part is not None
        self.called_empty += hole.part is not None and reading is not None and reading.part is None
        if hole.covered <= BARE:
            self.bare, self.said, self.right = self.bare + 1, self.said + (reading is not None), self.right + right
            if right and reading is not None and hole.part is not None:
                self.upright_said += 1
                self.upright_right += reading.upright == hole.upright
                self.astray += not hole.upright
                self.astray_told += not hole.upright and not reading.upright
        elif hole.covered >= COVERED:
            self.covered += 1
            self.covered_said += reading is not None
            self.covered_wrong += reading is not None and not right

    def scores(self) -> dict[str, float]:
        """By name, shares with the ends of their intervals."""
        figures: dict[str, float] = {"holes": float(self.bare), "filled": float(self.filled)}
        for name, right, count in (
            ("said", self.said, self.bare),
            ("right_where_said", self.right, self.said),
            ("right", self.right, self.bare),
            ("called_empty", self.called_empty, self.filled),
            ("upright", self.upright_right, self.upright_said),
            ("astray_told", self.astray_told, self.astray),
            ("covered_said", self.covered_said, self.covered),
            ("covered_wrong", self.covered_wrong, self.covered),
        ):
            if count:
                figures[name] = right / count
                figures[f"{name}_low"], _, figures[f"{name}_high"] = wilson(right, count)
        if self.upright_said:
            figures["upright_n"] = float(self.upright_said)
        if self.seconds:
            for percent in (50, 95):
                figures[f"processor_ms_p{percent}"] = float(np.percentile(self.seconds, percent)) * 1e3
        return figures


def evaluate_holes(frames: Sequence[Plate], read: Read, findings: HoleFindings) -> None:
    """Add to the findings what a reader says about a still that it sees in some frames."""
    began_s = time.process_time()
    readings = read(frames)
    findings.seconds.append((time.process_time() - began_s) / len(frames))
    for hole in frames[-1].holes:
        findings.add(hole, readings.get(hole.position))
