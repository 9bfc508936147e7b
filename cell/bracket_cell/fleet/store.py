"""Where results go: a folder, or any address that fsspec knows, such as s3://, gs:// or a share."""

from __future__ import annotations

import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from bracket_cell.packages import needed
from bracket_ground.errors import InputError

EVERY_S = 5.0  # how often rows that are done are copied to an address


def is_address(place: str | Path) -> bool:
    """Whether a place is none of this machine's folders."""
    return "://" in str(place)


def put(file: Path, address: str) -> None:
    """Copy a file to an address.

    Raises:
        InputError: nothing can be written there.
    """
    with _told(address):
        system, path = _system(address)
        system.put_file(str(file), path)


def get(address: str, folder: Path) -> list[Path]:
    """Copy all logs of an address, or the file that it names, into a folder.

    Raises:
        InputError: it cannot be read.
    """
    with _told(address):
        system, path = _system(address)
        found = (
            [path] if system.isfile(path) else [one for one in system.ls(path, detail=False) if one.endswith(".mcap")]
        )
        for one in found:
            system.get_file(one, str(folder / one.rpartition("/")[2]))
    return [folder / one.rpartition("/")[2] for one in found]


@contextmanager
def results_folder(place: str, names: tuple[str, ...]) -> Iterator[tuple[Path, Callable[[], None]]]:
    """A folder to write results to, and what is called when there are more.

    For an address the folder is one here that begins with the files that are there and is copied back: now and then,
    and at the end.

    Args:
        names: of the files.

    Raises:
        InputError: the address cannot be read or written.
    """
    if not is_address(place):
        yield Path(place), lambda: None
        return
    with tempfile.TemporaryDirectory(prefix="cell-results-") as name:
        folder, copied_s = Path(name), time.monotonic()
        with _told(place):
            system, path = _system(place)
            for one in names:
                if system.exists(f"{path}/{one}"):
                    system.get_file(f"{path}/{one}", str(folder / one))
            system.pipe_file(f"{path}/.written", b"")  # better refused now than after all runs

        def copy() -> None:
            with _told(place):
                for one in names:
                    if (folder / one).exists():
                        system.put_file(str(folder / one), f"{path}/{one}")

        def more() -> None:
            nonlocal copied_s
            if time.monotonic() - copied_s > EVERY_S:
                copied_s = time.monotonic()
                copy()

        try:
            yield folder, more
        finally:
            copy()


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
