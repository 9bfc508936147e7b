"""Rows of many runs, a line of JSON each, on the disk as they come: what is there is not done again."""

from __future__ import annotations

import errno
import fcntl
import io
import json
import os
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import AbstractContextManager, contextmanager
from dataclasses import dataclass
from pathlib import Path
from threading import Lock
from typing import Any, BinaryIO
from weakref import WeakValueDictionary, finalize

from bracket_ground.errors import InputError

Row = dict[str, Any]
OF = "rows_of"
SHORT = 80  # letters of what differs
NO_LOCKS = (errno.ENOLCK, errno.EOPNOTSUPP)  # a share that knows none


class _Lock:
    """An open file, which is closed with the last store of it; only the first of a process needs to lock it."""

    def __init__(self, handle: int) -> None:
        self.handle = handle
        finalize(self, os.close, handle)


_locks: WeakValueDictionary[Path, _Lock] = WeakValueDictionary()


@dataclass(frozen=True)
class Rows:
    """Rows of a store, one at a time in memory; gone through anew each time."""

    opened: Callable[[str], AbstractContextManager[BinaryIO]]
    offsets: Sequence[int]

    def __iter__(self) -> Iterator[Row]:
        with self.opened("rb") as stream:
            for offset in self.offsets:
                stream.seek(offset)
                yield json.loads(stream.readline())


class RowStore:
    """Rows in a file, or in memory where no file is named; of a file only the keys are in memory.

    Args:
        path: made where it is not there; the half line of a process that was killed is cut off. None for no file.
        by: names of the fields that make up a row's key; a field that a row lacks counts as None.
        of: what the rows are made with; a file that says something else is refused. None for a file without a heading.

    Attributes:
        keys: of the rows that are there, a value, or a tuple where `by` names several fields, and at which byte each
            row begins.

    Raises:
        InputError: the file holds something else, cannot be read or written, or another process adds rows to it.
    """

    def __init__(self, path: Path | None, by: Sequence[str], of: Mapping[str, object] | None = None) -> None:
        self.keys: dict[Any, int] = {}
        self._path, self._by, self._memory, self._lock = path, tuple(by), io.BytesIO(), Lock()
        heading = b"" if of is None else json.dumps({OF: dict(of)}).encode() + b"\n"
        self._lock_of_file = self._alone()
        with self.opened("a+b") as stream:
            whole = self._read(stream, heading)
            stream.truncate(whole)
            if not whole:
                stream.write(heading)

    def __contains__(self, key: object) -> bool:
        return key in self.keys

    def __getitem__(self, key: object) -> Row:
        return next(iter(self.rows_of([key])))

    @property
    def rows(self) -> list[Row]:
        """All rows, in the order in which they came."""
        return list(self.rows_of(self.keys))

    def rows_of(self, keys: Iterable[object]) -> Rows:
        """The rows of these keys."""
        return Rows(self.opened, [self.keys[key] for key in keys])

    def add(self, row: Mapping[str, Any]) -> None:
        """One more row; one whose key is there already is not kept twice.

        Raises:
            InputError: the file cannot be written.
        """
        with self._lock, self.opened("ab") as stream:
            if (key := self._key(row)) in self.keys:
                return
            self.keys[key] = stream.seek(0, os.SEEK_END)
            stream.write(json.dumps(row).encode() + b"\n")
            stream.flush()
            if self._path is not None:
                os.fsync(stream.fileno())

    @contextmanager
    def opened(self, mode: str) -> Iterator[BinaryIO]:
        """The file, for a while.

        Raises:
            InputError: it cannot be opened, read or written.
        """
        if self._path is None:
            yield self._memory
            return
        try:
            self._path.parent.mkdir(parents=True, exist_ok=True)
            with self._path.open(mode) as stream:
                yield stream  # type: ignore[misc]
        except OSError as error:
            why = (
                "what should be its folder is a file" if isinstance(error, FileExistsError) else error.strerror or error
            )
            raise InputError(f"{self._path}: cannot keep rows: {why}") from None

    def _alone(self) -> _Lock | None:
        """The file's lock, for as long as the store lives: two that add rows would each do all that is left."""
        if self._path is None:
            return None
        path = self._path.resolve()
        if (own := _locks.get(path)) is not None:
            return own
        with self.opened("ab") as stream:
            lock = _Lock(os.dup(stream.fileno()))
        try:
            fcntl.flock(lock.handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            why = "another process adds rows to it: wait for that one, or name another file"
            raise InputError(f"{self._path}: {why}") from None
        except OSError as error:
            if error.errno not in NO_LOCKS:
                raise InputError(f"{self._path}: cannot keep rows: {error.strerror or error}") from None
        _locks[path] = lock
        return lock

    def _read(self, stream: BinaryIO, heading: bytes) -> int:
        """Notes where each row begins; returns where the whole lines end."""
        at = stream.seek(0)
        begin = heading or b'{"'
        for number, line in enumerate(stream, 1):
            if not line.endswith(b"\n") and (number > 1 or begin.startswith(line[: len(begin)])):
                break  # it was cut short in the middle of this line
            try:
                row = json.loads(line)
                if heading and number == 1:
                    self._require(row.get(OF), json.loads(heading)[OF])
                else:
                    self.keys.setdefault(self._key(row), at)
            except (ValueError, AttributeError, KeyError, TypeError):
                what = f"no row of {' and '.join(self._by)}; name another file"
                raise InputError(f"{self._path}:{number}: {what}") from None
            at += len(line)
        return at

    def _require(self, found: object, wanted: Row) -> None:
        """What differs is named, with its values where they are short."""
        if found != wanted:
            there = found if isinstance(found, dict) else {}
            names = [name for name in wanted | there if there.get(name) != wanted.get(name)]
            pairs = {name: f"{name} {there.get(name, 'unknown')}, not {wanted.get(name, 'unknown')}" for name in names}
            what = "; ".join(text if len(text) < SHORT else f"other {name}" for name, text in pairs.items())
            raise InputError(f"{self._path}:1: rows of {what}; name another file")

    def _key(self, row: Mapping[str, Any]) -> Any:
        """Raises: KeyError: it is no row of this store."""
        if not any(name in row for name in self._by):
            raise KeyError(self._by)
        key = tuple(row.get(name) for name in self._by)
        return key if len(key) > 1 else key[0]
