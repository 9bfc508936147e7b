"""`cell lab run`: a run with another person, faults put in, orders typed, or in a world of its own."""

from __future__ import annotations

import sys
from dataclasses import replace
from typing import Annotated

import typer

from cell.commands.options import CONFIGURATION, JsonOption, SetOption, WithOption, takes
from cell.commands.run import OPTIONS, RealTimeOption, TreeArgument, assemble, chosen
from cell.runs.options import RunOptions
from cell.viewing.typed_orders import typed_lines


@takes(RunOptions, *OPTIONS, "person", "inject", "world", "overwrite", "unsafe_table", configuration=CONFIGURATION)
def run(
    options: RunOptions,
    tree: TreeArgument = None,
    real_time: RealTimeOption = False,
    entries: SetOption = None,
    own: WithOption = None,
    orders: Annotated[bool, typer.Option("--orders", help="Take an operator's orders, typed line by line.")] = False,
    as_json: JsonOption = False,
) -> int:
    """Run as `cell run` does, with the options of experiments too."""
    asked = chosen(options, tree, real_time, entries, own)
    return assemble(replace(asked, orders=typed_lines(sys.stdin.fileno()) if orders else None), as_json)
