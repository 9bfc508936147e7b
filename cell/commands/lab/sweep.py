"""`cell lab sweep`: every combination of a file run once. It needs the packages of `cell[fleet]`."""

from __future__ import annotations

from collections import Counter
from pathlib import Path
from typing import Annotated

import typer

from cell.commands.compare import WORKERS, FleetWorkersOption, run_all
from cell.commands.options import JsonOption, SchedulerOption
from cell.commands.terminal import console, print_json
from cell.fleet.spec import count, load_sweep, tasks
from cell.fleet.table import read_table


def sweep(
    spec: Annotated[Path, typer.Argument(help="YAML file: seeds, trees, configurations, people, looks, faults.")],
    out: Annotated[Path, typer.Option("--out", "-o", help="Folder; a sweep there continues.")] = Path("sweep"),
    workers: FleetWorkersOption = WORKERS,
    scheduler: SchedulerOption = None,
    logs: Annotated[bool, typer.Option("--logs", help="Keep the log of every run, with images, in OUT/logs.")] = False,
    as_json: JsonOption = False,
) -> int:
    """Run the cell once for every combination that a YAML file lists; status 1 if a run was lost.

    The results are OUT/runs.parquet.
    """
    asked = load_sweep(spec)
    total = count(asked)
    done = run_all(tasks(asked, out / "logs" if logs else None), total, out, workers, scheduler)
    ends = dict(sorted(Counter(row["end"] for row in read_table(out / "runs.parquet", ["end"])).items()))
    console().print(f"{done} runs in {out / 'runs.parquet'}: {_words(ends)}", highlight=False)
    if as_json:
        print_json({"runs": done, "of": total, "ends": ends, "table": str(out / "runs.parquet")})
    return 1 if ends.get("crashed") or done < total else 0


def _words(ends: dict[str, int]) -> str:
    return ", ".join(f"{count} {end}" for end, count in ends.items()) or "none"
