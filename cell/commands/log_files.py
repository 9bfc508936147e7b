"""`cell log files`: what a run was made with, out of its log: configuration, product, tree, look."""

from __future__ import annotations

from pathlib import Path, PurePosixPath
from typing import Annotated

import typer

from cell.commands.log_terminal import JsonOption, LogArgument, say, streamed, tell_json
from cell.errors import LogError
from cell.files.files import write_new


def files(
    log: LogArgument,
    out: Annotated[Path, typer.Option("--out", "-o", help="A folder in which none of them is.")] = Path("files"),
    as_json: JsonOption = False,
) -> None:
    """Write the files that a run was made with: configuration, product, tree, and how the simulation looked."""
    stream = streamed(log)
    next(iter(stream), None)
    for name in stream.attachments:
        check_name(stream.path, name)
    write_new(out, stream.attachments)
    written = [str(out / name) for name in stream.attachments]
    if as_json:
        tell_json({"files": written})
    else:
        say(*written)


def check_name(log: Path, name: str) -> None:
    """Raises LogError where a file of this name would lie outside the folder that is written to."""
    path = PurePosixPath(name)
    if path.is_absolute() or not path.name or {"..", "\\"} & {*path.parts, *name}:
        raise LogError(log, f"its file {name!r} would lie outside the folder")
