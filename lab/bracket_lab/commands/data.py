"""`cell lab data`: training data from the simulated world, or from recorded runs."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from bracket_cell.commands.log_export import write_training
from bracket_cell.commands.options import JsonOption
from bracket_ground.errors import InputError
from bracket_lab.commands.hands import compose
from bracket_lab.commands.stacks import draw_stacks
from bracket_lab.commands.training.worlds import data_app as app_of
from bracket_lab.evaluations.beside_robot import record_beside_robot

data_app = app_of(record_beside_robot)
data_app.command("stacks")(draw_stacks)
data_app.command("photographs")(compose)


@data_app.callback(invoke_without_command=True)
def from_logs(
    context: typer.Context,
    logs: Annotated[
        list[Path] | None, typer.Option("--from", metavar="LOG", help="Log of a run; may be repeated.")
    ] = None,
    out: Annotated[Path | None, typer.Option("--out", "-o", help="New folder for the data.")] = None,
    as_json: JsonOption = False,
) -> None:
    """Make training data: from logs with --from LOG --out DIR, or from simulation with the commands below."""
    if context.invoked_subcommand is not None:
        if logs or out:
            raise InputError(f"--from and --out before `{context.invoked_subcommand}` have no meaning; see its --help")
        return
    if not logs or out is None:
        sets = ", ".join(getattr(context.command, "commands", {}))
        raise InputError(f"name logs with --from LOG and a new folder with --out DIR, or a data set: {sets}")
    write_training(logs, out, as_json)
