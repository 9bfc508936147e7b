"""`cell lab eval encounters` and `separation`: a person who gets into the arm's way, and what the distance costs."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from functools import partial
from pathlib import Path
from typing import Annotated

from rich.console import Console
from typer import Option

from bracket_cell.commands.options import command_from
from bracket_cell.commands.terminal import console, print_json
from bracket_cell.configuration import DEFAULT_TREE
from bracket_cell.fleet.engine import mapped
from bracket_ground.errors import InputError
from bracket_ground.files.row_store import Row, RowStore
from bracket_lab.commands.shared import Shared
from bracket_lab.evaluations.assembly import cost_of_separation, timed_pair
from bracket_lab.evaluations.encounters import Tracker, encounter, passed, summary

GIVEN_UP = 5  # seeds without an encounter, after which no more are tried


@command_from(
    *(Shared, "person", "seeds", "pixels", "out", "workers", "scheduler", "config", "as_json"),
    person="careless",
    seeds="0:1000",
)
def encounters(
    shared: Shared,
    encounters: Annotated[int, Option(min=1, help="How many times a hand gets into the arm's way.")] = 20,
    provoked: Annotated[
        bool,
        Option(
            "--provoked/--by-habit",
            help="Put a hand in the arm's way in every phase, or let the person's habits do it.",
        ),
    ] = True,
    tracker: Annotated[
        Tracker, Option(help="Spoil the hand tracker: it sees nothing, half of the hands, or 50 mm off.")
    ] = Tracker.true,
    tree: Annotated[Path, Option(help="Tree file to run.")] = DEFAULT_TREE,
) -> int:
    """Assemble next to a person who gets in the way, judged by the truth.

    Status 1 if a contact was fast, more than 5 % of the encounters were contacts with an arm that moved (with
    --tracker: any), one of these had more than 140 N where a hand could be clamped or 280 N elsewhere, or the arm
    moved while nobody knew where the hand is. A run ends once the arm stood for 60 s.
    """
    path, person = Path(shared.config), shared.person
    if shared.pixels and tracker is not Tracker.true:
        raise InputError("--tracker spoils what is seen without images: leave --pixels out")
    experiment = {"person": person, "provoked": provoked, "tree": str(tree), "pixels": shared.pixels}
    experiment |= {"config": str(path), "tracker": tracker.value}
    kept = RowStore(shared.out, ["seed"], {"command": "encounters", **experiment})
    met = partial(encounter, path, tree, person, provoked=provoked, rendered=shared.pixels, tracker=tracker)
    run = partial(mapped, workers=shared.workers, address=shared.scheduler)
    if not _meet(kept, lambda seeds: run(met, seeds), encounters, shared.numbers):
        return 1
    found = summary(kept.rows)
    fields = {**experiment, **found}
    console().print(fields)
    if not found["encounters"]:
        console().print(f"no encounter: the arm moved near nobody in {found['sim_time_s']} s")
    if shared.as_json:
        print_json({**fields, "rows": kept.rows})
    return 0 if passed(found, tracker) else 1


@command_from(
    *(Shared, "person", "seeds", "out", "workers", "scheduler", "config", "as_json"),
    person="careful",
    seeds="0:20",
)
def separation(shared: Shared, tree: Annotated[Path, Option(help="Tree file to run.")] = DEFAULT_TREE) -> None:
    """Tell what keeping away from the person costs: the same brackets with and without separation, without images."""
    experiment = {"person": shared.person, "tree": str(tree), "config": str(shared.config)}
    kept = RowStore(shared.out, ["seed"], {"command": "separation", **experiment})
    left = [(shared.config, tree, shared.person, seed) for seed in shared.numbers if seed not in kept]
    for row in mapped(timed_pair, left, workers=shared.workers, address=shared.scheduler) if left else ():
        kept.add(row)
    rows = list(kept.rows_of(shared.numbers))
    fields = {**experiment, **cost_of_separation(rows)}
    console().print(fields)
    if shared.as_json:
        print_json({**fields, "rows": rows})


def _meet(
    kept: RowStore, rows_of: Callable[[Iterable[tuple[int]]], Iterable[Row]], encounters: int, seeds: range
) -> bool:
    """Assemble until the hand was in the arm's way so often; returns False where somebody interrupts.

    Args:
        rows_of: runs seeds.
        seeds: of assemblies, at most.
    """
    if _enough(kept.rows, encounters, seeds.start):
        return True
    left = ((seed,) for seed in seeds if seed not in kept)
    for row in rows_of(left):
        if row["end"] == "interrupted":  # the seed is run again another time
            return False
        kept.add(row)
        _tell_assembly(console(), kept.rows[-1])
        if _enough(kept.rows, encounters, seeds.start):
            break
    return True


def _enough(rows: Sequence[Row], encounters: int, first_seed: int) -> bool:
    """Whether this many were met; a person who never gets in the way is given up after a few seeds."""
    met, last = _met(rows), max((int(str(row["seed"])) for row in rows), default=-1)
    return met >= encounters or (not met and last >= first_seed + GIVEN_UP - 1)


def _met(rows: Sequence[Row]) -> int:
    return sum(int(str(row["encounters"])) for row in rows)


def _tell_assembly(screen: Console, row: Row) -> None:
    contacts: Sequence[Row] = row["contacts"]
    words = f"{row['encounters']} encounters, {len(contacts)} contacts"
    if row.get("acknowledged"):
        words += f", acknowledged {row['acknowledged']} times"
    why = "" if row["end"] == "finished" else f" ({row['reason']})"
    screen.print(f"seed {row['seed']}: {row['end']} after {row['sim_time_s']} s{why}, {words}", highlight=False)
    for contact in contacts:
        bad = "".join(f" {name.upper()}" for name in ("clamped", "moving", "fast", "over") if contact[name])
        screen.print(
            f"  {contact['start_s']:.2f} s {contact['phase']}: {contact['robot']} and {contact['human']}, "
            f"first {contact['first_m_s']:.2f}, at most {contact['speed_m_s']:.2f} m/s, "
            f"{contact['force_n']:.0f} N{bad}; {contact['known']}",
            highlight=False,
        )
