"""`cell lab run`: a run with another person, faults put in, or in a world of its own."""

from __future__ import annotations

import signal
from functools import partial
from pathlib import Path
from typing import Annotated

import typer

from bracket_cell.commands.options import (
    CONFIGURATION,
    ConfigOption,
    JsonOption,
    OpenOption,
    SeedOption,
    SetOption,
    WithOption,
    command_from,
)
from bracket_cell.commands.run import OPTIONS, RealTimeOption, TreeArgument, assemble, chosen
from bracket_cell.commands.terminal import console
from bracket_cell.configuration import for_shift, load_configuration, load_product, located, simulated
from bracket_cell.runs.options import RunOptions
from bracket_cell.wiring.detectors import detectors_of, with_detectors_for
from bracket_sim.process.opening import open_world

ADDRESS = Path("runs/world.sock")


def world(
    at: Annotated[Path, typer.Option(help="Address: a socket file that is made there.")] = ADDRESS,
    config: ConfigOption = CONFIGURATION,
    goal: Annotated[str, typer.Option(help="Goal of the simulated person: a goal's name, or random.")] = "random",
    seed: SeedOption = 0,
    person: Annotated[
        str | None, typer.Option(help="The simulated person, as in `cell lab run`; as configured by default.")
    ] = None,
    look: Annotated[str | None, typer.Option(help="Look of the simulation; as configured by default.")] = None,
    shift: Annotated[bool, typer.Option("--shift", help="The person continues with the next bracket.")] = False,
) -> None:
    """Run the simulated cell by itself, for controllers that connect by `cell lab run --world`; Ctrl-C ends it."""
    configuration = simulated(load_configuration(config), look, person)
    if shift:
        configuration = for_shift(configuration, 0)
    at.parent.mkdir(0o700, parents=True, exist_ok=True)
    with located(config, configuration):
        product = load_product(configuration, config)
        configuration, _ = with_detectors_for(configuration, product)
        detect = partial(detectors_of, configuration.bench, product, configuration.perception)
        server, devices = open_world(configuration, product, seed, goal, at, detect)
    try:
        for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
            signal.signal(number, lambda *_: server.end())
        console().print(f"the world is at {at}: cell lab run --world {at}; Ctrl-C ends it", highlight=False)
        server.serve()
    finally:  # also where nobody reads what is printed: its processes would be waited for at exit, for ever
        devices.close()


@command_from(
    RunOptions, *OPTIONS, "person", "inject", "world", "overwrite", "unsafe_table", configuration=CONFIGURATION
)
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
