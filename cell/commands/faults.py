"""`cell eval faults`: every fault in every state of a pick and place, or some in whole assemblies."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Mapping
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from cell.commands.terminal import (
    CONFIGURATION,
    ConfigOption,
    JsonOption,
    RowsOption,
    SchedulerOption,
    WorkersOption,
    console,
    print_json,
)
from cell.files.row_store import Row, RowStore

if TYPE_CHECKING:
    from cell.lab.faults import Pairs


def faults(
    fault: Annotated[list[str] | None, typer.Option(help="Only these faults; all by default.")] = None,
    state: Annotated[list[str] | None, typer.Option(help="Only these states; all by default.")] = None,
    tries: Annotated[
        int, typer.Option(min=1, help="Runs of each pair, with other seeds; of one run where nothing moves.")
    ] = 1,
    pixels: Annotated[
        bool, typer.Option("--pixels", help="Render every image, and run every pair from its beginning: slower.")
    ] = False,
    out: RowsOption = None,
    assemblies: Annotated[
        int, typer.Option(min=0, help="Instead: so many whole assemblies beside a person, with random faults.")
    ] = 0,
    each: Annotated[int, typer.Option("--faults", min=1, max=9, help="Faults in each of these assemblies.")] = 3,
    workers: WorkersOption = 1,
    scheduler: SchedulerOption = None,
    config: ConfigOption = CONFIGURATION,
    first_seed: Annotated[int, typer.Option(help="Seed of the first run.")] = 1,
    as_json: JsonOption = False,
) -> int:
    """Put every fault into every state of a pick and place, and say how it ended; status 1 where not as promised."""
    from cell.lab.faults import chosen, left, merged, totals

    if assemblies:
        seeds = range(first_seed, first_seed + assemblies)
        return _assemblies(Path(config), seeds, each, pixels, out, as_json, workers, scheduler)
    screen, pairs = console(), chosen(fault, state)
    kept = RowStore(out, ["fault", "state", "seed"], {"command": "faults", "pixels": pixels, "config": str(config)})

    def tell(row: Row) -> None:
        kept.add(row)
        words = "as promised" if row["as_promised"] else "NOT AS PROMISED"
        screen.print(
            f"{row['fault']:<20} {row['state']:<16} {row['end']:<12} {words:<16} ticks {row['ticks_to_stop']}  "
            f"{row['stop_s']} s  {row['stop_m']} m  {row['reason']}",
            highlight=False,
        )

    missing = {seed: left(pairs, kept.rows, seed, first_seed) for seed in range(first_seed, first_seed + tries)}
    _try(Path(config), missing, tell, pixels, workers, scheduler)
    asked = {(name, at) for at, names in pairs.items() for name in (*names, "none")} | {("none", "none")}
    rows = [row for row in kept.rows if (row["fault"], row["state"]) in asked]
    table = merged(rows)
    good = all(bool(row["as_promised"]) for row in table)
    screen.print(f"{sum(bool(row['as_promised']) for row in table)} of {len(table)} pairs ended as promised")
    screen.print(totals(rows))
    if as_json:
        print_json({"rows": table, "as_promised": good, **totals(rows)})
    return 0 if good else 1


def _try(
    path: Path,
    pairs: Mapping[int, Pairs],
    tell: Callable[[Row], None],
    pixels: bool,
    workers: int,
    scheduler: str | None,
) -> None:
    """Tell how each fault ended in each state, by seed; with pixels each is a run of its own, else one run splits."""
    from cell.fleet.engine import mapped
    from cell.lab.faults import fast_list, fast_rows, fault_try

    if pixels:
        runs = [(path, fault, state, seed) for seed in pairs for state, names in pairs[seed].items() for fault in names]
        rows = mapped(fault_try, runs, workers, scheduler)
    else:
        splits = [(path, pairs[seed], seed) for seed in pairs if pairs[seed]]
        if workers == 1 and scheduler is None:  # rows come as they are known
            for split in splits:
                fast_rows(*split, tell)
            return
        rows = itertools.chain.from_iterable(mapped(fast_list, splits, workers, scheduler))
    for row in rows:
        tell(row)


def _assemblies(
    path: Path,
    seeds: range,
    faults: int,
    pixels: bool,
    out: Path | None,
    as_json: bool,
    workers: int,
    scheduler: str | None,
) -> int:
    from cell.fleet.engine import mapped
    from cell.lab.random_faults import counted, troubled_assembly

    screen = console()
    kept = RowStore(out, ["seed"], {"command": "faults", "faults": faults, "pixels": pixels, "config": str(path)})
    wanted = ((path, seed, faults) for seed in seeds if seed not in kept)
    for row in mapped(partial(troubled_assembly, rendered=pixels), wanted, workers, scheduler):
        kept.add(row)
        words = "WRONG, AND NOT KNOWN" if row["unknown"] else "as promised" if row["as_promised"] else "NOT AS PROMISED"
        screen.print(f"seed {row['seed']}: {row['end']}, {words}; {row['faults']}; {row['reason']}", highlight=False)
    rows = [row for row in kept.rows if row["seed"] in seeds]
    found = counted(rows)
    screen.print(found)
    if as_json:
        print_json({"rows": rows, **found})
    return 0 if found["as_promised"] == len(rows) else 1
