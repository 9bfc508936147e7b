"""`cell lab run`: a run with another person, faults put in, orders typed, or in a world of its own."""

from __future__ import annotations

import sys
from dataclasses import replace
from functools import partial
from typing import Annotated

import typer

from bracket_cell.commands.options import CONFIGURATION, JsonOption, OpenOption, SetOption, WithOption, takes
from bracket_cell.commands.run import OPTIONS, RealTimeOption, TreeArgument, assemble, chosen
from bracket_cell.runs.options import RunOptions
from bracket_lab.evaluations.typed_orders import TypedOrders, typed_lines


@takes(RunOptions, *OPTIONS, "person", "inject", "world", "overwrite", "unsafe_table", configuration=CONFIGURATION)
def run(
    options: RunOptions,
    tree: TreeArgument = None,
    real_time: RealTimeOption = None,
    entries: SetOption = None,
    own: WithOption = None,
    doors: OpenOption = None,
    orders: Annotated[bool, typer.Option("--orders", help="Take an operator's orders, typed line by line.")] = False,
    as_json: JsonOption = False,
) -> int:
    """Like `cell run`, with options for experiments."""
    asked = chosen(options, tree, real_time, entries, own, doors)
    typed = partial(TypedOrders, typed_lines(sys.stdin.fileno())) if orders else None
    return assemble(replace(asked, orders=typed), as_json)
