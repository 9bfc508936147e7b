"""JSON lines of labelled data: a header, then a row a line; what is wrong is said with file and line."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any, TypeVar

from cell.errors import InputError, Place, Problem
from cell.files.files import read_text

SEGMENTS_VERSION = 1  # of files of segments that can be read
Row = TypeVar("Row")


def labelled_rows(folder: Path, what: str, made: Callable[[dict[str, Any]], Row]) -> list[Row]:
    """What is made of each row of `cell lab data WHAT`.

    Raises:
        InputError: the file is missing, or a row is wrong; the message names file and line.
    """
    path = folder / f"{what}.jsonl"
    rows = []
    for number, line in enumerate(read_text(path, f"make it with: cell lab data {what} --out DIR").splitlines()[1:], 2):
        try:
            rows.append(made(json.loads(line)))
        except (KeyError, TypeError, ValueError) as error:
            wrong = f"no {error} in it" if isinstance(error, KeyError) else str(error)
            raise InputError(Problem(Place(path, number), f"not a row of `cell lab data {what}`: {wrong}")) from None
    return rows


def segment_rows(path: Path) -> list[tuple[str, dict[str, Any]]]:
    """The lines of a file of segments, as they stand and read, from line 2 on.

    Such files come from recorded runs (`cell log export --to training`) and from `cell lab data actions`.

    Raises:
        InputError: it cannot be read, holds no segments or those of another version, or a line is no JSON object.
    """
    lines = read_text(path).splitlines()
    header = _parsed(path, 1, lines[0]) if lines else {}
    if header.get("format") != "cell.segments":
        how = "make one with: cell log export LOG --to training --out DIR"
        raise InputError(Problem(Place(path, 1), "no file of segments", how))
    if header.get("version") != SEGMENTS_VERSION:
        what = f"segments of version {header.get('version')}"
        raise InputError(Problem(Place(path, 1), what, f"this program reads version {SEGMENTS_VERSION}"))
    return [(line, _parsed(path, number, line)) for number, line in enumerate(lines[1:], start=2)]


def _parsed(path: Path, number: int, line: str) -> dict[str, Any]:
    try:
        found = json.loads(line)
    except ValueError as error:
        raise InputError(Problem(Place(path, number), f"no JSON: {error}")) from error
    if not isinstance(found, dict):
        raise InputError(Problem(Place(path, number), "no object"))
    return found
