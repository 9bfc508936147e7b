"""The paper's numbers, from one file: whatever stands beside a figure of ours is looked up here by its conditions."""

from __future__ import annotations

from collections.abc import Mapping
from functools import cache
from pathlib import Path

from pydantic import Field

from bracket_ground.errors import InputError
from bracket_ground.files.model import Model
from bracket_ground.files.yaml_file import load_yaml

PAPER = Path(__file__).with_name("paper.yaml")


class PrintedTable(Model):
    """A table or figure of the paper.

    Attributes:
        conditions: how the paper counted.
        rows: figures as printed, by the condition of the row and that of the column.
    """

    conditions: str
    rows: Mapping[str, Mapping[str, str]]


class Paper(Model):
    """The file.

    Attributes:
        tables: by their names in the paper.
        algorithm_1: first and last printed line by node.
    """

    tables: Mapping[str, PrintedTable]
    algorithm_1: Mapping[str, tuple[int, ...]] = Field(alias="algorithm 1")

    def printed(self, place: str, beside: str) -> str:
        """The figure at TABLE/ROW/COLUMN.

        Args:
            beside: what our own figure says of itself; it must name the same conditions.

        Raises:
            InputError: there is no such figure, or ours was measured under other conditions.
        """
        table, row, column = place.split("/")
        try:
            figure = self.tables[table].rows[row][column]
        except KeyError:
            raise InputError(f"{PAPER.name}: no figure {place!r}") from None
        if lacking := [words for words in (table, row, column) if words not in beside]:
            raise InputError(f"{place!r} stands beside {beside!r}, which does not say {', '.join(lacking)}")
        return figure


@cache
def paper() -> Paper:
    """The paper's numbers."""
    return load_yaml(PAPER, Paper)
