"""`cell train noise`: what the action detector takes for what, from recorded runs."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from cell.commands.terminal import CONFIGURATION, ConfigOption, console, product_of
from cell.commands.weights import OverwriteOption, folder_for, require_new, told_in
from cell.errors import InputError


def train(
    data: Annotated[list[Path], typer.Option(help="segments.jsonl of `cell data --from LOG`; may be repeated.")],
    out: Annotated[Path | None, typer.Option(help="File to write; confusions.json beside --config by default.")] = None,
    overwrite: OverwriteOption = False,
    config: ConfigOption = CONFIGURATION,
) -> None:
    """Learn what the action detector takes for what, from actions that the holes confirmed."""
    from learned.semantic.confusions import Confusions, confirmed_reports
    from learned.semantic.graph import Layout

    path = out or confusions_for(config)
    require_new(path, overwrite=overwrite)
    layout = Layout.of(product_of(config))
    reports = [report for path in data for report in confirmed_reports(path)]
    try:
        learned = Confusions.learned(layout, reports)
    except ValueError as error:
        raise InputError(f"{data[0]}: segments of another product: {error}") from error
    learned.save(path, layout, len(reports), f"cell train noise {' '.join(f'--data {some}' for some in data)}")
    wrong = sum(true != reported for true, reported in reports)
    console().print(f"{len(reports)} confirmed actions, {wrong} of them detected wrongly; confusions in {path}")
    console().print(f"to use it, in {config}: planners.semantic.confusions: {told_in(config, path)}", highlight=False)


def confusions_for(config: Path) -> Path:
    """Where they go for a configuration, unless --out names a file."""
    return folder_for(config) / "confusions.json"
