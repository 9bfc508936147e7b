"""What the commands that train and score detectors share: their options."""

from __future__ import annotations

from enum import StrEnum
from pathlib import Path
from typing import Annotated

import typer

from cell.commands.terminal import console
from cell.commands.weights import told_in

BudgetOption = Annotated[str, typer.Option(help="Processor time for data and training, as in 90s, 30m or 2h.")]
DataOption = Annotated[
    list[Path] | None, typer.Option("--data", help="Folder to learn from; may be repeated. Made anew by default.")
]
OutOption = Annotated[Path | None, typer.Option("--out", "-o", help="File of weights; beside --config by default.")]
LookOption = Annotated[str, typer.Option(help="What it looks like: nominal, varied, hard, or a file.")]
PersonOption = Annotated[str, typer.Option(help="Who assembles: a person's name or file.")]
TestSeedOption = Annotated[int, typer.Option(min=0, help="Of seeds in a row; tests begin at 900000.")]


class Hung(StrEnum):
    """Where the cameras are believed to hang."""

    calibrated = "calibrated"
    believed = "believed"


HungOption = Annotated[
    Hung,
    typer.Option(
        "--cameras", help="calibrated, as by `cell calibrate` in each look, or believed, as the bench file says."
    ),
]
WeightsOption = Annotated[Path | None, typer.Option(help="Weights; the configured ones by default.")]


def how_to_use(detector: str, kind: str, weights: Path, config: Path) -> None:
    """Say which line in the configuration takes new weights into use."""
    told = told_in(config, weights)
    console().print(f"in {config}, perception: {detector}: {{kind: {kind}, weights: {told}}}", highlight=False)
