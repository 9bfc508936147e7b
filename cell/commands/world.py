"""`cell world`: a simulated cell in a process of its own, for controllers that come and go."""

from __future__ import annotations

import signal
from pathlib import Path
from typing import Annotated

import typer

from cell.commands.terminal import CONFIGURATION, ConfigOption, PersonOption, SeedOption, console

ADDRESS = Path("runs/world.sock")
WorldOption = Annotated[
    Path | None, typer.Option("--world", help="Work in the simulated cell that `cell world` opened at this address.")
]


def world(
    at: Annotated[Path, typer.Option(help="Address: a socket file that is made there.")] = ADDRESS,
    config: ConfigOption = CONFIGURATION,
    goal: Annotated[str, typer.Option(help="What the simulated person assembles: a goal's name or random.")] = "random",
    seed: SeedOption = 0,
    person: PersonOption = None,
    look: Annotated[str | None, typer.Option(help="What the simulation looks like, as in `cell run`.")] = None,
    shift: Annotated[bool, typer.Option("--shift", help="The person goes on with the next bracket.")] = False,
) -> None:
    """Simulate a cell for controllers that come and go: `cell run --world ADDRESS`; Ctrl-C ends it."""
    from cell.configuration import for_shift, load_configuration, load_product, located, simulated
    from sim.process.opening import open_world

    configuration = simulated(load_configuration(config), look, person)
    if shift:
        configuration = for_shift(configuration, 0)
    at.parent.mkdir(parents=True, exist_ok=True)
    with located(config, configuration):
        product = load_product(configuration, config)
        server, devices = open_world(configuration, product, seed, goal, at)
    for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
        signal.signal(number, lambda *_: server.end())
    console().print(f"the world is at {at}: cell run --world {at}; Ctrl-C ends it", highlight=False)
    try:
        server.serve()
    finally:
        devices.close()
