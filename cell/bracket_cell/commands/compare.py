"""`cell compare`: two trees by many runs in pairs. It needs the packages of `cell[fleet]`."""

from __future__ import annotations

import os
import signal
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from bracket_cell.commands.options import (
    CONFIGURATION,
    OUT_HELP,
    ConfigOption,
    JsonOption,
    SchedulerOption,
    WithOption,
    user_files,
)
from bracket_cell.commands.terminal import console, print_json
from bracket_cell.runs.options import GOAL_HELP, PERSON_HELP
from bracket_ground.errors import InputError, counted

if TYPE_CHECKING:
    from bracket_cell.fleet.compare import Finding, Row
    from bracket_cell.fleet.spec import Sweep
    from bracket_cell.fleet.task import Task

FleetWorkersOption = Annotated[
    int, typer.Option("--workers", min=1, help="Processes on this machine; half its processors by default.")
]
WORKERS = max(1, (os.cpu_count() or 2) // 2)
WORSE = 1
EVERYONE = ("careful", "careful_brisk", "ordinary", "ordinary_brisk")
NOT_DONE = ("lost", "refused")
OF_A_SWEEP = ("runs.jsonl", "runs.parquet", "compare.html")
OutOption = Annotated[str, typer.Option("--out", "-o", metavar="FOLDER", help=OUT_HELP)]


def compare(
    trees: Annotated[list[Path], typer.Argument(metavar="A [B]", help="Tree files; one alone with --against.")],
    runs: Annotated[int, typer.Option(min=2, help="Pairs of runs beside each person.")] = 20,
    first_seed: Annotated[int, typer.Option(min=0, help="Seed of the first pair.")] = 0,
    person: Annotated[list[str] | None, typer.Option(help=PERSON_HELP)] = None,
    goal: Annotated[str, typer.Option(help=GOAL_HELP)] = "random",
    against: Annotated[
        Path | None, typer.Option(help="Table of runs (Parquet) to compare with; its seeds are run again.")
    ] = None,
    fail_if: Annotated[
        list[str] | None, typer.Option(help="Status 1 if B - A is beyond this bound, like 'right < -2%'.")
    ] = None,
    out: OutOption = "compare",
    own: WithOption = None,
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
    """Compare two trees by pairs of runs: which one is better, if the runs prove it.

    Beside careful and ordinary people by default, each once waiting until the arm is parked and once only until it
    leaves; --person may be repeated. --out may be an address (s3://BUCKET/x); runs that are there stay.
    """
    from bracket_cell.fleet import compare as comparing
    from bracket_cell.fleet.compare_text import page
    from bracket_cell.fleet.spec import Seeds, Sweep, count, tasks
    from bracket_cell.log.report.html_page import write_page

    limits = [comparing.Limit.parse(text) for text in fail_if or ()]
    if len(trees) != (2 if against is None else 1):
        raise InputError("name two trees, or one tree and --against TABLE")
    before = _baseline(against, runs)
    known = {int(row["seed"]) for row in before}
    seeds = Seeds(first=first_seed, count=runs) if not known else Seeds(first=min(known), count=len(known))
    asked = Sweep(
        seeds=seeds,
        trees=tuple(trees),
        configurations=(config,),
        people=tuple(person or EVERYONE),
        goals=(goal,),
        pixels=pixels,
    )
    nodes, _ = user_files(own)
    labels = [against.name] if against else []
    first, *_, last = (*labels, *(_label(tree, trees) for tree in trees))
    with run_all(tasks(asked, None, nodes), count(asked), out, workers, scheduler) as rows:
        pairs = _pairs(asked, nodes, rows.read(), before, against)
        found = comparing.findings(pairs)
        write_page(page(found, (first, last), pairs), rows.folder / "compare.html")
    broken = [limit.text for limit in limits if limit.broken(found)]
    _tell(found, (first, last), pairs, broken, f"{out}/compare.html", as_json)
    return WORSE if broken else 0


def _pairs(
    asked: Sweep, nodes: Sequence[str], done: Sequence[Row], before: Sequence[Row], against: Path | None
) -> Sequence[tuple[Row, Row]]:
    """Runs of both trees that have the same seed, person and goal; raises InputError where there are none."""
    from bracket_cell.fleet.compare import pair
    from bracket_cell.fleet.spec import tasks

    sides = [asked.model_copy(update={"trees": (tree,)}) for tree in asked.trees]  # they may have one name and content
    by_tree = [{task.key for task in tasks(side, None, nodes)} for side in sides]
    found_by_tree = [[row for row in done if row["key"] in keys] for keys in by_tree]
    if pairs := pair(before or found_by_tree[0], found_by_tree[-1]):
        return pairs
    what = f"{against}: no run has" if against else "no run has"
    raise InputError(f"{what} the seed, person and goal of those that were asked for")


def _tell(
    found: Sequence[Finding],
    names: tuple[str, str],
    pairs: Sequence[tuple[Row, Row]],
    broken: list[str],
    page: str,
    as_json: bool,
) -> None:
    from bracket_cell.fleet.compare_text import as_json as answer
    from bracket_cell.fleet.compare_text import by_person, lines, persons_as_json

    if as_json:
        fields = answer(found, names, len(pairs))
        print_json({**fields, "by_person": persons_as_json(pairs), "broken": broken, "page": page})
    else:
        for line in (*lines(found, names, len(pairs)), *by_person(pairs), page):
            typer.echo(line)
    for text in broken:
        console().print(f"beyond the bound: {text}", highlight=False)


def _label(tree: Path, trees: Sequence[Path]) -> str:
    from bracket_cell.fleet.spec import apart

    return apart(trees)[tree]


def _baseline(path: Path | None, runs: int) -> list[dict[str, Any]]:
    """Rows of a table, of as many seeds in a row as were asked for and are there."""
    if path is None:
        return []
    from bracket_cell.fleet.table import read_table

    rows = [row for row in read_table(path) if "seed" in row]
    if not rows:
        raise InputError(f"{path}: holds no run")
    first = min(int(row["seed"]) for row in rows)
    return [row for row in rows if int(row["seed"]) < first + runs]


@dataclass(frozen=True)
class Rows:
    """The table of runs that are done.

    Attributes:
        folder: where it stands, and where pages about it are written to.
        done, missing: how many runs; two that are the same in everything are one.
    """

    folder: Path
    done: int
    missing: int

    def read(self, columns: list[str] | None = None) -> list[dict[str, Any]]:
        """All rows."""
        from bracket_cell.fleet.table import read_table

        return read_table(self.folder / "runs.parquet", columns)


@contextmanager
def run_all(tasks: Iterable[Task], total: int, out: str, workers: int, scheduler: str | None) -> Iterator[Rows]:
    """Run what is not in the folder yet, and write the table.

    Rows are never all in memory: there may be a million.
    """
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, TimeRemainingColumn

    from bracket_cell.fleet.engine import cluster, results
    from bracket_cell.fleet.store import results_folder
    from bracket_cell.fleet.table import write_table
    from bracket_ground.files.row_store import RowStore

    signal.signal(signal.SIGTERM, signal.default_int_handler)  # as Ctrl-C: workers end, and nothing of them is left
    wanted: dict[str, None] = {}  # in the order of the tasks
    lost: list[str] = []
    columns = (BarColumn(), MofNCompleteColumn(), TimeRemainingColumn())
    with results_folder(out, OF_A_SWEEP) as (folder, more):
        store = RowStore(folder / "runs.jsonl", ["key"])
        with Progress(*columns, console=console()) as progress, cluster(workers, scheduler) as client:
            shown = progress.add_task("runs", total=total, completed=0)

            def missing() -> Iterator[Task]:
                for task in tasks:
                    wanted[task.key] = None
                    if task.key in store:
                        progress.advance(shown)
                    else:
                        yield task

            try:
                for row in results(client, missing()):
                    if row["end"] in NOT_DONE:  # runs that no worker finished are tried again next time
                        lost.append(f"seed {row['seed']} with {row['tree']}: {row['end']}: {row['reason']}")
                        continue
                    store.add(row)
                    more()
                    progress.advance(shown)
            finally:  # what is done is in the table, however it ends
                done = [key for key in wanted if key in store]
                write_table(store.rows_of(done), folder / "runs.parquet")
        if others := len(store.keys) - len(done):
            told = f"{counted(others, 'row')} of {out}/runs.jsonl not in the table: other files, settings or versions"
            console().print(told, highlight=False)
        for why in lost[:1]:
            console().print(f"{counted(len(lost), 'run')} lost; the first: {why}", highlight=False)
        yield Rows(folder, len(done), len(wanted) - len(done))
