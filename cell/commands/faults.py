"""`cell eval faults`, every fault in every state, and `cell eval encounters`, a person who gets into the arm's way."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from cell.commands.terminal import CONFIGURATION, ConfigOption, JsonOption, console, print_json


def faults(
    fault: Annotated[list[str] | None, typer.Option(help="Only these faults; all by default.")] = None,
    state: Annotated[list[str] | None, typer.Option(help="Only these states; all by default.")] = None,
    tries: Annotated[int, typer.Option(min=1, help="Runs of each pair, with other seeds.")] = 1,
    pixels: Annotated[
        bool, typer.Option("--pixels", help="Render every image, and run every pair from its beginning: slower.")
    ] = False,
    assemblies: Annotated[
        int, typer.Option(min=0, help="Instead: so many whole assemblies beside a person, with random faults.")
    ] = 0,
    each: Annotated[int, typer.Option("--faults", min=1, max=9, help="Faults in each of these assemblies.")] = 3,
    config: ConfigOption = CONFIGURATION,
    first_seed: Annotated[int, typer.Option(help="Seed of the first run.")] = 1,
    as_json: JsonOption = False,
) -> int:
    """Put every fault into every state of a pick and place, and say how it ended; status 1 where not as promised."""
    from cell.evaluating.faults import chosen, fast_rows, fault_try, merged

    screen = console()
    if assemblies:
        return _assemblies(Path(config), range(first_seed, first_seed + assemblies), each, pixels, as_json)
    pairs = chosen(fault, state)
    found: dict[tuple[object, object], list[dict[str, object]]] = {}

    def tell(row: dict[str, object]) -> None:
        found.setdefault((row["fault"], row["state"]), []).append(row)
        words = "as promised" if row["as_promised"] else "NOT AS PROMISED"
        screen.print(
            f"{row['fault']:<20} {row['state']:<16} {row['end']:<12} {words:<16} ticks {row['ticks_to_stop']}  "
            f"{row['stop_s']} s  {row['stop_m']} m  {row['reason']}",
            highlight=False,
        )

    for seed in range(first_seed, first_seed + tries):
        if not pixels:
            fast_rows(Path(config), pairs, seed, tell)
            continue
        for at, names in pairs.items():
            for name in names:
                tell(fault_try(Path(config), name, at, seed))
    table = [merged(rows) for rows in found.values()]
    good = all(bool(row["as_promised"]) for row in table)
    screen.print(f"{sum(bool(row['as_promised']) for row in table)} of {len(table)} pairs ended as promised")
    if as_json:
        print_json({"rows": table, "as_promised": good})
    return 0 if good else 1


def _assemblies(path: Path, seeds: range, faults: int, pixels: bool, as_json: bool) -> int:
    from cell.evaluating.troubled import troubled_assembly

    screen, rows = console(), []
    for seed in seeds:
        row = troubled_assembly(path, seed, faults, rendered=pixels)
        rows.append(row)
        words = "WRONG, AND NOT KNOWN" if row["unknown"] else "as promised" if row["as_promised"] else "NOT AS PROMISED"
        screen.print(f"seed {seed}: {row['end']}, {words}; {row['faults']}; {row['reason']}", highlight=False)
    good, unknown = sum(bool(row["as_promised"]) for row in rows), sum(bool(row["unknown"]) for row in rows)
    screen.print(f"{good} of {len(rows)} assemblies ended as promised, {unknown} wrong without being known")
    if as_json:
        print_json({"rows": rows, "as_promised": good, "unknown": unknown})
    return 0 if good == len(rows) else 1


def encounters(
    encounters: Annotated[int, typer.Option(min=1, help="How many times a hand goes into the arm's way.")] = 20,
    person: Annotated[str, typer.Option(help="Kind of person, as for `cell run --person`.")] = "careless",
    first_seed: Annotated[int, typer.Option(help="Seed of the first assembly.")] = 0,
    throughput_seeds: Annotated[
        int, typer.Option(min=0, help="Assemblies beside a careful person with and without separation.")
    ] = 3,
    pixels: Annotated[bool, typer.Option("--pixels", help="Render every image: twice the time.")] = False,
    config: ConfigOption = CONFIGURATION,
    as_json: JsonOption = False,
) -> int:
    """Assemble beside a person who gets in the way, and count contacts; status 1 where one was fast or avoidable."""
    from cell.evaluating.encounters import meet, throughput_ratio

    screen = console()

    def tell(words: str) -> None:
        screen.print(words, highlight=False)

    found = meet(Path(config), person, encounters, first_seed, tell, rendered=pixels)
    summary = {**found, "throughput_ratio": throughput_ratio(Path(config), range(throughput_seeds))}
    screen.print({name: value for name, value in summary.items() if name != "rows"})
    if as_json:
        print_json(summary)
    bad = found["contacts_fast"] or found["contacts_avoidable"] or found["moved_while_unknown"]
    return 1 if bad else 0
