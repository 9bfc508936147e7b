"""`cell lab files|snapshots`: the files and snapshots that a log holds."""

from __future__ import annotations

import re
from pathlib import Path, PurePosixPath
from typing import Annotated

import typer

from bracket_cell.commands.log_terminal import LogArgument, read, say, streamed, tell_json
from bracket_cell.commands.options import JsonOption
from bracket_cell.commands.terminal import complain
from bracket_cell.log.read.frames import Frames
from bracket_cell.log.read.reader import Log
from bracket_ground.errors import LogError
from bracket_ground.files.files import write_new


def files(
    log: LogArgument,
    out: Annotated[
        Path, typer.Option("--out", "-o", help="Folder to write them to; it must hold none of them.")
    ] = Path("files"),
    as_json: JsonOption = False,
) -> None:
    """Write the files that a run was made with: configuration, product, tree, and how the simulation looked."""
    stream = streamed(log)
    next(iter(stream), None)
    for name in stream.attachments:
        check_name(stream.path, name)
    write_new(out, stream.attachments)
    written = [str(out / name) for name in stream.attachments]
    tell_json({"files": written}) if as_json else say(*written)


def check_name(log: Path, name: str) -> None:
    """Raises LogError where a file of this name would lie outside the folder that is written to."""
    path = PurePosixPath(name)
    if path.is_absolute() or not path.name or not name.isprintable() or {"..", "\\"} & {*path.parts, *name}:
        raise LogError(log, f"its file {name!r} would lie outside the folder, or in no file")


def snapshots(
    log: LogArgument,
    out: Annotated[Path, typer.Option("--out", "-o", help="Folder for the pictures.")] = Path("snapshots"),
    as_json: JsonOption = False,
) -> None:
    """Write the pictures that a tree took with TakeSnapshot, as JPEG files."""
    files = save_snapshots(read(log), out)
    if as_json:
        tell_json({"files": [str(file) for file in files]})
    elif not files:
        complain("nothing of that is in the log")
    else:
        say(*(str(file) for file in files))


def save_snapshots(log: Log, folder: Path) -> list[Path]:
    """Write each marked picture as NUMBER-CAMERA-LABEL.jpg, numbered as they were taken.

    Raises:
        InputError: one of these files is there already, or cannot be written; none is left there then.
    """
    frames, pictures = Frames(log), {}
    marks = [fields for tick in log.ticks for kind, fields in tick.notes if kind == "snapshot"]
    for number, mark in enumerate(marks, 1):
        frame = frames.at(mark["camera"], mark["taken_s"]) if "taken_s" in mark else None
        if frame is None:
            continue  # the log is older, was kept without pictures, or lost them
        words = (re.sub(r"\W+", "-", mark[name]).strip("-") for name in ("camera", "label"))
        pictures[f"{'-'.join(filter(None, (f'{number:02d}', *words)))}.jpg"] = frame.jpeg
    write_new(folder, pictures)
    return [folder / name for name in pictures]
