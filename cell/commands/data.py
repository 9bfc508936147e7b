"""`cell data --from LOG`: training data from recorded runs."""

from __future__ import annotations

import shlex
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated

import typer
from typer.core import TyperGroup

from cell.commands.terminal import JsonOption, console, print_json, table
from cell.errors import InputError, LogError


def from_logs(
    context: typer.Context,
    logs: Annotated[
        list[Path] | None, typer.Option("--from", metavar="LOG", help="Log of a run; may be repeated.")
    ] = None,
    out: Annotated[Path | None, typer.Option("--out", "-o", help="New folder for what the logs give.")] = None,
    as_json: JsonOption = False,
) -> None:
    """Make training data: from recorded runs (--from LOG --out DIR), or drawn, by the commands below."""
    if context.invoked_subcommand is not None:
        if logs or out:
            raise InputError(f"--from and --out before `{context.invoked_subcommand}` have no meaning; see its --help")
        return
    if not logs or out is None:
        sets = ", ".join(context.command.list_commands(context)) if isinstance(context.command, TyperGroup) else ""
        raise InputError(f"name logs by --from LOG and a new folder by --out DIR, or a data set: {sets}")
    from cell.commands.log_terminal import read
    from cell.log.training.manifest import write_training_data

    command = shlex.join(["cell", "data", *(word for log in logs for word in ("--from", str(log))), "--out", str(out)])
    _require_each_once(logs)
    manifest = write_training_data((read([log]) for log in logs), out, command)
    console().print(table(str(out), manifest["counts"]))
    for log in manifest["logs"]:
        if log["no_demonstration_because"]:
            console().print(f"{log['name']}: no demonstration: {log['no_demonstration_because']}", highlight=False)
    if as_json:
        print_json(manifest)


def _require_each_once(logs: Sequence[Path]) -> None:
    """Check the names of logs before any is read, which takes long.

    Raises:
        LogError: one is not there, or is named twice.
    """
    from cell.log.read.reader import files_of

    named: set[Path] = set()
    for file in (file for log in logs for file in files_of(log)):
        if not file.is_file():
            raise LogError(file, "cannot be read: there is no such file")
        if file.resolve() in named:
            raise LogError(file, "is named twice")
        named.add(file.resolve())
