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
        context.default_map, context.obj = {then: {"file": file, "config": config}}, as_json
        return
    semantic = load_configuration(config).planners.semantic
    kept, made = file or semantic.goals, product_of(config)
    goals = OpenGoals.load(kept, made, semantic.new_goals) if kept else OpenGoals.of(made, semantic.new_goals)
    product, prior = goals.product, goals.prior()
    table = Table(title=product.name, title_justify="left")
    for name in ("goal", slots := f"{product.positions[0]} to {product.positions[-1]}", "finished", "expected"):
        table.add_column(name, justify="left" if name in ("goal", slots) else "right", no_wrap=name != slots)
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
    context: typer.Context,
    logs: Annotated[list[Path], typer.Argument(metavar="LOG...", help="Logs of finished brackets.")],
    file: FileOption = None,
    config: ConfigOption = CONFIGURATION,
) -> None:
    """Learn goals from brackets that recorded runs finished; showing one bracket is such a run."""
    (goals, kept), learned = _open(file, config), []
    for path in logs:
        parts, name = finished_bracket(read([path]), goals.listed), None
        if parts is not None:
            goals = goals.with_bracket(parts)
            name = next(name for name, goal in goals.finished.items() if goal.parts == parts)
        learned.append({"log": str(path), "goal": name, "parts": parts})
        what = "not finished, nothing learned" if parts is None else f"{name} ({' '.join(parts)})"
        console().print(f"{path}: {what}", highlight=False)
    goals.save(kept)
    if context.obj:
        print_json({"learned": learned})


@goals_app.command()
def add(
    context: typer.Context,
    name: Annotated[str, typer.Argument(help="Its name.")],
    parts: Annotated[list[str] | None, typer.Argument(metavar="PART...", help="The part at every position.")] = None,
    finished: Annotated[int, typer.Option(min=0, help="Finished brackets that it counts for; 0 forgets it.")] = 3,
    file: FileOption = None,
    config: ConfigOption = CONFIGURATION,
) -> None:
    """Add a goal by hand, or say how often one was finished: never, to forget what was learned of it."""
    goals, path = _open(file, config)
    if finished == 0 and name not in goals.finished:
        raise InputError(f"no goal {name!r} was finished; there are: {', '.join(goals.finished) or 'none'}")
    others = {key: goal for key, goal in goals.finished.items() if key != name}
    added = FinishedGoal(parts=tuple(parts or ()), finished=finished) if finished else goals.finished[name]
    changed = replace(goals, finished=goals.finished | {name: added} if finished else others)
    changed.check(path)
    changed.save(path)
    console().print(f"{name} ({' '.join(added.parts)}), finished {finished}, in {path}", highlight=False)
    if context.obj:
        print_json({"goal": name, "parts": added.parts, "finished": finished, "file": str(path)})


def _open(file: Path | None, config: Path) -> tuple[OpenGoals, Path]:
    semantic = load_configuration(config).planners.semantic
    if (path := file or semantic.goals) is None:
        raise InputError(f"{config} names no planners.semantic.goals; add `goals: goals.yaml` there, or name a --file")
    return OpenGoals.load(path, product_of(config), semantic.new_goals), path
