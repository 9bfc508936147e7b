"""Where files are: those that come with the program, and the user's own in the working folder."""

from __future__ import annotations

import errno
import math
import shutil
import stat
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from importlib import resources
from pathlib import Path

from bracket_ground.errors import InputError, Place, Problem

MANIFEST = "manifest.json"  # comes to its place last: a folder that has one is finished
UNFINISHED = "cell.unfinished"  # a folder in the new one; no other program calls one so, and it may be removed
TEXT_BYTES = 500_000_000  # labels of many thousand pictures have less


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
        for each in sorted(partial.iterdir(), key=lambda file: file.name == MANIFEST):
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
    if path.exists() and (not path.is_dir() or any(entry.name != UNFINISHED for entry in path.iterdir())):
        raise InputError(f"{path}: is not an empty folder; remove it, or choose another --out")


def shipped(package: str, *names: str) -> Path:
    """A file or folder that is installed with a package, as in `shipped("bracket_cell.config", "gripper.dbc")`."""
    top, *rest = package.split(".")
    return Path(str(resources.files(top))).joinpath(*rest, *names)


def user_or_packaged(package: str, *names: str) -> Path:
    """The first file of these names in the working folder's `config` or `trees`, else the first that is shipped.

    Args:
        package: of the shipped files; its last name is that of the user's folder.
    """
    own = (Path.cwd() / package.rpartition(".")[2] / name for name in names)
    return next((file for file in own if file.is_file()), shipped(package, names[0]))


def regular(path: Path, most_bytes: float = math.inf) -> Path:
    """The path of a file that can be read to its end: a pipe waits for its writer, a device may have no end.

    Raises:
        OSError: there is none, it is something else, or it is larger than that.
    """
    status = path.stat()
    if not stat.S_ISREG(status.st_mode):
        raise OSError(errno.EINVAL, "this is not a file")
    if status.st_size > most_bytes:
        raise OSError(errno.EFBIG, f"{status.st_size} bytes are too many, at most {most_bytes}")
    return path


def read_text(path: Path, how_to_make: str = "") -> str:
    """The text of a file.

    Args:
        how_to_make: what to type where there is none, for the message.

    Raises:
        InputError: it cannot be read, or is no text.
    """
    try:
        return regular(path, TEXT_BYTES).read_text(encoding="utf-8")
    except OSError as error:
        raise InputError(Problem(Place(path), f"cannot be read: {error.strerror or error}", how_to_make)) from None
    except UnicodeDecodeError as error:
        raise InputError(Problem(Place(path), f"is not UTF-8 text (byte {error.start})", how_to_make)) from None


@contextmanager
def whole_or_none(path: Path) -> Iterator[Path]:
    """Where to write a file or a new folder atomically: it is moved to its place at the end.

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
        shutil.rmtree(partial) if partial.is_dir() else partial.unlink(missing_ok=True)


def write_new(folder: Path, files: Mapping[str, bytes]) -> None:
    """Write files into a folder where none of them is.

    Raises:
        InputError: one of them is there already, or the folder cannot be written to; nothing new is left there.
    """
    paths = [folder / name for name in files]
    taken = [path for path in paths if path.exists() or path.is_symlink()]
    taken += [
        path for path in sorted({folder, *(path.parent for path in paths)}) if path.exists() and not path.is_dir()
    ]
    if len(taken) == len(paths) > 2:
        raise InputError(Problem(Place(folder), "holds all of these files already", "choose another folder"))
    if taken:
        raise InputError(*(Problem(Place(path), "exists already", "choose another name") for path in taken))
    begun: list[Path] = []  # folders and files that were not there
    path = folder
    try:
        for name, content in files.items():
            path = folder / name
            _make_folder(path.parent, begun)
            with path.open("xb") as file:
                begun.append(path)
                file.write(content)
    except OSError as error:
        for made in reversed(begun):
            made.rmdir() if made.is_dir() else made.unlink()
        raise InputError(Problem(Place(path), f"cannot be written: {error.strerror or error}")) from None


def _make_folder(folder: Path, begun: list[Path]) -> None:
    missing = [parent for parent in (folder, *folder.parents) if not parent.exists()]
    for path in reversed(missing):
        path.mkdir()
        begun.append(path)


def write_whole(path: Path, content: bytes) -> None:
    """Write a file, and its folder where there is none; what was there before stays whole until the new one is.

    Raises:
        InputError: it cannot be written.
    """
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        with whole_or_none(path) as partial:
            partial.write_bytes(content)
    except OSError as error:
        raise InputError(f"{path}: cannot be written: {error.strerror or error}") from None
