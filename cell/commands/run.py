"""`cell run`: one product assembled, or a shift of them."""

from __future__ import annotations

import gc
import sys
from enum import StrEnum
from pathlib import Path
from typing import Annotated

import typer

from cell.commands.entries import entries_of
from cell.commands.show import MONITOR_PORT, NodesOption, PortOption
from cell.commands.terminal import (
    CONFIGURATION,
    BesideOption,
    ConfigOption,
    EntriesOption,
    JsonOption,
    PersonOption,
    SeedOption,
    console,
    print_json,
    table,
)
from cell.commands.world import WorldOption
from cell.files.files import own_or_shipped

TREE = own_or_shipped("trees", "ahead.xml", "assemble.xml")
SHIFT_TREE = own_or_shipped("trees", "shift.xml")
SEARCHES_GARBAGE = 100_000  # new objects after which garbage is searched: 30 ms, less than a tick
LIVE_PORT = 8765
PAGE_PORT = 8780


class Pace(StrEnum):
    """How fast simulated time passes."""

    fast = "fast"
    real = "real"


LookOption = Annotated[
    str | None,
    typer.Option(help="What the simulation looks like: nominal, varied, hard, PRESET:SECTION or a look file."),
]


def run(
    tree: Annotated[
        Path | None,
        typer.Option(help="Tree file to run; trees/ahead.xml, or for a shift trees/shift.xml."),
    ] = None,
    config: ConfigOption = CONFIGURATION,
    goal: Annotated[str, typer.Option(help="What the simulated person assembles: a goal's name or random.")] = "random",
    seed: SeedOption = 0,
    person: PersonOption = None,
    pace: Annotated[Pace, typer.Option(help="fast: as fast as it goes; real: tied to the wall clock.")] = Pace.fast,
    log: Annotated[Path | None, typer.Option(help="Log file (MCAP); a new one in runs/ by default.")] = None,
    inject: Annotated[str | None, typer.Option(help="FAULT@STATE: put a fault in, as `cell eval faults` does.")] = None,
    overwrite: Annotated[bool, typer.Option("--overwrite", help="Replace the file of --log if it is there.")] = False,
    monitor: Annotated[bool, typer.Option("--monitor", help="Let Groot2 watch, on this machine only.")] = False,
    monitor_port: PortOption = MONITOR_PORT,
    monitor_hooks: Annotated[
        bool, typer.Option("--monitor-hooks", help="Let it put breakpoints and overrides on nodes, too.")
    ] = False,
    watch: Annotated[bool, typer.Option("--watch", help="Take over edits of the tree file while it runs.")] = False,
    live: Annotated[
        bool, typer.Option("--live", help="Serve the log's channels to Foxglove, on this machine.")
    ] = False,
    live_port: Annotated[int, typer.Option(min=0, max=65535, help="Port for --live; 0: any free one.")] = LIVE_PORT,
    look: LookOption = None,
    own_nodes: NodesOption = None,
    beside: BesideOption = None,
    entries: EntriesOption = None,
    page: Annotated[bool, typer.Option("--page", help="Serve the operator's page, on this machine only.")] = False,
    page_port: Annotated[int, typer.Option(min=0, max=65535, help="Port for --page; 0: any free one.")] = PAGE_PORT,
    orders: Annotated[
        bool, typer.Option("--orders", help="Take an operator's orders, typed line by line (docs/shift.md).")
    ] = False,
    brackets: Annotated[
        int | None,
        typer.Option(min=0, help="A shift: so many brackets one after the other; 0: until it is stopped."),
    ] = None,
    world_address: WorldOption = None,
    resume: Annotated[
        Path | None, typer.Option(help="Go on with the work of this log, whose run was broken off.")
    ] = None,
    as_json: JsonOption = False,
) -> int:
    """Assemble one product, or a shift of them."""
    from cell.runs import run as running
    from cell.runs.options import RunOptions
    from cell.viewing.typed_orders import typed_lines

    screen = console()
    port = monitor_port if monitor or monitor_hooks else None
    options = RunOptions(
        tree=tree or (TREE if brackets is None else SHIFT_TREE),
        configuration=config,
        goal=goal,
        seed=seed,
        pace=pace.value,
        log=log,
        overwrite=overwrite,
        inject=inject,
        monitor_port=port,
        monitor_hooks=monitor_hooks,
        watch=watch,
        live_port=live_port if live else None,
        person=person,
        look=look,
        nodes=tuple(own_nodes or ()),
        beside=tuple(beside or ()),
        entries=entries_of(entries),
        brackets=brackets,
        world=world_address,
        resume=resume,
        page_port=page_port if page else None,
        orders=typed_lines(sys.stdin.fileno()) if orders else None,
    )
    gc.freeze()  # what was imported stays
    gc.set_threshold(SEARCHES_GARBAGE)
    result = running.run(options, screen)
    screen.print(table("run", result.rows))
    if as_json:
        print_json(result.summary)
    return result.outcome.exit_status
