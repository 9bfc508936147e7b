"""`cell check`: everything that is wrong with tree files; `cell nodes`: the nodes that they may name."""

from __future__ import annotations

import json
import sys
from enum import StrEnum
from pathlib import Path
from typing import Annotated

import typer

from bracket_cell.commands.options import (
    JsonOption,
    NamesOption,
    SetOption,
    WithOption,
    always_loaded,
    bench_of,
    beside_config,
    entries_of,
    registry_of,
    user_files,
)
from bracket_cell.commands.terminal import BAD_INPUT, print_json
from bracket_cell.trees.bench import breakable
from bracket_cell.trees.loading import input_problem, load_tree
from bracket_cell.trees.node_library import node_registry
from bracket_cell.trees.rules import CheckedRules, check_rules, rules_beside
from bracket_ground.errors import InputError, Problem, counted
from btxml.files.check import Circumstances, findings, sound_trees
from btxml.files.compile.registry import Registry
from btxml.views.palette import groot_model, named, palette_list, palette_text


def check(
    files: Annotated[list[Path], typer.Argument(metavar="FILE...", help="Tree files; or robots: URDF or YAML.")],
    config: NamesOption = None,
    no_config: Annotated[
        bool, typer.Option("--no-config", help="Take any name of a part, position, goal or signal.")
    ] = (False),
    own: WithOption = None,
    entries: SetOption = None,
    stubs: Annotated[bool, typer.Option("--stubs", help="Accept unknown nodes, with any ports.")] = False,
    strict: Annotated[bool, typer.Option("--strict", help="Treat warnings and notes as mistakes.")] = False,
    as_json: JsonOption = False,
) -> int:
    """Check tree files and list all mistakes; status 2 for those, 1 for what can hardly be meant.

    Names of parts, positions, goals and signals are those of --config, by default config/cell.yaml of the folder.
    A robot is drawn into checked_NAME.png, with words on its joints, shapes, and what it reaches of that bench.
    """
    config = None if no_config else config or beside_config(files)
    if any(file.suffix != ".xml" for file in files) and (status := _robots(files, config, as_json)) is not None:
        return status
    nodes, beside = user_files(own)
    known = Circumstances(beside, entries_of(entries), stubs)
    levels = findings(files, registry_of(config, nodes), known)
    problems, warnings, notes = ([input_problem(each) for each in level] for level in levels)
    if not problems:
        broken, odd, hints = _of_rules(files, registry_of(config, nodes), known)
        problems, warnings, notes = broken, [*warnings, *odd], [*notes, *hints]
    if config is not None:
        trees = () if problems else sound_trees(files, registry_of(config, nodes), known)
        stuck, odd = bench_of(config, trees)
        problems, warnings = [*problems, *stuck], [*warnings, *odd]
    if strict:
        problems, warnings, notes = [*problems, *warnings, *notes], [], []
    doubtful = bool(warnings) and not stubs
    if as_json:
        levels_shown = {"problems": problems, "warnings": warnings, "notes": notes}
        print_json(
            {key: list(map(_problem_data, found)) for key, found in levels_shown.items() if found or key == "problems"}
        )
        return BAD_INPUT if problems else int(doubtful)
    for level, some in (("warning", warnings), ("note", notes)):
        legal = (f"; {problem.legal}" if problem.legal and level == "warning" else "" for problem in some)
        sys.stderr.writelines(
            f"{problem.place}: {level}: {problem.what}{more}\n" for problem, more in zip(some, legal, strict=True)
        )
    if problems:
        raise InputError(*problems)
    unchecked = "" if config else "; names of parts, positions, goals and signals are checked with --config"
    found = f"{len(warnings)} doubtful" if doubtful else "nothing wrong"
    sys.stderr.write(f"{counted(len(files), 'file')}: {found}{unchecked}\n")
    return int(doubtful)


def _robots(files: list[Path], config: Path | None, as_json: bool) -> int | None:
    """What is to be said of robots, where the files are such."""
    from bracket_cell.runs.robot_view import RobotView, is_robot

    robots = [file for file in files if is_robot(file)]
    if not robots:
        if settings := [str(file) for file in files if file.suffix in {".yaml", ".yml"} and file.is_file()]:
            raise InputError(f"{', '.join(settings)}: no robot; `cell doctor --config FILE` checks a cell")
        return None
    if others := [str(file) for file in files if file not in robots]:
        raise InputError(f"{', '.join(others)}: no robot; check trees and robots one after the other")
    from bracket_cell.commands.show import write
    from bracket_cell.configuration import DEFAULT_CONFIGURATION
    from btxml.views.picture import to_png

    views = [RobotView(file, config or DEFAULT_CONFIGURATION) for file in robots]
    for view in views:
        drawing = Path(f"checked_{view.file.stem}.png")
        if not as_json:
            sys.stdout.writelines(f"{view.file}: {what}\n" for what in (*view.remarks, *view.problems))
            sys.stdout.write(f"{drawing}: the arm at rest\n")
        write(drawing, to_png(view.picture))
    if as_json:
        print_json({str(view.file): {"problems": view.problems, "told": view.remarks} for view in views})
    return int(any(view.problems for view in views))


def _of_rules(files: list[Path], registry: Registry, known: Circumstances) -> CheckedRules:
    """Of the files of rules beside sound tree files: mistakes, what can never be, what can happen, what is unknown."""
    found = CheckedRules([], [], [])
    for file in files:
        if (rules := rules_beside(file)) is not None:
            tree = load_tree(file, registry, None, known.provided, known.beside)
            checked = check_rules(rules, tree)
            able = [] if checked.problems else breakable(file, rules, registry, known)
            for level, told in zip(found, (checked.problems, checked.doubts, [*checked.notes, *able]), strict=True):
                level.extend(told)
    return found


def _problem_data(problem: Problem) -> dict[str, object]:
    place = problem.place
    where = {"file": str(place.file), "line": place.line, "column": place.column}
    return {**where, "what": problem.what, "legal": problem.legal}


class NodeFormat(StrEnum):
    """How the nodes are listed."""

    text = "text"
    json = "json"
    groot = "groot"


def nodes(
    name: Annotated[
        str | None, typer.Argument(metavar="NAME", help="A node's name, or a text in its name or meaning.")
    ] = None,
    style: Annotated[
        NodeFormat, typer.Option("--format", help="text; json for programs; groot: palette for Groot2.")
    ] = NodeFormat.text,
    own: WithOption = None,
) -> None:
    """List the nodes that tree files may name, with their ports; or one of them."""
    registry = node_registry(more=(*user_files(own)[0], *always_loaded()))
    chosen = tuple(registry.classes) if name is None else named(registry, name)
    if style is NodeFormat.text:
        sys.stdout.write(palette_text(registry, chosen))
    elif style is NodeFormat.json:
        sys.stdout.write(json.dumps(palette_list(registry, chosen)) + "\n")
    else:
        sys.stdout.write(groot_model(registry))
