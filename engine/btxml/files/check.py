"""What is wrong with tree files, without running them (`cell check FILE...`)."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from itertools import islice
from pathlib import Path
from typing import Any, NamedTuple

from btxml.engine.errors import Problem
from btxml.engine.node import FAILURE, Control, Node, TreeNode
from btxml.engine.ports import Port
from btxml.engine.status import Status
from btxml.engine.tree import Tree
from btxml.files.checks.meant import check_main, check_meant
from btxml.files.checks.structure import fits
from btxml.files.compile.registry import BUILT_IN, Registry
from btxml.files.loader import built, find_doubts, find_mistakes, in_order, unused_entries
from btxml.files.parse.library import PROBLEM_LIMIT, Library, read_library
from btxml.files.parse.xml_file import Element, node_tag


class Findings(NamedTuple):
    """What there is to say about files.

    Attributes:
        problems: mistakes; a file that has any is not run.
        warnings: what runs and can hardly be meant; where nodes are stubs, what is a mistake unless they do what
            nobody here knows.
        notes: what is ignored here, and means something to editors or other programs.
    """

    problems: list[Problem]
    warnings: list[Problem]
    notes: list[Problem]


@dataclass(frozen=True)
class Circumstances:
    """What is known beside the files.

    Attributes:
        beside: further files, and folders with them, whose trees may be named.
        provided: entries of the main tree that are set before the first tick.
        stubs: unknown nodes are taken as they are.
        opened: texts that an editor has open, by absolute path; they count instead of the files.
    """

    beside: tuple[Path, ...] = ()
    provided: Mapping[str, Any] = field(default_factory=dict)
    stubs: bool = False
    opened: Mapping[Path, str] = field(default_factory=dict)


def check(paths: Iterable[Path], registry: Registry) -> list[Problem]:
    """All problems of all files, in order of place; a file that only others include needs no main tree."""
    return findings(paths, registry).problems


def findings(paths: Iterable[Path], registry: Registry, known: Circumstances | None = None) -> Findings:
    """All that there is to say about all files, in order of place."""
    known = known or Circumstances()
    problems: list[Problem] = []
    warnings: list[Problem] = []
    notes: list[Problem] = []
    trees: dict[Path, Tree] = {}
    libraries = {path: read_library(path, known.beside, known.opened) for path in paths}
    for path, library in libraries.items():
        nodes = with_stubs(library, registry) if known.stubs else registry
        if known.stubs:
            library.notes, library.misnamed = library.notes + library.misnamed, []
        mistakes, doubts = find_mistakes(library, nodes), find_doubts(library, nodes)
        meant: list[Problem] = []
        if library.main in library.trees and not library.incomplete:
            trees[path], between, builder = built(library, nodes, library.main, known.provided)
            doubts = doubts + between
            if not (mistakes or doubts or known.stubs):
                meant += islice(check_meant(builder, library, library.main), PROBLEM_LIMIT)
        problems += in_order(mistakes if known.stubs else mistakes + doubts)
        if not (mistakes or doubts):
            meant += [*library.warnings, *check_main(library, path, libraries.values())]
        warnings += in_order([*(doubts if known.stubs else []), *meant])
        notes += in_order(library.notes)
    problems += unused_entries(trees)
    return Findings(*(list(dict.fromkeys(found)) for found in (problems, warnings, notes)))


def sound_trees(paths: Iterable[Path], registry: Registry, known: Circumstances) -> Iterator[Tree]:
    """The main trees of files in which nothing is wrong; a file that only others include has none."""
    for path in paths:
        library = read_library(path, known.beside, known.opened)
        if library.main in library.trees and not library.incomplete:
            yield built(library, registry, library.main, known.provided).tree


class _AnyPort(Port):
    """Reads and writes any entry, and takes any text."""

    takes_texts = True

    def __init__(self) -> None:
        super().__init__(Any, "nothing is known of this port", optional=True)
        self.unset_ok = True


class _Leaf(Node):
    """A leaf of which nothing is known."""

    @classmethod
    def further_port(cls, name: str) -> Port | None:  # noqa: ARG003
        return _AnyPort()

    def update(self) -> Status:
        return FAILURE


class _Parent(Control):
    """A node with children of which nothing is known."""

    @classmethod
    def further_port(cls, name: str) -> Port | None:  # noqa: ARG003
        return _AnyPort()

    def run(self) -> Status:
        return FAILURE


def with_stubs(library: Library, registry: Registry) -> Registry:
    """The registry with a stand-in for every node of a library that it does not know.

    A node that only has the name of one that stands here, and other ports or values, is not known either; nor is one of
    this cell that has the name of a tree.
    """
    trees = [tag for tag in library.trees if tag in registry.classes and registry.classes[tag] not in BUILT_IN]
    registry = registry.extended((), without=trees) if trees else registry
    parents: dict[str, bool] = {}
    for element in _elements(library):
        tag = node_tag(element)
        if tag and tag != "SubTree" and not fits(element, library, registry):
            parents[tag] = parents.get(tag, False) or bool(element.children)
    stubs = [_stub(tag, _Parent if parent else _Leaf) for tag, parent in parents.items()]
    return registry.extended(stubs) if stubs else registry


def _stub(tag: str, base: type[TreeNode]) -> type[TreeNode]:
    return type("Stub", (base,), {"tag": tag, "children_min": 0, "__doc__": "Stands in for a node that is not here."})


def _elements(library: Library) -> Iterator[Element]:
    waiting = [child for tree in library.trees.values() for child in tree.children]
    while waiting:
        element = waiting.pop()
        waiting += element.children
        yield element
