"""What is wrong with tree files, without running them (`cell check FILE...`)."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, NamedTuple

from cell.errors import Problem
from trees.engine.tree import Tree
from trees.files.build.registry import Registry
from trees.files.checks.stubs import with_stubs
from trees.files.loader import build, find_doubts, find_mistakes, in_order, unused_entries
from trees.files.parse.library import read_library


class Findings(NamedTuple):
    """What there is to say about files.

    Attributes:
        problems: mistakes; a file that has any is not run.
        warnings: where nodes are stubs, what is a mistake unless they do what nobody here knows.
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
    """

    beside: tuple[Path, ...] = ()
    provided: Mapping[str, Any] = field(default_factory=dict)
    stubs: bool = False


def check(paths: Iterable[Path], registry: Registry) -> list[Problem]:
    """All problems of all files, in order of place; a file that only others include needs no main tree."""
    return findings(paths, registry).problems


def findings(paths: Iterable[Path], registry: Registry, known: Circumstances | None = None) -> Findings:
    """All that there is to say about all files, in order of place."""
    known = known or Circumstances()
    problems: list[Problem] = []
    warnings: list[Problem] = []
    notes: list[Problem] = []
    built: dict[Path, Tree] = {}
    for path in paths:
        library = read_library(path, known.beside)
        nodes = with_stubs(library, registry) if known.stubs else registry
        mistakes, doubts = find_mistakes(library, nodes), find_doubts(library, nodes)
        if library.main in library.trees and not library.incomplete:
            built[path], between = build(library, nodes, library.main, known.provided)
            doubts = doubts + between
        problems += in_order(mistakes if known.stubs else mistakes + doubts)
        warnings += in_order(doubts if known.stubs else [])
        notes += in_order(library.notes)
    problems += unused_entries(built)
    return Findings(*(list(dict.fromkeys(told)) for told in (problems, warnings, notes)))
