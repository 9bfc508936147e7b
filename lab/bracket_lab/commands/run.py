"""`cell lab run`: a run with another person, faults put in, or in a world of its own."""

from __future__ import annotations

from bracket_cell.commands.options import CONFIGURATION, JsonOption, OpenOption, SetOption, WithOption, takes
from bracket_cell.commands.run import OPTIONS, RealTimeOption, TreeArgument, assemble, chosen
from bracket_cell.runs.options import RunOptions


@takes(RunOptions, *OPTIONS, "person", "inject", "world", "overwrite", "unsafe_table", configuration=CONFIGURATION)
def run(
    options: RunOptions,
    tree: TreeArgument = None,
    real_time: RealTimeOption = None,
    entries: SetOption = None,
    own: WithOption = None,
    doors: OpenOption = None,
    as_json: JsonOption = False,
) -> int:
    """Like `cell run`, with options for experiments."""
    return assemble(chosen(options, tree, real_time, entries, own, doors), as_json)
