"""Rows of a sweep as they come: a line of JSON each, on the disk at once; nothing that was done is done again."""

from __future__ import annotations

import json
import os
from pathlib import Path
from typing import Any

from cell.interfaces.errors import InputError

Row = dict[str, Any]


class Journal:
    """The rows of a sweep that are there, and a place for more.

    Attributes:
        keys: of the runs that are done.
    """

    def __init__(self, path: Path) -> None:
        """Open or begin it; the half line of a process that was killed is cut off.

        Raises:
            InputError: it cannot be read or written, or holds something else.
        """
        self._path = path
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            self._stream = path.open("a+b")
            self._cut_half_line()
        except OSError as error:
            raise InputError(f"{path}: cannot be used: {error.strerror or error}") from None
        self.keys = {str(row["key"]) for row in self.rows()}

    def rows(self) -> list[Row]:
        """All rows, in the order in which they came."""
        found: list[Row] = []
        for number, line in enumerate(self._path.read_text().splitlines(), 1):
            try:
                row = json.loads(line)
                row["key"]
            except (ValueError, KeyError, TypeError):
                raise InputError(f"{self._path}:{number}: is no row of a sweep") from None
            found.append(row)
        return found

    def add(self, row: Row) -> None:
        """One more row; a run that came twice, as its first worker was lost, is kept once."""
        if row["key"] in self.keys:
            return
        self.keys.add(row["key"])
        self._stream.write(json.dumps(row).encode() + b"\n")
        self._stream.flush()
        os.fsync(self._stream.fileno())

    def close(self) -> None:
        self._stream.close()

    def _cut_half_line(self) -> None:
        content = self._path.read_bytes()
        if content and not content.endswith(b"\n"):
            self._stream.truncate(content.rfind(b"\n") + 1)
