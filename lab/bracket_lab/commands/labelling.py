"""`cell record` and `cell label`: a user's own pictures, and what a person says is on them."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Annotated

import typer

from bracket_cell.commands.options import CONFIGURATION, OUT_HELP, ConfigOption
from bracket_cell.commands.terminal import console
from bracket_cell.configuration import load_configuration, load_product
from bracket_ground.errors import InputError
from bracket_lab.pictures import labels as folders
from bracket_lab.pictures.exports import LEGAL_EXPORTS, write_labels
from bracket_lab.pictures.foreign import LEGAL as LEGAL_LABELS
from bracket_lab.pictures.labels import ROWS, LabelFolder
from bracket_lab.pictures.sources import LEGAL, camera_pose, open_source

FROM_CAMERA = 60  # pictures
PORT = 8790


def record(
    source: Annotated[str, typer.Argument(help=f"Source: {LEGAL}.")],
    out: Annotated[Path, typer.Option("--out", "-o", help=OUT_HELP)],
    camera: Annotated[str, typer.Option(help="Which camera took it: overhead or wrist.")] = "overhead",
    every: Annotated[int, typer.Option(min=1, help="Keep every Nth frame.")] = 1,
    most: Annotated[int | None, typer.Option(min=1, help="Frames to keep; of a camera 60 by default.")] = None,
    config: ConfigOption = CONFIGURATION,
) -> None:
    """Keep frames of a camera, with its calibration, to label them: of a device, a video, pictures or a log."""
    if camera not in ROWS:
        raise InputError(f"--camera {camera}: unknown camera; legal: {', '.join(ROWS)}")
    configuration = load_configuration(config)
    product, bench = load_product(configuration, config), configuration.bench
    opened = open_source(source, camera, configuration, product, camera_pose(bench, camera))
    kept_n = most or (FROM_CAMERA if source.startswith("camera:") else None)
    kept = folders.record(opened, out, camera, bench, every, kept_n, f"cell record {source}")
    console().print(f"{kept} pictures in {out}; label them: cell label {out}", highlight=False)


def label(
    folder: Annotated[Path, typer.Argument(metavar="DIR", help="Folder of `cell record`.")],
    import_from: Annotated[Path | None, typer.Option("--import", help=f"Take labels: {LEGAL_LABELS}.")] = None,
    rename: Annotated[
        list[str] | None,
        typer.Option(help="With --import: THEIRS=OURS, another name of a category; THEIRS= leaves its boxes out."),
    ] = None,
    export_to: Annotated[str | None, typer.Option("--export", help=f"Write all labels: {LEGAL_EXPORTS}.")] = None,
    config: ConfigOption = CONFIGURATION,
) -> None:
    """Label pictures in a browser; detectors suggest, a person corrects.

    Labels go into the folder as rows that trainings read. With --import or --export, no page is served.
    """
    from bracket_lab.pictures.imports import read_labels
    from bracket_lab.pictures.server import LabelServer
    from bracket_lab.pictures.suggestions import Suggester

    configuration = load_configuration(config)
    product = load_product(configuration, config)
    if rename and import_from is None:
        raise InputError("--rename goes with --import")
    opened = LabelFolder(folder, product)
    suggester = Suggester(configuration.bench, product, configuration.perception)
    places = {row.file: suggester.holes_px(row) for row in opened.pictures} if opened.camera == "overhead" else {}
    if import_from is not None:
        for file, labels in read_labels(opened, import_from, places, _renamed(rename or ())).items():
            opened.save(file, labels)
    if export_to is not None:
        console().print(f"{write_labels(opened, export_to, places)} pictures in {export_to}", highlight=False)
    if import_from is not None:
        console().print(f"{len(opened.labels)} pictures of {folder} have labels", highlight=False)
    if import_from is None and export_to is None:
        server = LabelServer(opened, suggester, PORT)
        console().print(f"label at {server.address}; Ctrl-C ends it, what was saved stays", highlight=False)
        server.serve()
        console().print(f"{len(opened.labels)} of {len(opened.pictures)} pictures have labels", highlight=False)


def _renamed(pairs: Sequence[str]) -> dict[str, str]:
    """Names of this product by those of a file."""
    split = [pair.rpartition("=") for pair in pairs]
    if wrong := [pair for pair, (theirs, _, _) in zip(pairs, split, strict=True) if not theirs]:
        raise InputError(f"--rename {wrong[0]}: must be THEIRS=OURS, as in --rename Hammer=hammer")
    return {theirs: ours for theirs, _, ours in split}
