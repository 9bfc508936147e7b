"""Rows of a long evaluation, one line of JSON each, kept as they come: what is in the file is not computed again."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path

from cell.errors import InputError

Row = dict[str, object]
OF = "rows_of"


class RowFile:
    """Rows of one experiment, in a file or in memory only.

    Args:
        path: appended to where it exists; None for no file.
        experiment: what the rows were made with; rows of different ones do not belong together.

    Attributes:
        rows: those of the file, and those that were added.

    Raises:
        InputError: the file holds something else, or cannot be read or written.
    """

    def __init__(self, path: Path | None, experiment: Mapping[str, object]) -> None:
        self.rows: list[Row] = []
        self._path, heading = path, json.loads(json.dumps({OF: dict(experiment)}))
        if path is None:
            return
        try:
            if path.exists() and path.stat().st_size:
                self._read(path, heading)
            else:
                path.parent.mkdir(parents=True, exist_ok=True)
                path.write_text(json.dumps(heading) + "\n")
        except OSError as error:
            raise InputError(f"{path}: cannot keep rows: {error.strerror or error}") from None

    def add(self, row: Row) -> None:
        """A row that is kept from now on.

        Raises:
            InputError: the file cannot be written.
        """
        self.rows.append(row)
        if self._path is None:
            return
        try:
            with self._path.open("a") as file:
                file.write(json.dumps(row) + "\n")
        except OSError as error:
            raise InputError(f"{self._path}: cannot keep rows: {error.strerror or error}") from None

    def _read(self, path: Path, heading: Row) -> None:
        for number, line in enumerate(path.read_text(errors="replace").splitlines(keepends=True), 1):
            try:
                row = json.loads(line)
                if number == 1 and row != heading:
                    raise InputError(f"{path}:1: rows of {row.get(OF)}, not of {heading[OF]}; name another file")
            except (ValueError, AttributeError) as error:
                if number > 1 and not line.endswith("\n"):  # it was cut short in the middle of this row
                    path.write_text("".join(path.read_text().splitlines(keepends=True)[:-1]))
                    return
                raise InputError(f"{path}:{number}: no row of an evaluation: {error}; name another file") from error
            if number > 1:
                self.rows.append(row)
