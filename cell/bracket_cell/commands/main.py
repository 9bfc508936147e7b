"""The command line: a table of commands, of which only the one that is asked for is imported."""

from __future__ import annotations

import errno
import io
import os
import re
import shlex
import sys
from collections.abc import Callable, Sequence
from typing import Annotated

import typer

from bracket_cell.commands.options import with_usual
from bracket_cell.commands.terminal import BAD_INPUT, BESIDE, SAFE_STOP, Command, Table, complain
from bracket_cell.packages import LABORATORY, SIMULATOR, offers
from bracket_ground.errors import CellError, DeviceFault, InputError, LogError, ModelError, words_of
from btxml.engine.errors import TreeError

OWN = ("bracket_", "btxml")  # a module of these that is missing is a defect, not an installation
FULL = {errno.ENOSPC, errno.EDQUOT, errno.EFBIG, errno.EIO}  # of what a command prints to
INTERRUPTED = 130  # what typer makes of Ctrl-C
BLANK = re.compile("--[a-z-]+=|(-[a-z]|--[a-z-]+=)?-|")  # would be the working folder, or a file whose name is "-"
START, PROGRAM, TEST, TRAIN = "Start", "Program", "Test", "Train"
LAB = "lab"
COMMANDS: Table = {
    "init": Command("bracket_cell.commands.init:init", "Make a folder for a cell of your own.", START),
    "doctor": Command("bracket_cell.commands.doctor:doctor", "Say what is missing on this machine.", START),
    "docs": Command("bracket_cell.commands.docs:docs", "Read the guides: all of them by their titles, or one.", START),
    "run": Command("bracket_cell.commands.run:run", "Run the cell: assemble one bracket, or a shift of them.", START),
    "serve": Command("bracket_cell.commands.serve:serve", "Serve the page of a cell, and begin runs below it.", START),
    "setup": Command(
        "bracket_cell.commands.commission:setup_app", "Make a real cell ready: teach, calibrate, try.", START
    ),
    "twin": Command("twin", "Serve the simulated cell by the wires of real devices.", TEST, comes_with=SIMULATOR),
    "safety": Command("bracket_cell.commands.safety:safety_app", "Show and sign what decides on people.", START),
    "new": Command(
        "bracket_cell.commands.new:new_app", "Start a tree file, a node, a part or a real cell of your own.", PROGRAM
    ),
    "check": Command("bracket_cell.commands.tree_files:check", "Check tree files and list all mistakes.", PROGRAM),
    "nodes": Command("bracket_cell.commands.tree_files:nodes", "List the nodes that tree files may name.", PROGRAM),
    "schema": Command("bracket_cell.commands.schema:schema", "Write schemas of all files that you edit.", PROGRAM),
    "lsp": Command("bracket_cell.commands.lsp:lsp", "Serve an editor: the language server of tree files.", PROGRAM),
    "dap": Command("bracket_cell.commands.dap:dap", "Serve an editor's debugger: breakpoints in tree files."),
    "show": Command(
        "bracket_cell.commands.show:show", "Print or draw the tree of a file or a log, or watch that of a run.", PROGRAM
    ),
    "replay": Command(
        "bracket_cell.commands.replay:replay", "Run the tree again on a log's inputs and compare every decision.", TEST
    ),
    "report": Command("bracket_cell.commands.log:report", "Write one HTML page about a run.", TEST),
    "log": Command("bracket_cell.commands.log:log_app", "Search, compare and export logs.", TEST),
    "record": Command("record", "Keep frames of a camera, with its calibration.", TRAIN, comes_with=LABORATORY),
    "label": Command("label", "Label pictures in a browser.", TRAIN, comes_with=LABORATORY),
    "train": Command("train", "Train planners and detectors for a product.", TRAIN, comes_with=LABORATORY),
    "goals": Command("bracket_cell.commands.goals:goals_app", "Show, learn and edit goals.", TRAIN),
    "compare": Command("bracket_cell.commands.compare:compare", "Compare two trees by pairs of runs.", TRAIN),
    LAB: Command("lab", "Research: evaluations, data, networks.", group=True, comes_with=LABORATORY),
    "_data": Command("_data", "What trainings call to make their data.", comes_with=LABORATORY),
    "_train": Command("_train", "What `cell train` calls for each network.", comes_with=LABORATORY),
}


def _say_version(asked: bool) -> None:
    if asked:
        from bracket_cell.packages import version
        from bracket_cell.recording.identity import UNKNOWN, code_version

        commit, clean = code_version().values()
        of_commit = "" if commit == UNKNOWN else f" (commit {commit[:8]}{'' if clean == 'true' else ', changed'})"
        sys.stdout.write(f"cell {version()}{of_commit}\n")
        raise typer.Exit


def _program(
    version: Annotated[
        bool, typer.Option("--version", is_eager=True, callback=_say_version, help="Print the version.")
    ] = False,
) -> None:
    """Behaviour-tree controller for a human-robot assembly cell."""


def application(words: Sequence[str] | None = None) -> typer.Typer:
    """The command line for some words; with all its commands where none are given."""
    text = "`cell lab --help` lists the commands for research." if offers(LABORATORY) else None
    app = typer.Typer(no_args_is_help=True, pretty_exceptions_enable=False, epilog=text)
    app.callback()(_program)
    _add(app, COMMANDS, words)
    return app


def _add(app: typer.Typer, commands: Table, words: Sequence[str] | None) -> None:
    """Add the command that the first word names; where it names none, all of them by their names alone."""
    asked = words[0] if words else None
    for name, command in commands.items():
        if words is not None and asked in commands and asked != name:
            continue
        hidden = commands is COMMANDS and command.panel is None
        if words is not None and asked != name:
            app.command(name, help=command.help, rich_help_panel=command.panel, hidden=hidden)(_nothing)
            continue
        if command.group:
            group = typer.Typer(no_args_is_help=True, help=command.help)
            _add(group, command.load(), None if words is None else words[1:])
            app.add_typer(group, name=name, hidden=hidden)
        elif isinstance(target := command.load(), typer.Typer):
            app.add_typer(target, name=name, rich_help_panel=command.panel, hidden=hidden)
        else:
            app.command(name, rich_help_panel=command.panel, hidden=hidden)(target)


def _nothing() -> None:
    """Stands for a command that is listed and not called."""


def main(arguments: list[str] | None = None, begins: Callable[[], object] = tuple) -> int:
    """Run one command; returns the exit status: 0 done, 1 not finished, 2 bad input, 3 safe stop after a fault.

    Args:
        begins: called when the command is imported.
    """
    try:
        words = _typed(arguments)
        if blank := [word for word in words if BLANK.fullmatch(word)]:
            raise InputError(f"`cell {shlex.join(words)}`: {blank[0]!r} names nothing; name a file, or leave it out")
        if {"run", "serve", "show"} & set(words[:2]):
            words = with_usual(words)
        program = application(words)
        begins()
        status = program(args=words, prog_name="cell", standalone_mode=False)
        sys.stdout.flush()
    except (InputError, LogError, ModelError, TreeError) as error:
        return _complain(str(error), BAD_INPUT)
    except DeviceFault as error:
        return _complain(str(error), SAFE_STOP)
    except CellError as error:
        return _complain(str(error), 1)
    except (typer.Abort, KeyboardInterrupt):  # the latter while typer gets ready
        return _interrupted()
    except (AttributeError, ImportError, OSError, RuntimeError) as error:
        if _of_ctrl_c(error):
            return _interrupted()
        from bracket_cell.simulator import installed

        message = None if (found := installed()) is None else found.missing_library(error)
        if message is None and isinstance(error, ModuleNotFoundError) and not (error.name or "").startswith(OWN):
            message = f"the package {error.name} is not installed: `cell doctor` says how to get it"
        if message is None and isinstance(error, OSError) and error.errno in FULL:
            message, sys.stdout = f"the output cannot be written: {words_of(error)}", io.StringIO()  # the rest is lost
        if message is None and isinstance(error, OSError) and error.errno == errno.ENAMETOOLONG:
            message = f"{error.filename!s:.60}...: {words_of(error).lower()}: file systems take names of 255 bytes"
        if message is None:
            raise
        return _complain(message, BAD_INPUT)
    except typer.TyperException as error:
        return _complain(error.format_message().replace("Value error, ", "") + _usage(error), BAD_INPUT)
    if status == INTERRUPTED:
        return _interrupted()
    return status if isinstance(status, int) else 0


def _typed(arguments: list[str] | None) -> list[str]:
    """The words after `cell`; while a shell completes a line, those of that line."""
    if arguments is None and "_CELL_COMPLETE" in os.environ:
        return os.environ.get("COMP_WORDS", os.environ.get("_TYPER_COMPLETE_ARGS", "")).split()[1:]
    return sys.argv[1:] if arguments is None else list(arguments)


def _usage(error: typer.TyperException) -> str:
    """What to type, where an argument is missing."""
    context = getattr(error, "ctx", None)
    if context is None or type(error).__name__ != "MissingParameter":
        return ""
    path, usage = context.command_path, context.get_usage().partition(": ")[2]
    usage = re.sub(r"\{(.*?)\}(\.\.\.)?", r"\1", usage)
    return f"\n  type: {' '.join(usage.split())}\n  {path} --help explains it"


def _of_ctrl_c(error: BaseException | None) -> bool:
    """Whether Ctrl-C is behind an error: what it interrupts while it is imported raises its own."""
    return error is not None and (
        isinstance(error, KeyboardInterrupt) or _of_ctrl_c(error.__cause__ or error.__context__)
    )


def _interrupted() -> int:
    """Said once: a command that another one runs leaves it to that one, which Ctrl-C reaches, too."""
    return 1 if BESIDE in os.environ else _complain("interrupted", 1)


def _complain(text: str, status: int) -> int:
    if text:  # none where the help was printed
        complain(text)
    return status
