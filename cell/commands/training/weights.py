"""Where weights are shipped, where new ones are written, and what training them needs."""

from __future__ import annotations

import os
import re
from collections.abc import Iterator
from contextlib import contextmanager
from importlib.util import find_spec
from pathlib import Path
from tempfile import TemporaryFile

from cell.errors import CellError, InputError
from cell.files.files import shipped
from cell.interfaces.planning import weights_file

UNITS_S = {"s": 1, "m": 60, "h": 3600}


def seconds(text: str) -> float:
    """Seconds of a budget: "90s", "30m" or "1.5h".

    Raises:
        InputError: it is written otherwise, or nothing.
    """
    found = re.fullmatch(r"(\d+(?:\.\d+)?)([smh])", text.strip())
    if found is None or float(found[1]) == 0:
        raise InputError(f"--budget {text}: must be a number with its unit, more than 0, like 90s, 30m or 2h")
    return float(found[1]) * UNITS_S[found[2]]


def shipped_weights(planner: str, kind: str) -> Path:
    """File of the weights that come with the program."""
    return shipped("learned", "weights", weights_file(planner, kind))


def folder_for(config: Path) -> Path:
    """Where what is learned for a configuration goes: beside it; for the shipped one, into the working folder."""
    return Path() if config.resolve() == shipped("config", "cell.yaml").resolve() else config.parent


def new_weights(planner: str, kind: str, config: Path, out: Path | None = None) -> Path:
    """File for weights that are trained for a configuration: beside it, or where `out` says.

    Raises:
        InputError: no weights can be written there.
    """
    name = weights_file(planner, kind)
    return writable(out or folder_for(config) / name, Path(name).suffix)


def writable(path: Path, *suffixes: str, option: str = "--out") -> Path:
    """The file, in which something can be written; told before work that takes minutes or hours, not after it.

    Raises:
        InputError: it is a folder, its name ends in something else, or no file can be made there.
    """
    if path.suffix not in suffixes:
        raise InputError(f"{option} {path}: must end in {' or '.join(suffixes)}")
    if path.is_dir():
        raise InputError(f"{option} {path}: is a folder; name a file")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        with TemporaryFile(dir=path.parent):
            pass
    except OSError as error:
        raise InputError(f"{option} {path}: cannot be written: {error.strerror or error}") from None
    return path


@contextmanager
def writing(weights: Path, *beside: Path, overwrite: bool, option: str = "--out") -> Iterator[None]:
    """Around a training: it writes over nothing unasked, but goes on where it was interrupted.

    While it lasts, and after it was interrupted, an empty file beside the weights says so.

    Args:
        beside: what it writes besides them.
        option: which says where.

    Raises:
        InputError: a file is there already.
    """
    begun = weights.with_name(f"{weights.name}.unfinished")
    goes_on = begun.exists()
    require_new(weights, *beside, overwrite=overwrite or goes_on, option=option)
    begun.touch()
    try:
        yield
    except CellError:
        if not goes_on:
            begun.unlink(missing_ok=True)
        raise
    begun.unlink(missing_ok=True)


def require_new(*files: Path, overwrite: bool, option: str = "--out") -> None:
    """Check that no file is written over unasked.

    Raises:
        InputError: one is there already.
    """
    for file in files:
        if file.is_file() and not overwrite:
            raise InputError(f"{file}: exists already; choose another {option}, or add --overwrite")


def told_in(config: Path, path: Path) -> Path:
    """A file or folder as a configuration names it: relative to the configuration's own folder."""
    return Path(os.path.relpath(path.resolve(), config.resolve().parent))


def need_torch(*, experiments: bool = False) -> None:
    """Check that training can run here, and that experiments can.

    Raises:
        InputError: packages are missing; the message says how to get them.
    """
    needed = ("torch", "onnx", "onnxscript", *(("scipy",) if experiments else ()))
    missing = [name for name in needed if find_spec(name) is None]
    if missing:
        raise InputError(f"training needs {', '.join(missing)}; install with: make train-deps")
