"""`cell run`: one product assembled, or a shift of them."""

from __future__ import annotations

import gc
from collections.abc import Iterable
from dataclasses import replace
from pathlib import Path
from typing import Annotated

import typer

from bracket_cell.commands.options import (
    CONFIGURATION,
    JsonOption,
    OpenOption,
    SetOption,
    WithOption,
    command_from,
    doors_of,
    entries_of,
    user_files,
)
from bracket_cell.commands.terminal import console, print_json, table
from bracket_cell.runs.options import RunOptions
from bracket_ground.files.files import user_or_packaged

TREE = user_or_packaged("bracket_cell.trees", "ahead.xml", "assemble.xml")
SHIFT_TREE = user_or_packaged("bracket_cell.trees", "shift_ahead.xml")
SEARCHES_GARBAGE = 100_000  # new objects after which garbage is searched: 30 ms, less than a tick
OPTIONS = (
    *("configuration", "goal", "seed", "look", "log", "watch", "brackets", "resume", "share"),
    *("page", "work_orders", "book", "operator"),
)

TreeArgument = Annotated[
    Path | None,
    typer.Argument(metavar="TREE", help="Tree file; trees/ahead.xml by default, trees/shift_ahead.xml for a shift."),
]
RealTimeOption = Annotated[
    float | None,
    typer.Option(
        "--real-time",
        metavar="[N]",
        min=1,
        max=50,
        help="Keep pace with the wall clock, or run N times slower, as `cell twin --slower N`; without it, as fast as "
        "possible.",
    ),
]
NO_LOOK = "none"  # nothing is rendered


@command_from(RunOptions, *OPTIONS, configuration=CONFIGURATION)
def run(
    options: RunOptions,
    tree: TreeArgument = None,
    real_time: RealTimeOption = None,
    entries: SetOption = None,
    own: WithOption = None,
    doors: OpenOption = None,
    as_json: JsonOption = False,
) -> int:
    """Run the cell: assemble one bracket, or a shift of them."""
    return assemble(chosen(options, tree, real_time, entries, own, doors), as_json)


def chosen(
    options: RunOptions,
    tree: Path | None,
    real_time: float | None,
    entries: Iterable[str] | None,
    own: Iterable[str] | None,
    doors: Iterable[str] | None,
) -> RunOptions:
    """The options of a run with what is typed in another form than they have."""
    nodes, beside = user_files(own)
    return replace(
        options,
        tree=tree or (TREE if options.brackets is None else SHIFT_TREE),
        pace="fast" if real_time is None else "real",
        slower=real_time or 1.0,
        look=None if options.look == NO_LOOK else options.look,
        pixels=options.look != NO_LOOK,
        nodes=nodes,
        beside=beside,
        entries=entries_of(entries),
        **doors_of(doors),
    )


def assemble(options: RunOptions, as_json: bool) -> int:
    """Run it, and say how it ended; returns the exit status."""
    from bracket_cell.runs.run import run as run_once  # not before the options are read: it takes half a second

    gc.freeze()  # what was imported stays
    gc.set_threshold(SEARCHES_GARBAGE)
    screen = console()
    result = run_once(options, screen)
    screen.print(table("run", result.rows))
    if as_json:
        print_json(result.summary)
    return result.outcome.exit_status
