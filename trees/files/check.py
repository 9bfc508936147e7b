"""What is wrong with tree files, without running them (`cell check FILE...`)."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

from cell.interfaces.errors import Problem
from trees.files.library import read_library
from trees.files.loader import build, find_problems, in_order
from trees.files.registry import Registry


def check(paths: Iterable[Path], registry: Registry) -> list[Problem]:
    """All problems of all files, in order of place; a file that only others include needs no main tree."""
    problems: list[Problem] = []
    for path in paths:
        library = read_library(path)
        found = find_problems(library, registry)
        if library.main and not library.incomplete:
            found = found + build(library, registry, library.main, {})[1]
        problems += in_order(found)
    return list(dict.fromkeys(problems))
