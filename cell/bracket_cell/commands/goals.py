"""`cell goals`: the open list of goals, shown, fed from logs, and edited."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Annotated

import typer
from rich.table import Table

from bracket_cell.commands.log_terminal import read
from bracket_cell.commands.options import CONFIGURATION, ConfigOption, JsonOption
from bracket_cell.commands.terminal import console, print_json, product_of
from bracket_cell.configuration import load_configuration
from bracket_cell.learned.semantic.goals import FinishedGoal, OpenGoals
from bracket_cell.log.report.demonstrations import finished_bracket
from bracket_ground.errors import InputError
from bracket_ground.interfaces.variants import written

goals_app = typer.Typer(help="Show, learn and edit goals: those of the product file and those of finished brackets.")

FileOption = Annotated[
    Path | None, typer.Option("--file", help="File of goals; planners.semantic.goals of the configuration by default.")
]


@goals_app.callback(invoke_without_command=True)
def show(
    context: typer.Context, file: FileOption = None, config: ConfigOption = CONFIGURATION, as_json: JsonOption = False
) -> None:
    """Show all goals, how often each was finished, and how probable it is for the next bracket."""
    if (then := context.invoked_subcommand) is not None:
        context.default_map = {then: {"file": file, "config": config}}
        return
    semantic = load_configuration(config).planners.semantic
    kept, made = file or semantic.goals, product_of(config)
    goals = OpenGoals.load(kept, made, semantic.new_goals) if kept else OpenGoals.of(made, semantic.new_goals)
    product, prior = goals.product, goals.prior()
    table = Table(title=product.name, title_justify="left")
    table.add_column("goal", no_wrap=True)
    table.add_column(f"{product.positions[0]} to {product.positions[-1]}")
    for name in ("finished", "expected"):
        table.add_column(name, justify="right", no_wrap=True)
    rows = []
    for (name, parts), expected in zip(product.goals.items(), prior, strict=False):
        finished = goals.finished[name].finished if name in goals.finished else 0
        listed = name in goals.listed.goals
        rows.append({"goal": name, "parts": parts, "finished": finished, "expected": float(expected), "listed": listed})
        table.add_row(name, " ".join(map(written, parts)), str(finished), f"{expected:.3f}")
    table.add_row("none of these", "", "", f"{prior[-1]:.3f}")
    console().print(table)
    if as_json:
        print_json({"goals": rows, "none_of_these": float(prior[-1])})


@goals_app.command()
def learn(
    logs: Annotated[list[Path], typer.Argument(metavar="LOG...", help="Logs of finished brackets.")],
    file: FileOption = None,
    config: ConfigOption = CONFIGURATION,
) -> None:
    """Learn goals from brackets that recorded runs finished; showing one bracket is such a run."""
    goals = _load(file, config)
    for path in logs:
        parts = finished_bracket(read([path]), goals.listed)
        if parts is None:
            console().print(f"{path}: not finished, nothing learned", highlight=False)
            continue
        goals = goals.with_bracket(parts)
        name = next(name for name, goal in goals.finished.items() if goal.parts == parts)
        console().print(f"{path}: {name} ({' '.join(parts)})", highlight=False)
    goals.save(_path(file, config))


@goals_app.command()
def add(
    name: Annotated[str, typer.Argument(help="Its name.")],
    parts: Annotated[list[str] | None, typer.Argument(metavar="PART...", help="The part at every position.")] = None,
    finished: Annotated[int, typer.Option(min=0, help="Finished brackets that it counts for; 0 forgets it.")] = 3,
    file: FileOption = None,
    config: ConfigOption = CONFIGURATION,
) -> None:
    """Add a goal by hand, or say how often one was finished: never, to forget what was learned of it."""
    goals, path = _load(file, config), _path(file, config)
    if finished == 0 and name not in goals.finished:
        raise InputError(f"no goal {name!r} was finished; there are: {', '.join(goals.finished) or 'none'}")
    if finished == 0:
        left = {key: goal for key, goal in goals.finished.items() if key != name}
        replace(goals, finished=left).save(path)
        return
    added = {name: FinishedGoal(parts=tuple(parts or ()), finished=finished)}
    changed = replace(goals, finished=goals.finished | added)
    changed.check(path)
    changed.save(path)
    console().print(f"{name} ({' '.join(added[name].parts)}), finished {finished}, in {path}", highlight=False)


def _path(file: Path | None, config: Path) -> Path:
    path = file or load_configuration(config).planners.semantic.goals
    if path is None:
        raise InputError(f"{config} names no planners.semantic.goals; add `goals: goals.yaml` there, or name a --file")
    return path


def _load(file: Path | None, config: Path) -> OpenGoals:
    settings = load_configuration(config).planners.semantic.new_goals
    return OpenGoals.load(_path(file, config), product_of(config), settings)
