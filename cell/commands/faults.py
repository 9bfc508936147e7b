"""`cell eval faults`, every fault in every state, and `cell eval encounters`, a person who gets into the arm's way."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from functools import partial
from pathlib import Path
from typing import Annotated

import typer
from rich.console import Console

from cell.commands.terminal import (
    CONFIGURATION,
    ConfigOption,
    JsonOption,
    SchedulerOption,
    WorkersOption,
    console,
    print_json,
)
from cell.configuration import DEFAULT_TREE
from cell.evaluating.row_file import Row, RowFile

GIVEN_UP = 5  # seeds without an encounter, after which no more are tried
OutOption = Annotated[
    Path | None, typer.Option(help="Keep the rows in this file; what is in it already is not run again.")
]


def faults(
    fault: Annotated[list[str] | None, typer.Option(help="Only these faults; all by default.")] = None,
    state: Annotated[list[str] | None, typer.Option(help="Only these states; all by default.")] = None,
    tries: Annotated[
        int, typer.Option(min=1, help="Runs of each pair, with other seeds; of one run where nothing moves.")
    ] = 1,
    pixels: Annotated[
        bool, typer.Option("--pixels", help="Render every image, and run every pair from its beginning: slower.")
    ] = False,
    out: OutOption = None,
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
    from cell.evaluating.faults import chosen, fast_list, fast_rows, fault_try, left, merged, totals
    from cell.fleet.engine import mapped

    if assemblies:
        seeds = range(first_seed, first_seed + assemblies)
        return _assemblies(Path(config), seeds, each, pixels, out, as_json, workers, scheduler)
    screen, pairs = console(), chosen(fault, state)
    kept = RowFile(out, {"command": "faults", "pixels": pixels, "config": str(config)})

    def tell(row: Row) -> None:
        kept.add(row)
        words = "as promised" if row["as_promised"] else "NOT AS PROMISED"
        screen.print(
            f"{row['fault']:<20} {row['state']:<16} {row['end']:<12} {words:<16} ticks {row['ticks_to_stop']}  "
            f"{row['stop_s']} s  {row['stop_m']} m  {row['reason']}",
            highlight=False,
        )

    todo = {seed: left(pairs, kept.rows, seed, first_seed) for seed in range(first_seed, first_seed + tries)}
    path, alone = Path(config), workers == 1 and scheduler is None
    if pixels:
        wanted = [(path, name, at, seed) for seed in todo for at, names in todo[seed].items() for name in names]
        for row in mapped(fault_try, wanted, workers, scheduler):
            tell(row)
    elif alone:  # rows come as they are known
        for seed in filter(todo.get, todo):
            fast_rows(path, todo[seed], seed, tell)
    else:
        splits = [(path, todo[seed], seed) for seed in filter(todo.get, todo)]
        for row in itertools.chain.from_iterable(mapped(fast_list, splits, workers, scheduler)):
            tell(row)
    asked = {(name, at) for at, names in pairs.items() for name in (*names, "none")} | {("none", "none")}
    rows = [row for row in kept.rows if (row["fault"], row["state"]) in asked]
    table = merged(rows)
    good = all(bool(row["as_promised"]) for row in table)
    screen.print(f"{sum(bool(row['as_promised']) for row in table)} of {len(table)} pairs ended as promised")
    screen.print(totals(rows))
    if as_json:
        print_json({"rows": table, "as_promised": good, **totals(rows)})
    return 0 if good else 1


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
    from cell.evaluating.troubled import counted, troubled_assembly
    from cell.fleet.engine import mapped

    screen = console()
    kept = RowFile(out, {"command": "faults", "faults": faults, "pixels": pixels, "config": str(path)})
    done = {row["seed"] for row in kept.rows}
    wanted = ((path, seed, faults) for seed in seeds if seed not in done)
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


def encounters(
    encounters: Annotated[int, typer.Option(min=1, help="How many times a hand goes into the arm's way.")] = 20,
    person: Annotated[str, typer.Option(help="Kind of person, as for `cell run --person`.")] = "careless",
    first_seed: Annotated[int, typer.Option(help="Seed of the first assembly.")] = 0,
    provoked: Annotated[
        bool,
        typer.Option(
            "--provoked/--by-habit", help="The hand goes into the arm's way in every phase; or as seldom as it does."
        ),
    ] = True,
    throughput_seeds: Annotated[
        int, typer.Option(min=0, help="Brackets beside a careful person with and without separation, for both trees.")
    ] = 3,
    tree: Annotated[Path, typer.Option(help="Tree file to run.")] = DEFAULT_TREE,
    pixels: Annotated[bool, typer.Option("--pixels", help="Render every image: twice the time.")] = False,
    out: OutOption = None,
    workers: WorkersOption = 1,
    scheduler: SchedulerOption = None,
    config: ConfigOption = CONFIGURATION,
    as_json: JsonOption = False,
) -> int:
    """Assemble beside a person who gets in the way, and count contacts; status 1 where one was fast or avoidable."""
    from cell.evaluating.assembly import ALGORITHM_1
    from cell.evaluating.encounters import encounter, summary
    from cell.evaluating.throughput import throughput_ratio, timed_pair
    from cell.fleet.engine import mapped

    screen, path = console(), Path(config)
    experiment = {"person": person, "provoked": provoked, "tree": str(tree), "pixels": pixels, "config": str(config)}
    kept = RowFile(out, {"command": "encounters", **experiment})
    done = {(row["kind"], row.get("tree"), row["seed"]) for row in kept.rows}
    seeds = (seed for seed in itertools.count(first_seed) if ("assembly", None, seed) not in done)
    if not _enough(kept.rows, encounters, first_seed):
        work = partial(encounter, path, tree, person, provoked=provoked, rendered=pixels)
        for row in mapped(work, ((seed,) for seed in seeds), workers, scheduler):
            if row["end"] == "interrupted":  # somebody wants it to end; the seed is run again another time
                return 1
            kept.add(row)
            _tell_assembly(screen, kept.rows[-1])
            if _enough(kept.rows, encounters, first_seed):
                break
    trees = (ALGORITHM_1, DEFAULT_TREE)
    pairs = [(path, one, number) for number in range(throughput_seeds) for one in trees]
    left = [pair for pair in pairs if ("throughput", pair[1].name, pair[2]) not in done]
    for row in mapped(timed_pair, left, workers, scheduler) if left else ():
        kept.add(row)
    found = summary(kept.rows)
    ratios = {"throughput_ratio" + "_ahead" * (one == DEFAULT_TREE): throughput_ratio(kept.rows, one) for one in trees}
    told = {**experiment, **found, **ratios}
    screen.print(told)
    if as_json:
        print_json({**told, "rows": kept.rows})
    return 1 if found["contacts_fast"] or found["contacts_avoidable"] or found["moved_while_unknown"] else 0


def _enough(rows: Sequence[Row], encounters: int, first_seed: int) -> bool:
    """Whether so many were met; a person who never gets in the way is given up after a few seeds."""
    met, last = _met(rows), max((int(str(row["seed"])) for row in rows if row["kind"] == "assembly"), default=-1)
    return met >= encounters or (not met and last >= first_seed + GIVEN_UP - 1)


def _met(rows: Sequence[Row]) -> int:
    return sum(int(str(row["encounters"])) for row in rows if row["kind"] == "assembly")


def _tell_assembly(screen: Console, row: Row) -> None:
    contacts: Sequence[Row] = row["contacts"]  # type: ignore[assignment]
    words = f"{row['encounters']} encounters, {len(contacts)} contacts"
    why = "" if row["end"] == "finished" else f" ({row['reason']})"
    screen.print(f"seed {row['seed']}: {row['end']} after {row['sim_time_s']} s{why}, {words}", highlight=False)
    for one in contacts:
        bad = " FAST" * bool(one["fast"]) + " AVOIDABLE" * bool(one["avoidable"])
        screen.print(
            f"  {one['start_s']:.2f} s {one['phase']}: {one['robot']} and {one['human']}, "
            f"first {one['first_m_s']:.2f}, at most {one['speed_m_s']:.2f} m/s{bad}; {one['known']}",
            highlight=False,
        )
