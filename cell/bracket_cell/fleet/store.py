"""Where results go: a folder, or any address that fsspec knows, such as s3://, gs:// or a share."""

from __future__ import annotations

import shutil
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, nullcontext
from pathlib import Path
from typing import Any

from bracket_cell.packages import needed
from bracket_ground.errors import InputError

EVERY_S = 5.0  # how often rows that are done are copied to an address
AWAY_S = 120.0  # in which a store must be back
LONGEST_PAUSE_S = 8.0
SHARDS = "shards"  # pieces of a table that grows, until it is whole at the end


def is_address(place: str | Path) -> bool:
    """Whether a place is none of this machine's folders."""
    return "://" in str(place)


def put(file: Path, address: str) -> None:
    """Copy a file to an address.

    Raises:
        InputError: nothing can be written there.
    """
    _insisted(address, lambda system, path: system.put_file(str(file), path))


def get(address: str, folder: Path) -> list[Path]:
    """Copy all logs of an address, or the file that it names, into a folder.

    Raises:
        InputError: it cannot be read.
    """
    with _told(address):
        system, path = _system(address)
        found = (
            [path] if system.isfile(path) else [log for log in system.ls(path, detail=False) if log.endswith(".mcap")]
        )
        for name in found:
            system.get_file(name, str(folder / name.rpartition("/")[2]))
    return [folder / name.rpartition("/")[2] for name in found]


@contextmanager
def results_folder(place: str, names: tuple[str, ...]) -> Iterator[tuple[Path, Callable[[], None]]]:
    """A folder to write results to, and what is called when there are more.

    For an address the folder is one here that begins with the files that are there. What is new of a table that grows
    (*.jsonl) goes there as a shard, now and then, and whole files at the end. A store that is away is waited for, and
    the folder stays where it does not come back.

    Args:
        names: of the files.

    Raises:
        InputError: the address cannot be read or written.
    """
    if not is_address(place):
        yield Path(place), lambda: None
        return
    folder, kept = Path(tempfile.mkdtemp(prefix="cell-results-")), False
    try:
        store = _Growing(place, folder, names)
        try:
            yield folder, store.more
        finally:
            kept = any(map(Path.exists, map(folder.joinpath, names)))
            store.end()
            kept = False
    except InputError as error:
        if kept:
            raise InputError(f"{error}; the results are in {folder}") from None
        raise
    finally:
        if not kept:
            shutil.rmtree(folder, ignore_errors=True)


class _Growing:
    """Files at an address that grow there as they grow here."""

    def __init__(self, place: str, folder: Path, names: tuple[str, ...]) -> None:
        self._place, self._folder, self._names = place, folder, names
        self._copied_s, self._sent, self._troubled = time.monotonic(), dict[str, int](), False
        with _told(place):
            system, path = _system(place)
            for file_name in names:
                if system.exists(f"{path}/{file_name}"):
                    system.get_file(f"{path}/{file_name}", str(folder / file_name))
            there = system.find(f"{path}/{SHARDS}") if system.exists(f"{path}/{SHARDS}") else []
            self._shards = sorted(shard for shard in there if shard.endswith(".jsonl"))
            for shard in self._shards:
                with (folder / shard.rpartition("/")[2].partition(".")[2]).open("ab") as file:
                    file.write(system.cat_file(shard))
            written = f"{path}/{SHARDS}/.written"
            try:
                system.pipe_file(written, b"")  # better refused now than after all runs
            except FileNotFoundError:  # a store that has folders
                system.makedirs(f"{path}/{SHARDS}", exist_ok=True)
                system.pipe_file(written, b"")
        self._sent = {name: self._size(name) for name in names}

    def more(self) -> None:
        """Send what is new, now and then; a store that is away gets it later."""
        if time.monotonic() - self._copied_s < EVERY_S:
            return
        self._copied_s = time.monotonic()
        try:
            with _told(self._place):
                system, path = _system(self._place)
                for file_name in (name for name in self._names if name.endswith(".jsonl")):
                    self._send(system, path, file_name)
            self._troubled = False
        except InputError as error:
            if not self._troubled:
                sys.stderr.write(f"cell: {error}; the runs go on, and it is tried again\n")
            self._troubled = True

    def _send(self, system: Any, path: str, name: str) -> None:
        with (self._folder / name).open("rb") if self._size(name) > self._sent[name] else nullcontext() as file:
            if file is not None:
                file.seek(self._sent[name])
                content = file.read()
                shard = f"{path}/{SHARDS}/{len(self._shards):08d}.{name}"
                system.pipe_file(shard, content)
                self._shards.append(shard)
                self._sent[name] += len(content)

    def end(self) -> None:
        """Whole files in the place of shards."""
        for name in self._names:
            if (file := self._folder / name).exists():
                put(file, f"{self._place}/{name}")
        _insisted(f"{self._place}/{SHARDS}", lambda system, path: system.rm(path, recursive=True))

    def _size(self, name: str) -> int:
        file = self._folder / name
        return file.stat().st_size if file.exists() else 0


def _insisted(address: str, work: Callable[[Any, str], object]) -> None:
    """Do it, again and again for a while, as a store may be away.

    Raises:
        InputError: it stays away, or there is none of that kind.
    """
    until_s, pause_s = time.monotonic() + AWAY_S, 1.0
    while True:
        try:
            with _told(address):
                work(*_system(address))
            return
        except InputError:
            if time.monotonic() + pause_s > until_s:
                raise
        time.sleep(pause_s)
        pause_s = min(2 * pause_s, LONGEST_PAUSE_S)


def _system(address: str) -> tuple[Any, str]:
    fsspec = needed("fsspec", f"{address}")
    system, path = fsspec.core.url_to_fs(address)
    return system, path.rstrip("/")


@contextmanager
def _told(address: str) -> Iterator[None]:
    try:
        yield
    except InputError:
        raise
    except Exception as error:  # each kind of store raises what its own library raises
        what = " ".join(str(error).split()) or type(error).__name__
        raise InputError(f"{address}: cannot be used: {what}") from None
