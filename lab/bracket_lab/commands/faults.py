"""`cell lab eval faults`: every fault in every state of a pick and place, or some in whole assemblies."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Mapping
from functools import partial
from pathlib import Path
from typing import Annotated

from typer import Option

from bracket_cell.commands.options import command_from
from bracket_cell.commands.terminal import console, print_json
from bracket_cell.configuration import load_configuration
from bracket_cell.fleet.engine import mapped
from bracket_ground.files.row_store import Row, RowStore
from bracket_lab.commands.shared import Shared
from bracket_lab.evaluations.drawn_faults import coverage, drawn_list, drawn_rows, missing, words_of
from bracket_lab.evaluations.faults import Pairs, chosen, fast_list, fast_rows, fault_try, left, merged, totals
from bracket_lab.evaluations.random_faults import counted, troubled_assembly
from bracket_sim.faults.named_faults import FAULTS

OF_ASSEMBLY = 3  # faults
INTERRUPTED = "interrupted"


@command_from(Shared, "seeds", "pixels", "out", "workers", "scheduler", "config", "as_json", seeds="1")
def faults(
    shared: Shared,
    fault: Annotated[list[str] | None, Option(help="Only these faults; all by default.")] = None,
    state: Annotated[list[str] | None, Option(help="Only these states; all by default.")] = None,
    assemblies: Annotated[
        bool,
        Option("--assemblies", help="Instead: whole assemblies, one for each seed, with --drawn random faults each."),
    ] = False,
    drawn: Annotated[
        int | None,
        Option(min=1, help="Inject N random faults instead, of any kind in any signal, from the first seed on."),
    ] = None,
) -> int:
    """Put every fault into every state of a pick and place, with each seed; status 1 if one ended not as promised.

    With --drawn: status 1 if a dangerous one that a signal shows was not noticed in time.
    """
    if assemblies:
        return _assemblies(shared, drawn or OF_ASSEMBLY)
    if drawn:
        return _drawn(shared, drawn)
    joints = len(load_configuration(shared.config, rested=False).robot.joints)
    screen, pairs, seeds = console(), chosen(fault, state, joints), shared.numbers
    heading = {"command": "faults", "pixels": shared.pixels, "config": str(shared.config)}
    kept = RowStore(shared.out, ["fault", "state", "seed"], heading)

    def tell(row: Row) -> None:
        kept.add(_ended(row))
        words = "as promised" if row["as_promised"] else "NOT AS PROMISED"
        screen.print(
            f"{row['fault']:<20} {row['state']:<16} {row['end']:<12} {words:<16} ticks {row['ticks_to_stop']}  "
            f"{row['stop_s']} s  {row['stop_m']} m  {row['reason']}",
            highlight=False,
        )

    _try(shared, {seed: left(pairs, kept.rows, seed, seeds.start) for seed in seeds}, tell)
    asked = {(name, at) for at, names in pairs.items() for name in (*names, "none")} | {("none", "none")}
    rows = [row for row in kept.rows if (row["fault"], row["state"]) in asked]
    table = merged(rows)
    good = all(bool(row["as_promised"]) for row in table)
    screen.print(f"{sum(bool(row['as_promised']) for row in table)} of {len(table)} pairs ended as promised")
    screen.print(totals(rows))
    if shared.as_json:
        print_json({"rows": table, "as_promised": good, **totals(rows)})
    return 0 if good else 1


def _ended(row: Row) -> Row:
    """A row that is kept.

    Raises:
        KeyboardInterrupt: a signal to this command ended the run, and no fault did; it is run again another time.
    """
    fault = FAULTS.get(str(row.get("fault")))
    if row["end"] == INTERRUPTED and (fault is None or INTERRUPTED not in fault.ends):
        raise KeyboardInterrupt
    return row


def _try(shared: Shared, pairs: Mapping[int, Pairs], tell: Callable[[Row], None]) -> None:
    """Tell how each fault ended in each state, by seed; with pixels each is a run of its own, else one run splits."""
    path, run = Path(shared.config), partial(mapped, workers=shared.workers, address=shared.scheduler)
    if shared.pixels:
        runs = [(path, fault, state, seed) for seed in pairs for state, names in pairs[seed].items() for fault in names]
        rows = run(fault_try, runs)
    else:
        splits = [(path, pairs[seed], seed) for seed in pairs if pairs[seed]]
        if shared.workers == 1 and shared.scheduler is None:  # rows come as they are known
            for split in splits:
                fast_rows(*split, tell)
            return
        rows = itertools.chain.from_iterable(run(fast_list, splits))
    for row in rows:
        tell(row)


def _drawn(shared: Shared, faults: int) -> int:
    screen, path, first = console(), Path(shared.config), shared.numbers.start
    kept = RowStore(shared.out, ["number"], {"command": "faults", "drawn_from": first, "config": str(path)})

    def tell(row: Row) -> None:
        kept.add(_ended(row))
        screen.print(words_of(row), highlight=False)

    joints = len(load_configuration(path).robot.joints)
    left = [(path, trials, seed) for trials, seed in missing(faults, first, kept.keys, joints)]
    if shared.workers == 1 and shared.scheduler is None:  # rows come as they are known
        for trial in left:
            drawn_rows(*trial, tell)
    else:
        for rows in mapped(drawn_list, left, shared.workers, shared.scheduler):
            for row in rows:
                tell(row)
    found = coverage(list(kept.rows))
    screen.print(found)
    if shared.as_json:
        print_json({"rows": list(kept.rows), **found})
    return 0 if found["kept"] else 1


def _assemblies(shared: Shared, faults: int) -> int:
    screen, path, seeds = console(), Path(shared.config), shared.numbers
    heading = {"command": "faults", "faults": faults, "pixels": shared.pixels, "config": str(path)}
    kept = RowStore(shared.out, ["seed"], heading)
    wanted = ((path, seed, faults) for seed in seeds if seed not in kept)
    work = partial(troubled_assembly, rendered=shared.pixels)
    for row in mapped(work, wanted, shared.workers, shared.scheduler):
        kept.add(_ended(row))
        words = "WRONG, AND NOT KNOWN" if row["unknown"] else "as promised" if row["as_promised"] else "NOT AS PROMISED"
        screen.print(f"seed {row['seed']}: {row['end']}, {words}; {row['faults']}; {row['reason']}", highlight=False)
    rows = [row for row in kept.rows if row["seed"] in seeds]
    found = counted(rows)
    screen.print(found)
    if shared.as_json:
        print_json({"rows": rows, **found})
    return 0 if found["as_promised"] == len(rows) else 1
