"""Options of the command line: those that commands share, and records of options from which signatures are made."""

from __future__ import annotations

import inspect
import os
import re
from collections.abc import Callable, Iterable, Mapping
from dataclasses import MISSING, fields
from functools import partial
from pathlib import Path
from tempfile import TemporaryFile
from typing import TYPE_CHECKING, Annotated, Any, get_type_hints

import typer

from bracket_ground.errors import InputError, Problem
from bracket_ground.files.files import read_text, shipped, user_or_packaged

if TYPE_CHECKING:
    from btxml.engine.tree import Tree
    from btxml.files.compile.registry import Registry

CONFIGURATION = user_or_packaged("bracket_cell.config", "cell.yaml")
OWN_CONFIGURATION = Path("config/cell.yaml")
MONITOR_PORT, LIVE_PORT, PAGE_PORT = 1667, 8765, 8780
_NAME = re.compile(r"[^\W\d][\w./-]*\Z")  # of an entry
_ADDRESS = re.compile(r"(\S*:)?[\d.]+\Z|[^\s/]+:[^\s/.]*\Z")  # also HOST: before what is no port
USUAL = {"--page": PAGE_PORT, "--real-time": 1, "--running": MONITOR_PORT}  # values of options that may stand alone
DOORS = {"monitor": MONITOR_PORT, "breakpoints": MONITOR_PORT, "debugger": MONITOR_PORT, "live": LIVE_PORT}

CONFIG_HELP = "Configuration file of the cell."
OUT_HELP = "File or folder to write."
ROS2_HELP = "Topics of ROS 2: those of a bag, or the simulated cell as the drivers of a UR and a RealSense name them."
HtmlOption = Annotated[Path | None, typer.Option("--html", help="Write an HTML page, too.")]
ConfigOption = Annotated[Path, typer.Option("--config", help=CONFIG_HELP)]
NamesOption = Annotated[Path | None, typer.Option("--config", help=CONFIG_HELP)]
SeedOption = Annotated[int, typer.Option("--seed", min=0, help="Random seed: the same seed gives the same run.")]
JsonOption = Annotated[bool, typer.Option("--json", help="Print the answer as one line of JSON.")]
SlowerOption = Annotated[
    float,
    typer.Option("--slower", min=1, max=50, help="Run N times slower than real time; `cell twin` takes the same N."),
]
OpenOption = Annotated[
    list[str] | None,
    typer.Option(
        "--open",
        metavar="DOOR[=PORT]",
        help=r"Let others watch; may be repeated. monitor: Groot2, `cell show --running`; breakpoints: these may stop "
        r"nodes and override them, too; debugger: the run begins when these look; live: Foxglove.",
    ),
]
OverwriteOption = Annotated[bool, typer.Option("--overwrite", help="Replace files that exist.")]
WorkersOption = Annotated[
    int, typer.Option("--workers", min=1, help=r"Processes on this machine; more than 1 needs cell\[fleet].")
]
SchedulerOption = Annotated[
    str | None, typer.Option("--scheduler", help="Address of a Dask scheduler, like tcp://host:8786.")
]
LookOption = Annotated[
    str, typer.Option("--look", help="Look of the simulation: nominal, varied, hard, PRESET:SECTION or a look file.")
]
PersonOption = Annotated[
    str, typer.Option("--person", help="The simulated person: a name of `cell docs people`, or a YAML file.")
]
SeedsOption = Annotated[
    str,
    typer.Option(
        "--seeds",
        metavar="FIRST:END",
        help="Seeds, one for each recording: below 800000 for training, below 900000 for validation, then for tests.",
    ),
]
WithOption = Annotated[
    list[str] | None,
    typer.Option(
        "--with",
        metavar="PATH",
        help="Nodes or trees of your own: a Python file or package, a tree file, or a folder; may be repeated. "
        "CELL_NODES names nodes for every command.",
    ),
]
SetOption = Annotated[
    list[str] | None,
    typer.Option(
        "--set",
        metavar="NAME=VALUE",
        help="Set an entry of the main tree's blackboard, or name a YAML file with several.",
    ),
]


def command_from(record: type, *names: str, **defaults: Any) -> Callable[[Callable[..., Any]], Callable[..., Any]]:
    """Make a command of a function whose first argument is a record of options.

    Each field's annotation says how the option is named and explained; this is its only declaration.

    Args:
        record: a dataclass.
        names: of its fields that this command has as options, in this order.
        defaults: of these options, where the record's are not meant.
    """

    def made(function: Callable[..., Any]) -> Callable[..., Any]:
        bound = function.keywords if isinstance(function, partial) else {}
        every = list(inspect.signature(function, eval_str=True).parameters.values())[1:]
        own = [parameter for parameter in every if parameter.name not in bound]
        hints, given = (
            get_type_hints(record, include_extras=True),
            {field.name: field.default for field in fields(record)},
        )
        shared = [
            inspect.Parameter(
                name,
                inspect.Parameter.KEYWORD_ONLY,
                default=defaults.get(name, inspect.Parameter.empty if given[name] is MISSING else given[name]),
                annotation=hints[name],
            )
            for name in names
        ]

        def command(**values: Any) -> Any:
            return function(record(**{name: values.pop(name) for name in names}), **values)

        parameters = [parameter.replace(kind=inspect.Parameter.KEYWORD_ONLY) for parameter in own] + shared
        command.__signature__ = inspect.Signature(parameters)  # type: ignore[attr-defined]
        command.__annotations__ = {parameter.name: parameter.annotation for parameter in parameters}
        command.__name__, command.__doc__ = getattr(function, "__name__", "command"), function.__doc__
        return command

    return made


def words_of(record: object, names: Iterable[str]) -> list[str]:
    """The options that a record was made from, to be typed again: those that differ from their defaults."""
    hints = get_type_hints(type(record), include_extras=True)
    given = {field.name: field.default for field in fields(record)}  # type: ignore[arg-type]
    words = []
    for name in names:
        value = getattr(record, name)
        (option,) = hints[name].__metadata__
        declared = [
            param_decl
            for param_decl in (option.default, *(option.param_decls or ()))
            if str(param_decl).startswith("--")
        ]
        typed = next(iter(declared), f"--{name.replace('_', '-')}")  # typer takes the first one for a default
        if value != given[name]:
            words += [typed] if value is True else [typed, str(value)]
    return words


def seeds_of(text: str) -> range:
    """Seeds of "900000:900020", or of one number.

    Raises:
        InputError: it is written otherwise, or holds none.
    """
    first, sign, end = text.partition(":")
    if not first.isdecimal() or (sign and not (end.isdecimal() and int(end) > int(first))):
        raise InputError(f"--seeds {text}: must be FIRST:END with END above FIRST, as 900000:900020, or one number")
    return range(int(first), int(end) if sign else int(first) + 1)


def with_usual(words: Iterable[str]) -> list[str]:
    """The words of a command, with the usual value where an option has none: `--page` is `--page=8780`."""
    given = list(words)
    following = [*given[1:], ""]
    return [
        f"{word}={USUAL[word]}" if word in USUAL and not _ADDRESS.match(after) else word
        for word, after in zip(given, following, strict=True)
    ]


def doors_of(given: Iterable[str] | None) -> dict[str, Any]:
    """Fields of a run's options for what `--open` names.

    Raises:
        InputError: there is no such door, or what follows it is no port.
    """
    opened: dict[str, Any] = {}
    for each in given or ():
        door, _, at = each.partition("=")
        if door not in DOORS:
            raise InputError(f"--open {each}: there is no door {door!r}; legal: {', '.join(DOORS)}")
        at = at or str(DOORS[door])
        if not (at.isdecimal() and 0 <= int(at) < 65535):
            raise InputError(f"--open {each}: {at!r} is no port; legal: 0 to 65534")
        opened["live_port" if door == "live" else "monitor_port"] = int(at)
        if door in ("breakpoints", "debugger"):
            opened["monitor_hooks"] = True
        if door == "debugger":
            opened["await_monitor"] = True
    return opened


def user_files(given: Iterable[str] | None) -> tuple[tuple[str, ...], tuple[Path, ...]]:
    """What `--with` names: files, folders and packages with nodes, and tree files and folders with them."""
    nodes, trees = list[str](), list[Path]()
    for text in given or ():
        path = Path(text)
        holds_trees = path.suffix == ".xml" or (path.is_dir() and any(path.glob("*.xml")))
        if holds_trees:
            trees.append(path)
        if not holds_trees or (path.is_dir() and any(path.glob("*.py"))):
            nodes.append(text)
    return tuple(nodes), tuple(trees)


def beside_config(files: Iterable[Path] = ()) -> Path | None:
    """The configuration of the folder in which the command is called; None where there is none.

    Args:
        files: that must lie in this folder for it to count.
    """
    within = all(file.resolve().is_relative_to(Path.cwd()) for file in files)
    return OWN_CONFIGURATION if within and OWN_CONFIGURATION.is_file() else None


def always_loaded() -> tuple[str, ...]:
    """Nodes that the configuration of this folder names, for commands that read no more of it."""
    from bracket_cell.configuration import nodes_from
    from bracket_ground.files.yaml_file import read_data

    if (config := beside_config()) is None:
        return ()
    try:
        names = read_data(config, read_text(config)).get("nodes") or ()
    except (InputError, AttributeError):
        return ()  # who loads it says what is wrong
    return nodes_from(map(str, names), config.parent)


def registry_of(config: Path | None, own_nodes: Iterable[str]) -> Registry:
    """The nodes that there are; with a configuration, ports take only names that it has."""
    from bracket_cell.trees.node_library import node_registry

    if config is None:
        return node_registry(more=own_nodes)
    from bracket_cell.configuration import load_configuration, load_product

    configuration = load_configuration(config)
    return node_registry(load_product(configuration, config), own_nodes, configuration)


def bench_of(config: Path, trees: Iterable[Tree]) -> tuple[list[Problem], list[Problem]]:
    """What a run of trees would not begin with on the bench of a configuration, and what is doubtful there."""
    from bracket_cell.configuration import load_configuration, load_product
    from bracket_cell.skills.motion.planner import MotionPlanner
    from bracket_cell.wiring.bench_checks import bench_problems, never_reached
    from bracket_ground.files.yaml_file import place_of

    configuration = load_configuration(config)
    product = load_product(configuration, config)
    found = bench_problems(configuration, product)
    stuck, doubtful = ([Problem(place_of(config, where), what) for where, what in some] for some in found)
    motion = MotionPlanner(product, configuration.bench, configuration.motion)
    return [*stuck, *(problem for tree in trees for problem in never_reached(motion, tree))], doubtful


def entries_of(given: Iterable[str] | None) -> dict[str, Any]:
    """Values of `--set` by entry; a number where it reads as one, else a text.

    Raises:
        InputError: one is neither NAME=VALUE nor a YAML file of such.
    """
    entries: dict[str, Any] = {}
    for entry in given or ():
        name, sign, value = entry.partition("=")
        if sign:
            entries[_checked(name, entry)] = _value(value)
        else:
            entries |= {_checked(str(key), entry): _plain(value, entry) for key, value in _file(Path(entry)).items()}
    return entries


def _value(text: str) -> Any:
    from btxml.engine.literals import constant

    return constant(text)


def _checked(name: str, given: str) -> str:
    if not _NAME.match(name):
        raise InputError(f"--set {given}: {name!r} is not the name of an entry; like part=o2")
    return name


def _plain(value: object, given: str) -> object:
    simple = bool | int | float | str
    if isinstance(value, simple) or (isinstance(value, list) and all(isinstance(item, simple) for item in value)):
        return value
    raise InputError(f"--set {given}: entries are numbers, texts, true, false and lists of these, not {value!r}")


def _file(path: Path) -> Mapping[Any, Any]:
    from bracket_ground.files.yaml_file import read_data

    try:
        content = read_data(path, read_text(path))
    except InputError as error:
        raise InputError(f"--set: neither NAME=VALUE nor a YAML file that can be read: {error}") from None
    if not isinstance(content, dict):
        raise InputError(f"--set {path}: the file must hold names and values, like part: o2")
    return content


def folder_for(config: Path) -> Path:
    """Where what is learned for a configuration goes: beside it; for the shipped one, into the working folder."""
    return Path() if config.resolve() == shipped("bracket_cell.config", "cell.yaml").resolve() else config.parent


def writable(path: Path, *suffixes: str, option: str = "--out") -> Path:
    """The file, in which something can be written; told before work that takes minutes or hours, not after it.

    Raises:
        InputError: it is a folder, its name ends in something else, or no file can be made there.
    """
    if path.suffix not in suffixes:
        raise InputError(f"{option} {path}: must end in {' or '.join(suffixes)}")
    if path.is_dir():
        raise InputError(f"{option} {path}: is a folder; name a file")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        with TemporaryFile(dir=path.parent):
            pass
    except OSError as error:
        raise InputError(f"{option} {path}: cannot be written: {error.strerror or error}") from None
    return path


def told_in(config: Path, path: Path) -> Path:
    """A file or folder as a configuration names it: relative to the configuration's own folder."""
    return Path(os.path.relpath(path.resolve(), config.resolve().parent))
