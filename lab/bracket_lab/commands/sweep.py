"""`cell lab sweep`: every combination of a file run once. It needs the packages of `cell[fleet]`."""

from __future__ import annotations

from collections import Counter
from pathlib import Path
from typing import Annotated

import typer

from bracket_cell.commands.compare import WORKERS, FleetWorkersOption, OutOption, run_all
from bracket_cell.commands.options import JsonOption, SchedulerOption, WithOption, user_files
from bracket_cell.commands.terminal import console, print_json
from bracket_cell.fleet.spec import count, load_sweep, tasks
from bracket_ground.errors import InputError


def sweep(
    spec: Annotated[Path, typer.Argument(help="YAML file: seeds, trees, configurations, people, looks, faults.")],
    out: OutOption = "sweep",
    own: WithOption = None,
    workers: FleetWorkersOption = WORKERS,
    scheduler: SchedulerOption = None,
    logs: Annotated[bool, typer.Option("--logs", help="Keep the log of every run, with images, in OUT/logs.")] = False,
    keep: Annotated[
        int, typer.Option("--keep", metavar="N", min=1, help="Of the runs that went right, keep one log in N.")
    ] = 1,
    as_json: JsonOption = False,
) -> int:
    """Run the cell once for every combination that a YAML file lists; status 1 if a run was lost.

    The results are OUT/runs.parquet.
    """
    asked = load_sweep(spec)
    nodes, _ = user_files(own)
    if keep > 1 and not logs:
        raise InputError("--keep says which logs --logs keeps; without it none are kept")
    runs = tasks(asked, f"{out}/logs" if logs else None, nodes, keep, spec)
    with run_all(runs, count(asked), out, workers, scheduler) as rows:
        ends = dict(sorted(Counter(str(row["end"]) for row in rows.read(["end"])).items()))
    table = f"{out}/runs.parquet"
    words = ", ".join(f"{count} {end}" for end, count in ends.items()) or "none"
    console().print(f"{rows.done} runs in {table}: {words}", highlight=False)
    if as_json:
        print_json({"runs": rows.done, "of": rows.done + rows.missing, "ends": ends, "table": table})
    return 1 if ends.get("crashed") or rows.missing else 0
