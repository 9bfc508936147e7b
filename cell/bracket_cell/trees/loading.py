"""Tree files of a cell: mistakes that the engine finds are input errors of the cell."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from bracket_ground.errors import InputError, Place, Problem
from btxml.engine import errors
from btxml.engine.tree import Tree
from btxml.files import loader
from btxml.files.compile.registry import Registry
from btxml.files.parse.in_python import InPython


@contextmanager
def input_errors() -> Iterator[None]:
    """Turn mistakes of tree files into input errors of the cell."""
    try:
        yield
    except errors.TreeFileError as error:
        raise InputError(*(each if isinstance(each, str) else input_problem(each) for each in error.problems)) from None


def load_tree(
    path: Path | InPython,
    registry: Registry,
    main: str | None = None,
    provided: Mapping[str, Any] | None = None,
    beside: Iterable[Path] = (),
) -> Tree:
    """Load a tree file and what it includes; arguments as those of the engine's loader.

    Raises:
        InputError: everything that is wrong, each with its place.
    """
    with input_errors():
        return loader.load_tree(path, registry, main, provided, beside)


def input_problem(problem: errors.Problem) -> Problem:
    """A mistake in a tree file as a problem of the cell's input."""
    place = problem.place
    return Problem(Place(place.file, place.line, place.column), problem.what, problem.legal)
