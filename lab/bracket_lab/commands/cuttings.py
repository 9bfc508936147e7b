"""`cell lab data sheets`: pictures with boxes to learn parts from, out of photographs of single parts."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from typer import Argument, Option

from bracket_cell.commands.options import CONFIGURATION, ConfigOption, JsonOption, SeedOption
from bracket_cell.commands.terminal import console, print_json, table
from bracket_cell.configuration import load_configuration, load_product
from bracket_cell.learned.records import read_image
from bracket_ground.files.data_folder import DataFolder
from bracket_ground.files.files import whole_folder
from bracket_lab.pictures.cuttings import Paster, cuttings_of
from bracket_lab.pictures.origins import photographs_of


def paste(
    sheets: Annotated[Path, Argument(help="Folder with a folder for each type, of photographs of one part each.")],
    out: Annotated[Path, Option("--out", "-o", help="New folder.")],
    onto: Annotated[
        list[Path] | None, Option(help="Photographs of the empty tray; may be repeated. Plain ground by default.")
    ] = None,
    count: Annotated[int, Option(min=5, help="Images.")] = 400,
    config: ConfigOption = CONFIGURATION,
    seed: SeedOption = 0,
    as_json: JsonOption = False,
) -> None:
    """Parts of photographs on a plain sheet, cut out and pasted onto trays: boxes that nobody has to draw.

    Twenty photographs of each type are a good beginning: from all sides, in the light of the bench.
    """
    configuration = load_configuration(config)
    product, bench = load_product(configuration, config), configuration.bench
    cuttings, left_out = cuttings_of(sheets, product)
    behind = [read_image(tray.file) for folder in onto or () for tray in photographs_of(folder)]
    with whole_folder(out) as partial:
        folder = DataFolder(partial, f"cell lab data sheets {sheets}")
        Paster(cuttings, product, bench).write(folder, behind, count, seed)
        folder.close({f"photographs of {part}": len(some) for part, some in cuttings.items()})
    fields: dict[str, object] = {f"photographs of {part}": len(some) for part, some in cuttings.items()}
    fields |= {"images": count, "left out": left_out}
    if as_json:
        print_json(fields)
        return
    for why in left_out:
        console().print(f"left out: {why}", highlight=False)
    console().print(table(str(out), {**fields, "left out": len(left_out)}))
    console().print(f"next: cell train parts --data {out}", highlight=False)
