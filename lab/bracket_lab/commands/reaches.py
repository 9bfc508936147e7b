"""`cell lab reaches` and `cell lab eval reaches`: what the person reaches for, how far and how high."""

from __future__ import annotations

from functools import partial
from pathlib import Path
from typing import Annotated

import typer

from bracket_cell.commands.log_terminal import read
from bracket_cell.commands.options import CONFIGURATION, ConfigOption, JsonOption, command_from
from bracket_cell.commands.terminal import console, print_json, report_scores, table
from bracket_cell.configuration import load_configuration, load_product
from bracket_cell.fleet.engine import mapped
from bracket_lab.commands.shared import Shared
from bracket_lab.evaluations import reaches as scoring
from bracket_lab.evaluations.reaches import HandWay, ergonomics


def of_logs(
    logs: Annotated[list[Path], typer.Argument(metavar="LOG...", help="Logs to set side by side, a run each.")],
    config: ConfigOption = CONFIGURATION,
    as_json: JsonOption = False,
) -> None:
    """Tell what the person of a run reached for, how far from the shoulder, and how long above it.

    The shoulder is taken to be .36 m behind the resting palm and above the table.
    """
    configuration = load_configuration(config)
    product = load_product(configuration, config)
    for log in logs:
        views = (tick.observation.bench for tick in read([log]).ticks)
        found = ergonomics(HandWay.of_views(view for view in views if view), configuration.bench, product)
        console().print(table(str(log), found))
        if as_json:
            print_json({"log": str(log), **found})


@command_from(
    Shared, "look", "person", "seeds", "out", "workers", "scheduler", "config", "as_json", seeds="900000:900020"
)
def evaluate(shared: Shared) -> None:
    """Score what a robot spares the person: the same bracket beside it and alone, from the truth, without images."""
    configuration, product = shared.cell()
    kept = shared.rows(["seed"], {"command": "reaches", "look": shared.look, "person": shared.person}, scoring)
    left = [(seed,) for seed in shared.numbers if seed not in kept]
    for row in mapped(partial(scoring.pair, configuration, product), left, shared.workers, shared.scheduler):
        kept.add(row)
    found = scoring.summary(list(kept.rows_of(seed for seed in shared.numbers)))
    report_scores(f"reaches, {shared.person}", {k: v for k, v in found.items() if isinstance(v, float)}, False)
    if shared.as_json:
        print_json({"person": shared.person, "seeds": shared.seeds, **found})
