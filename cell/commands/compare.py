"""`cell compare`: two trees by many runs in pairs. It needs the packages of `cell[fleet]`."""

from __future__ import annotations

import os
import signal
from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from cell.commands.options import CONFIGURATION, ConfigOption, JsonOption, SchedulerOption
from cell.commands.terminal import console, print_json
from cell.errors import InputError

if TYPE_CHECKING:
    from cell.fleet.compare import Row
    from cell.fleet.spec import Task

FleetWorkersOption = Annotated[
    int, typer.Option("--workers", min=1, help="Processes on this machine; half its processors by default.")
]
WORKERS = max(1, (os.cpu_count() or 2) // 2)
WORSE = 1


def compare(
    trees: Annotated[list[Path], typer.Argument(metavar="A [B]", help="Tree files; one alone with --against.")],
    runs: Annotated[int, typer.Option(min=2, help="Pairs of runs.")] = 20,
    first_seed: Annotated[int, typer.Option(min=0, help="Seed of the first pair.")] = 0,
    person: Annotated[str | None, typer.Option(help="The simulated person, by name or YAML file.")] = None,
    goal: Annotated[str, typer.Option(help="Goal of the simulated person: a goal's name, or random.")] = "random",
    against: Annotated[
        Path | None, typer.Option(help="Table of runs (Parquet) to compare with; its seeds are run again.")
    ] = None,
    fail_if: Annotated[
        list[str] | None, typer.Option(help="Status 1 if B - A is beyond this bound, like 'right < -2%'.")
    ] = None,
    out: Annotated[Path, typer.Option("--out", "-o", help="Folder for runs.parquet and compare.html.")] = Path(
        "compare"
    ),
    pixels: Annotated[
        bool,
        typer.Option(
            "--pixels/--no-pixels",
            help="Render camera images; otherwise hands, holes and parts come from the simulator's truth.",
        ),
    ] = True,
    config: ConfigOption = CONFIGURATION,
    workers: FleetWorkersOption = WORKERS,
    scheduler: SchedulerOption = None,
    as_json: JsonOption = False,
) -> int:
    """Compare two trees by pairs of runs: which one is better, if the runs prove it."""
    from cell.fleet import compare as comparing
    from cell.fleet.compare_text import as_json as answer
    from cell.fleet.compare_text import lines, page
    from cell.fleet.spec import Seeds, Sweep, count, tasks
    from cell.log.report.html_page import write_page

    limits = [comparing.Limit.parse(text) for text in fail_if or ()]
    if len(trees) != (2 if against is None else 1):
        raise InputError("name two trees, or one tree and --against TABLE")
    before = _baseline(against, runs)
    seeds = Seeds(first=first_seed, count=runs) if not before else Seeds(first=min(before), count=len(before))
    asked = Sweep(
        seeds=seeds,
        trees=tuple(trees),
        configurations=(config,),
        people=(person,),
        goals=(goal,),
        pixels=pixels,
    )
    run_all(tasks(asked), count(asked), out, workers, scheduler)
    pairs = _pairs(out, trees, before)
    if not pairs:
        raise InputError(f"{against}: no run has the seed, person and goal of those that were asked for")
    found = comparing.findings(pairs)
    names = (against.name if against else trees[0].name, trees[-1].name)
    write_page(page(found, names, pairs), out / "compare.html")
    broken = [limit.text for limit in limits if limit.broken(found)]
    if as_json:
        print_json({**answer(found, names, len(pairs)), "broken": broken, "page": str(out / "compare.html")})
    else:
        for line in (*lines(found, names, len(pairs)), str(out / "compare.html")):
            typer.echo(line)
    for text in broken:
        console().print(f"beyond the bound: {text}", highlight=False)
    return WORSE if broken else 0


def _pairs(out: Path, trees: Sequence[Path], before: Mapping[int, dict[str, Any]]) -> list[tuple[Row, Row]]:
    """Rows of the same seed: of two trees, or of a baseline and one tree."""
    from cell.fleet.compare import pair
    from cell.fleet.table import read_table

    rows = read_table(out / "runs.parquet")
    by_tree = [[row for row in rows if row["tree"] == tree.name] for tree in trees]
    return pair(list(before.values()) or by_tree[0], by_tree[-1])


def _baseline(path: Path | None, runs: int) -> dict[int, dict[str, Any]]:
    """Rows of a table by seed, as many seeds in a row as were asked for and are there."""
    if path is None:
        return {}
    from cell.fleet.table import read_table

    rows = {int(row["seed"]): row for row in read_table(path) if "seed" in row}
    if not rows:
        raise InputError(f"{path}: holds no run")
    first = min(rows)
    return {seed: rows[seed] for seed in range(first, first + runs) if seed in rows}


def run_all(tasks: Iterable[Task], total: int, out: Path, workers: int, scheduler: str | None) -> int:
    """Run what is not in the folder yet, and write the table; how many runs of these tasks are there then.

    Rows are never all in memory: there may be a million.
    """
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, TimeRemainingColumn

    from cell.files.row_store import RowStore
    from cell.fleet.engine import cluster, results
    from cell.fleet.table import write_table

    signal.signal(signal.SIGTERM, signal.default_int_handler)  # as Ctrl-C: workers end, and nothing of them is left
    store = RowStore(out / "runs.jsonl", ["key"])
    wanted: dict[str, None] = {}  # in the order of the tasks
    columns = (BarColumn(), MofNCompleteColumn(), TimeRemainingColumn())
    with Progress(*columns, console=console()) as progress, cluster(workers, scheduler) as client:
        shown = progress.add_task("runs", total=total, completed=0)

        def missing() -> Iterator[Task]:
            for task in tasks:
                wanted[task.key] = None
                if task.key in store:
                    progress.advance(shown)
                else:
                    yield task

        for row in results(client, missing()):
            if row["end"] != "lost":  # runs that no worker finished are tried again next time
                store.add(row)
                progress.advance(shown)
    done = [key for key in wanted if key in store]
    write_table(store.rows_of(done), out / "runs.parquet")
    return len(done)
