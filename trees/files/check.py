"""What is wrong with tree files, without running them (`cell check FILE...`)."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path
from typing import NamedTuple

from cell.interfaces.errors import Problem
from trees.files.library import read_library
from trees.files.loader import build, find_problems, in_order
from trees.files.registry import Registry


class Findings(NamedTuple):
    """What there is to say about files.

    Attributes:
        problems: mistakes; a file that has any is not run.
        notes: what is ignored here, and means something to editors or other programs.
    """

    problems: list[Problem]
    notes: list[Problem]


def check(paths: Iterable[Path], registry: Registry) -> list[Problem]:
    """All problems of all files, in order of place; a file that only others include needs no main tree."""
    return findings(paths, registry).problems


def findings(paths: Iterable[Path], registry: Registry) -> Findings:
    """All problems and notes of all files, in order of place."""
    problems: list[Problem] = []
    notes: list[Problem] = []
    for path in paths:
        library = read_library(path)
        found = find_problems(library, registry)
        if library.main and not library.incomplete:
            found = found + build(library, registry, library.main, {})[1]
        problems += in_order(found)
        notes += in_order(library.notes)
    return Findings(list(dict.fromkeys(problems)), list(dict.fromkeys(notes)))
