"""The command line; every command imports what it needs by itself, so that `cell check` answers at once."""

from __future__ import annotations

import gc
import re
import sys
from collections.abc import Iterable
from copy import copy
from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer
from typer.models import CommandInfo

from cell.commands.calibrate import calibrate
from cell.commands.entries import entries_of
from cell.commands.fleet import compare, sweep
from cell.commands.goals import goals_app
from cell.commands.hands import hands_app
from cell.commands.init import init
from cell.commands.log import log_app, report
from cell.commands.looks import looks
from cell.commands.models import data_app, eval_app, train_app
from cell.commands.new import new_app
from cell.commands.nodes import nodes
from cell.commands.replay import replay
from cell.commands.schema import schema
from cell.commands.see import see
from cell.commands.show import MONITOR_PORT, NodesOption, PortOption, monitor, show
from cell.commands.terminal import (
    CONFIGURATION,
    ConfigOption,
    JsonOption,
    PersonOption,
    SeedOption,
    console,
    print_json,
    table,
)
from cell.commands.world import WorldOption, world
from cell.interfaces.errors import CellError, DeviceFault, InputError, LogError, ModelError
from cell.interfaces.files import own_or_shipped

if TYPE_CHECKING:
    from cell.interfaces.errors import Problem
    from trees.files.registry import Registry

TREE = own_or_shipped("trees", "ahead.xml", "assemble.xml")
SHIFT_TREE = own_or_shipped("trees", "shift.xml")
BAD_INPUT, SAFE_STOP = 2, 3
SEARCHES_GARBAGE = 100_000  # new objects after which garbage is searched: 30 ms, less than a tick
LIVE_PORT = 8765
PAGE_PORT = 8780


def _tell_version(asked: bool) -> None:
    if asked:
        from importlib import metadata

        sys.stdout.write(f"cell {metadata.version('cell')}\n")
        raise typer.Exit


app = typer.Typer(
    no_args_is_help=True,
    pretty_exceptions_enable=False,
)
app.add_typer(train_app, name="train")
app.add_typer(eval_app, name="eval")
app.add_typer(data_app, name="data")
app.add_typer(log_app, name="log")
app.add_typer(goals_app, name="goals")
app.add_typer(new_app, name="new")
app.add_typer(hands_app, name="hands")
app.command()(calibrate)
app.command()(init)
app.command()(looks)
app.command()(nodes)
app.command()(replay)
app.command()(report)
app.command()(schema)
app.command()(see)
app.command()(show)
app.command()(monitor)
app.command()(sweep)
app.command()(compare)
app.command()(world)


@app.callback()
def options(
    version: Annotated[
        bool, typer.Option("--version", is_eager=True, callback=_tell_version, help="Say the version and end.")
    ] = False,
) -> None:
    """Behaviour-tree controller for a human-robot assembly cell."""


class Pace(StrEnum):
    """How fast simulated time passes."""

    fast = "fast"
    real = "real"


LookOption = Annotated[
    str | None,
    typer.Option(help="What the simulation looks like: nominal, varied, hard, PRESET:SECTION or a look file."),
]
BesideOption = Annotated[
    list[Path] | None,
    typer.Option("--also", help="Further tree files, or folders with them, whose trees may be named."),
]
EntriesOption = Annotated[
    list[str] | None,
    typer.Option("--set", help="NAME=VALUE: an entry of the main tree; or a YAML file with several."),
]
DoctorJsonOption = Annotated[bool, typer.Option("--json", help="One line of JSON instead.")]


def main(arguments: list[str] | None = None) -> int:
    """Run one command; returns the exit status: 0 done, 1 not finished, 2 bad input, 3 safe stop after a fault."""
    try:
        words = sys.argv[1:] if arguments is None else arguments
        status = _with_command(words[:1])(args=arguments, prog_name="cell", standalone_mode=False)
    except (InputError, LogError, ModelError) as error:
        return _complain(str(error), BAD_INPUT)
    except DeviceFault as error:
        return _complain(str(error), SAFE_STOP)
    except CellError as error:
        return _complain(str(error), 1)
    except typer.Abort:
        return _complain("interrupted", 1)
    except typer.TyperException as error:
        return _complain(error.format_message() + _usage(error), BAD_INPUT)
    except KeyboardInterrupt:
        return _complain("interrupted", 1)
    return status if isinstance(status, int) else 0


def _with_command(names: list[str]) -> typer.Typer:
    """With the command that is asked for alone, where there is such a one: to prepare all takes a tenth of a start."""
    asked = [one for one in app.registered_commands if one.callback is not None and _name(one) in names]
    if not asked:
        return app
    alone = copy(app)
    alone.registered_commands, alone.registered_groups = asked, []
    return alone


def _name(command: CommandInfo) -> str:
    assert command.callback is not None
    return command.name or command.callback.__name__.replace("_", "-")


def _usage(error: typer.TyperException) -> str:
    """What to type, where an argument is missing."""
    context = getattr(error, "ctx", None)
    if context is None or type(error).__name__ != "MissingParameter":
        return ""
    path, usage = context.command_path, context.get_usage().partition(": ")[2]
    usage = re.sub(r"\{(.*?)\}(\.\.\.)?", r"\1", usage)
    return f"\n  type: {' '.join(usage.split())}\n  {path} --help explains it"


@app.command()
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
    from cell import run as running
    from cell.run_options import RunOptions
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


@app.command()
def check(
    files: Annotated[list[Path], typer.Argument(metavar="FILE...", help="Tree files.")],
    config: Annotated[
        Path | None, typer.Option(help="Configuration whose part types and positions are the only legal ones.")
    ] = None,
    own_nodes: NodesOption = None,
    beside: BesideOption = None,
    entries: EntriesOption = None,
    stubs: Annotated[
        bool, typer.Option("--stubs", help="Take nodes that are not known here as they are, with any ports.")
    ] = False,
    strict: Annotated[bool, typer.Option("--strict", help="Warnings and notes are mistakes, too.")] = False,
    as_json: Annotated[bool, typer.Option("--json", help="For editors: one line of JSON with every problem.")] = False,
) -> int:
    """Say everything that is wrong with tree files."""
    from trees.files.check import Circumstances, findings

    known = Circumstances(tuple(beside or ()), entries_of(entries), stubs)
    problems, warnings, notes = findings(files, _registry(config, own_nodes or ()), known)
    if strict:
        problems, warnings, notes = [*problems, *warnings, *notes], [], []
    if as_json:
        told = {"problems": problems, "warnings": warnings, "notes": notes}
        shown = {key: [_problem_data(one) for one in told[key]] for key in told if told[key] or key == "problems"}
        print_json(shown)
        return BAD_INPUT if problems else 0
    for level, some in (("warning", warnings), ("note", notes)):
        sys.stderr.writelines(f"{one.place}: {level}: {one.what}\n" for one in some)
    if problems:
        raise InputError(*problems)
    unchecked = "" if config else "; names of parts, positions, goals and signals are checked with --config"
    sys.stderr.write(f"{len(files)} file{'s' if len(files) > 1 else ''}: nothing wrong{unchecked}\n")
    return 0


def _registry(config: Path | None, own_nodes: Iterable[str]) -> Registry:
    """The nodes that there are; with a configuration, ports take only names that it has."""
    from cell.running.node_library import node_registry

    if config is None:
        return node_registry(more=own_nodes)
    from cell.configuration import load_configuration, load_product

    configuration = load_configuration(config)
    return node_registry(load_product(configuration, config), own_nodes, configuration)


@app.command()
def doctor(config: ConfigOption = CONFIGURATION, as_json: DoctorJsonOption = False) -> int:
    """Say what is missing on this machine and how to get it; 1 where a run is not possible."""
    from cell.commands.doctor import examine

    findings = examine(config)
    healthy = all(finding.ok for finding in findings if finding.needed)
    if as_json:
        print_json({"healthy": healthy, "findings": [vars(finding) for finding in findings]})
    else:
        sys.stdout.writelines(f"{finding}\n" for finding in findings)
    return 0 if healthy else 1


def _problem_data(problem: Problem) -> dict[str, object]:
    place = problem.place
    where = {"file": str(place.file), "line": place.line, "column": place.column}
    return {**where, "what": problem.what, "legal": problem.legal}


def _complain(text: str, status: int) -> int:
    if text:  # none where the help was printed
        sys.stderr.write(f"cell: {text}\n")
    return status
