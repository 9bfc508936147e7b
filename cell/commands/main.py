"""The command line; every command imports what it needs by itself, so that `cell check` answers at once."""

from __future__ import annotations

import os
import re
import sys
from copy import copy
from typing import Annotated

import typer
from typer.models import CommandInfo

from cell.commands.calibrate import calibrate
from cell.commands.check import check
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
from cell.commands.run import run
from cell.commands.schema import schema
from cell.commands.see import see
from cell.commands.show import monitor, show
from cell.commands.terminal import BAD_INPUT, BESIDE, CONFIGURATION, SAFE_STOP, ConfigOption, print_json
from cell.commands.world import world
from cell.errors import CellError, DeviceFault, InputError, LogError, ModelError

INTERRUPTED = 130  # what typer makes of Ctrl-C


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
app.command()(run)
app.command()(check)
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


DoctorJsonOption = Annotated[bool, typer.Option("--json", help="One line of JSON instead.")]


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
    except (typer.Abort, KeyboardInterrupt):  # the latter while typer gets ready
        return _interrupted()
    except typer.TyperException as error:
        return _complain(error.format_message() + _usage(error), BAD_INPUT)
    if status == INTERRUPTED:
        return _interrupted()
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


def _interrupted() -> int:
    """Said once: a command that another one runs leaves it to that one, which Ctrl-C reaches, too."""
    return 1 if BESIDE in os.environ else _complain("interrupted", 1)


def _complain(text: str, status: int) -> int:
    if text:  # none where the help was printed
        sys.stderr.write(f"cell: {text}\n")
    return status
