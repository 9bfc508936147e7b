"""Rows of a sweep as they come: a line of JSON each, on the disk at once; nothing that was done is done again."""

from __future__ import annotations

import json
import os
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any

from cell.errors import InputError

Row = dict[str, Any]


class Journal:
    """The rows of a sweep that are there, and a place for more; in memory are only their keys.

    Attributes:
        keys: of the runs that are done, and at which byte of the file the row of each begins.
    """

    def __init__(self, path: Path) -> None:
        """Open or begin it; the half line of a process that was killed is cut off.

        Raises:
            InputError: it cannot be read or written, or holds something else.
        """
        self._path = path
        self.keys: dict[str, int] = {}
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            self._stream = path.open("a+b")
            self._read_keys()
        except OSError as error:
            raise InputError(f"{path}: cannot be used: {error.strerror or error}") from None

    def rows(self, keys: Iterable[str] | None = None) -> Rows:
        """Rows in the order of these keys, or all as they came; gone through anew each time."""
        return Rows(self._path, [self.keys[key] for key in (self.keys if keys is None else keys)])

    def add(self, row: Row) -> None:
        """One more row; a run that came twice, as its first worker was lost, is kept once."""
        if row["key"] in self.keys:
            return
        self.keys[row["key"]] = self._stream.seek(0, os.SEEK_END)
        self._stream.write(json.dumps(row).encode() + b"\n")
        self._stream.flush()
        os.fsync(self._stream.fileno())

    def close(self) -> None:
        self._stream.close()

    def _read_keys(self) -> None:
        at = 0
        with self._path.open("rb") as stream:
            for number, line in enumerate(stream, 1):
                if not line.endswith(b"\n"):
                    break
                try:
                    self.keys.setdefault(str(json.loads(line)["key"]), at)
                except (ValueError, KeyError, TypeError):
                    raise InputError(f"{self._path}:{number}: is no row of a sweep") from None
                at += len(line)
        self._stream.truncate(at)


class Rows:
    """Rows of a journal, one at a time."""

    def __init__(self, path: Path, offsets: list[int]) -> None:
        self._path, self._offsets = path, offsets

    def __iter__(self) -> Iterator[Row]:
        with self._path.open("rb") as stream:
            for offset in self._offsets:
                stream.seek(offset)
                row: Row = json.loads(stream.readline())
                yield row
