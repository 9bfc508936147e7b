"""A new folder that is there whole or not at all: what is written stays apart inside of it until all is there."""

from __future__ import annotations

import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from cell.interfaces.errors import InputError

MANIFEST = "manifest.json"  # comes to its place last: a folder that has one is finished
UNFINISHED = "cell.unfinished"  # a folder in the new one; no other program calls one so, and it may be removed


@contextmanager
def whole_folder(path: Path) -> Iterator[Path]:
    """Where to write what a new folder shall hold; interrupted, nothing of it stays.

    Raises:
        InputError: something is there already, or it cannot be written.
    """
    require_free(path)
    new, partial = not path.exists(), path / UNFINISHED
    try:
        if partial.exists():  # a command was killed
            shutil.rmtree(partial)
        partial.mkdir(parents=True)
    except OSError as error:
        raise InputError(f"{path}: cannot be written: {error.strerror or error}") from None
    try:
        yield partial
        for each in sorted(partial.iterdir(), key=lambda one: one.name == MANIFEST):
            each.rename(path / each.name)
    finally:
        shutil.rmtree(partial, ignore_errors=True)
        if new and not any(path.iterdir()):
            path.rmdir()


def require_free(path: Path) -> None:
    """Check that a new folder can be made, or an empty one filled.

    Raises:
        InputError: something is there already that this program did not leave unfinished.
    """
    if path.exists() and (not path.is_dir() or any(one.name != UNFINISHED for one in path.iterdir())):
        raise InputError(f"{path}: is not an empty folder; remove it, or choose another --out")
