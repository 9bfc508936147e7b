"""`cell lab looks`: what the simulated cell may look like, as a picture."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from cell.commands.options import CONFIGURATION, ConfigOption
from cell.commands.terminal import console
from cell.errors import InputError


def looks(
    names: Annotated[
        list[str] | None, typer.Argument(help="Presets, PRESET:SECTION or look files; all presets by default.")
    ] = None,
    png: Annotated[Path | None, typer.Option(help="Draw what the cameras see into this PNG file.")] = None,
    seeds: Annotated[int, typer.Option(min=1, max=100, help="Seeds of each look to draw.")] = 3,
    config: ConfigOption = CONFIGURATION,
) -> None:
    """List or draw what the simulation may look like."""
    from cell.configuration import load_configuration, load_product
    from sim.scene.look_range import look_range, presets

    chosen = [look_range(name) for name in names or presets()]
    if png is None:
        for look in chosen:
            console().print(look.name, highlight=False)
        return
    if png.is_dir() or not png.parent.is_dir():
        raise InputError(f"{png}: cannot be written: it must be a file in a folder that exists")
    from sim.data.look_sheet import look_sheet, write_png

    configuration = load_configuration(config)
    product = load_product(configuration, config)
    wanted = [(look, seed) for look in chosen for seed in range(seeds)]
    write_png(png, look_sheet(product, configuration.bench, configuration.devices.simulation, wanted))
