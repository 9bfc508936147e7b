"""What the commands that train and score detectors share: their options, and data that are made first."""

from __future__ import annotations

import shlex
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated

import typer

from cell.commands.terminal import console
from cell.interfaces.errors import InputError

BudgetOption = Annotated[str, typer.Option(help="Processor time for data and training, as in 90s, 30m or 2h.")]
DataOption = Annotated[
    list[Path] | None, typer.Option("--data", help="Folder to learn from; may be repeated. Made anew by default.")
]
OutOption = Annotated[Path | None, typer.Option("--out", "-o", help="File of weights; beside --config by default.")]
LookOption = Annotated[str, typer.Option(help="What it looks like: nominal, varied, hard, or a file.")]
PersonOption = Annotated[str, typer.Option(help="Who assembles: a person's name or file.")]
TestSeedOption = Annotated[int, typer.Option(min=0, help="Of seeds in a row; tests begin at 900000.")]
WeightsOption = Annotated[Path | None, typer.Option(help="Weights; the shipped ones by default.")]


def made(
    what: str, folder: Path, look: str, recordings: int, first_seed: int, config: Path, options: Sequence[str] = ()
) -> Path:
    """A folder of `cell data`, made in a process of its own: torch and software OpenGL do not live in one.

    Args:
        what: which data, as in `cell data WHAT`.
        folder: one that is finished stays as it is.

    Raises:
        InputError: the data could not be made; what the command said is in the message.
    """
    if (folder / "manifest.json").exists():
        console().print(f"data: {folder}, made before")
        return folder
    words = ["data", what, "--look", look, "--recordings", str(recordings), "--first-seed", str(first_seed)]
    words += [*options, "--config", str(config), "--out", str(folder)]
    console().print(f"cell {shlex.join(words)}", highlight=False)
    done = subprocess.run([sys.executable, "-m", "cell", *words], stderr=subprocess.PIPE, text=True, check=False)
    if done.returncode:
        raise InputError(f"training data could not be made: {done.stderr.strip().splitlines()[-1]}")
    return folder


def how_to_use(detector: str, kind: str, weights: Path, config: Path) -> None:
    """Say which line in the configuration takes new weights into use."""
    console().print(f"in {config}, perception: {detector}: {{kind: {kind}, weights: {weights}}}", highlight=False)
