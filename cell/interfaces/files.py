"""Where files are: those that come with the program, and the user's own in the working folder."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from importlib import resources
from pathlib import Path

from cell.interfaces.errors import InputError, Place, Problem

INSTALLED = Path(str(resources.files("cell"))).parent  # all packages stand side by side, in a clone and when installed


def shipped(package: str, *names: str) -> Path:
    """A file or folder that is installed with a package, as in `shipped("config", "gripper.dbc")`.

    The package is not imported for it: the user's own folders `config` and `trees` may come first where Python looks.
    """
    return INSTALLED.joinpath(*package.split("."), *names)


def own_or_shipped(package: str, *names: str) -> Path:
    """The first file of these names in the working folder's `package`, else the first that comes with the program."""
    own = (Path.cwd() / package / name for name in names)
    return next((file for file in own if file.is_file()), shipped(package, names[0]))


def read_text(path: Path, how_to_make: str = "") -> str:
    """The text of a file.

    Args:
        how_to_make: what to type where there is none, for the message.

    Raises:
        InputError: it cannot be read, or is no text.
    """
    try:
        return path.read_text(encoding="utf-8")
    except OSError as error:
        raise InputError(Problem(Place(path), f"cannot be read: {error.strerror or error}", how_to_make)) from None
    except UnicodeDecodeError as error:
        raise InputError(Problem(Place(path), f"is not UTF-8 text (byte {error.start})", how_to_make)) from None


@contextmanager
def whole_or_none(path: Path) -> Iterator[Path]:
    """Where to write a file so that it is there whole or not at all: beside it, and it takes its place at the end.

    What stood there stays until then. A device such as /dev/stdout is written to as it is.
    """
    target = path.resolve()
    if target.exists() and not target.is_file():
        yield path
        return
    partial = target.with_name(f"{target.stem}.partial{target.suffix}")
    try:
        yield partial
        partial.replace(target)
    finally:
        partial.unlink(missing_ok=True)
