"""The nodes that tree files of this cell may name: the project's, those of installed packages, and the user's own.

The user's own are what `--with` or the environment variable CELL_NODES names: a file, a folder or a package. Nothing
else of the working folder is imported, as importing runs code.
"""

from __future__ import annotations

import importlib
import importlib.util
import os
import pkgutil
import sys
from collections.abc import Iterable, Iterator, Mapping, Sequence
from importlib.metadata import entry_points
from pathlib import Path
from types import ModuleType
from typing import Any, Protocol

import bracket_cell.trees.nodes.ported  # noqa: F401 - a member of nodes
from bracket_cell.packages import INSTALLED
from bracket_cell.trees import nodes
from bracket_cell.trees.loading import input_errors
from bracket_cell.trees.nodes.poses import FramedPose
from bracket_cell.trees.vocabulary import Goal, Hole, Location, OutputSignal, Part, Signal
from bracket_ground.errors import InputError
from bracket_ground.interfaces.bench import Bench
from bracket_ground.interfaces.memory import PREFIX, Memory
from bracket_ground.interfaces.places import FRAMES
from bracket_ground.interfaces.product import Product
from btxml.engine.node import TreeNode
from btxml.engine.tree import Tree
from btxml.engine.vocabulary import Words
from btxml.files import loader
from btxml.files.compile.registry import Registry
from btxml.files.parse.xml_file import plain_files

ENTRY_POINTS = "cell.nodes"  # a package names a module of its own there
ALWAYS = "CELL_NODES"  # names what is wanted in every command; several with : between them
USUAL_FOLDER = Path("nodes")  # where `cell new` writes


class SignalNames(Protocol):
    """The digital signals of a cell, by name."""

    @property
    def inputs(self) -> Iterable[str]: ...

    @property
    def outputs(self) -> Iterable[str]: ...


class Wiring(Protocol):
    """A configuration, as far as tree files name what is in it."""

    @property
    def signals(self) -> SignalNames | None: ...

    @property
    def nodes(self) -> Iterable[str]: ...

    @property
    def bench(self) -> Bench: ...


def node_registry(
    product: Product | None = None, more: Iterable[str] = (), configuration: Wiring | None = None
) -> Registry:
    """All nodes, by module and in the order of their text.

    Args:
        product: its part types and positions are the only ones that ports may name; None lets any name pass.
        more: files or packages with further nodes.
        configuration: its digital signals and places are the only ones that ports may name; None lets any name pass.
            Its nodes are there, too.

    Raises:
        InputError: a file or package cannot be loaded, or two nodes have one name.
    """
    modules = [*_package(nodes), *_package(nodes.ported), *_installed()]
    always = filter(None, os.environ.get(ALWAYS, "").split(os.pathsep))
    named = [*always, *more, *(() if configuration is None else configuration.nodes)]
    for name in {str(path.resolve()) if (path := Path(name)).exists() else name: None for name in named}:
        modules += _named(name)
    classes = list(dict.fromkeys(node for module in modules for node in _nodes(module)))
    try:
        return Registry(
            classes,
            words={**_things(product, configuration), **_signals(configuration)},
            remark="" if named else _remark(),
            described=nodes.__name__,
            entries={PREFIX + name: value for name, value in Memory().values().items()},
        )
    except ValueError as error:
        raise InputError(str(error)) from None


def own_code(tree: Tree, nodes: Sequence[TreeNode] | None = None) -> list[Path]:
    """Python files of the tree's nodes that are the user's own; those of the project are named by the commit.

    Args:
        nodes: some of them; by default all.
    """
    members = [member for node in (tree.nodes if nodes is None else nodes) for member in vars(type(node)).values()]
    files = {Path(member.__code__.co_filename).resolve() for member in members if hasattr(member, "__code__")}
    here = Path.cwd() / USUAL_FOLDER
    return sorted(
        file for file in files if file.is_file() and (not file.is_relative_to(INSTALLED) or file.is_relative_to(here))
    )


def tree(
    root: TreeNode,
    name: str = "Main",
    trees: Mapping[str, TreeNode] | None = None,
    registry: Registry | None = None,
    provided: Mapping[str, Any] | None = None,
    beside: Iterable[Path] = (),
) -> Tree:
    """A tree that is written in Python, checked as if it stood in a file.

    Args:
        root: its topmost node; as all nodes it only says what is wanted, and may be used again.
        name: of the tree.
        trees: further trees by name, for SubTrees: `SubTree(ID="Fetch", part="o1")`.
        registry: the nodes that files may name; those of the cell by default.
        provided: entries of the main tree that are set before the first tick.
        beside: tree files, and folders with them, whose trees may be called, too.

    Raises:
        InputError: everything that is wrong, each with its line of Python.
    """
    with input_errors():
        return loader.tree(root, name, trees, registry or node_registry(), provided, beside)


def _things(product: Product | None, configuration: Wiring | None) -> Words:
    places = () if configuration is None else tuple(configuration.bench.places)
    named: Words = {} if configuration is None else {Location: places}
    if product is None:
        return named
    frames = (*FRAMES, *product.positions, *places)
    things = {Part: tuple(product.parts), Hole: product.positions, Goal: tuple(product.goals), FramedPose: frames}
    return {**named, **things}


def _signals(configuration: Wiring | None) -> Words:
    if configuration is None:
        return {}
    module = configuration.signals
    inputs, outputs = (tuple(module.inputs), tuple(module.outputs)) if module is not None else ((), ())
    return {Signal: (*inputs, *outputs), OutputSignal: outputs}


def _nodes(module: ModuleType) -> Iterator[type[TreeNode]]:
    """The node classes that a module defines: leaves, controls and decorators, but no bases."""
    for member in vars(module).values():
        if not isinstance(member, type) or member.__module__ != module.__name__ or not issubclass(member, TreeNode):
            continue
        if not vars(member).get("abstract") and not member.__name__.startswith("_"):
            yield member


def _package(package: ModuleType) -> Iterator[ModuleType]:
    """A package's modules; a module alone is itself."""
    if not hasattr(package, "__path__"):
        yield package
        return
    yield package
    for info in pkgutil.iter_modules(package.__path__):
        yield importlib.import_module(f"{package.__name__}.{info.name}")


def _installed() -> Iterator[ModuleType]:
    for point in entry_points(group=ENTRY_POINTS):
        yield from _imported(point.value)


def _remark() -> str:
    """What to say of an unknown node, if the user's own nodes were not loaded."""
    here = bool(plain_files(USUAL_FOLDER, "*.py"))
    way = f"add --with {USUAL_FOLDER}, or nodes: [{USUAL_FOLDER}] to the configuration"
    return f"{USUAL_FOLDER}/ is not loaded: {way}" if here else ""


def python_files(name: str) -> list[Path]:
    """The files that a name of nodes stands for; none for a package."""
    if Path(name).is_dir():
        return [file for file in plain_files(Path(name), "*.py") if file.name != "__init__.py"]
    return [Path(name)] if name.endswith(".py") or Path(name).is_file() else []


def _named(name: str) -> Iterator[ModuleType]:
    if Path(name).is_dir() or python_files(name):
        yield from map(_file, python_files(name))
    elif "/" in name or name.startswith("."):
        raise InputError(f"nodes {name!r}: there is no such file or folder, seen from the configuration or its parent")
    else:
        yield from _imported(name)


def _imported(name: str) -> Iterator[ModuleType]:
    try:
        yield from _package(importlib.import_module(name))
    except (Exception, SystemExit) as error:  # a module of a user may raise anything, or end the program
        raise InputError(f"nodes of {name!r} cannot be loaded: {type(error).__name__}: {error}") from error


def _file(file: Path) -> ModuleType:
    """A module of its own; its name holds the path, so that two files may have one name."""
    spec = importlib.util.spec_from_file_location(f"cell_nodes_{file.resolve().as_posix()}", file)
    if spec is None or spec.loader is None or not file.is_file():
        raise InputError(f"{file}: there is no such Python file; give FILE.py or the name of a package")
    module = sys.modules[spec.name] = importlib.util.module_from_spec(spec)
    try:
        spec.loader.exec_module(module)
    except (Exception, SystemExit) as error:  # the user's file may raise anything, or end the program
        raise InputError(f"{file} cannot be loaded: {type(error).__name__}: {error}") from error
    return module
