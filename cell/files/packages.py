"""What is installed: the project under the name that it has in an index, its extras, and files that went missing."""

from __future__ import annotations

import csv
import importlib
import json
import re
import sys
from importlib import metadata
from importlib.util import find_spec
from pathlib import Path
from typing import Any

from cell.errors import InputError
from cell.files.files import INSTALLED

DISTRIBUTION = "bracket-cell"  # in an index `cell` is somebody else's


def version() -> str:
    """Of the project.

    Raises:
        metadata.PackageNotFoundError: it runs from a folder that was never installed.
    """
    return metadata.version(DISTRIBUTION)


def needed(module: str, why: str, extra: str = "fleet") -> Any:
    """A module of a package that comes with an extra.

    Raises:
        InputError: it is not installed; with the command that installs it.
    """
    try:
        return importlib.import_module(module)
    except ImportError as error:
        package = module.partition(".")[0]
        raise InputError(f"{why} needs the package {package} ({error}): {install_command(extra)}") from None


def install_command(extra: str) -> str:
    """How this environment gets an extra: from where the project itself was installed, never by a bare name."""
    records = [one.read_text("direct_url.json") for one in metadata.distributions(name=DISTRIBUTION)]
    told = json.loads(next(filter(None, records), "{}"))  # a build leaves a second entry in the clone, without it
    where = str(told.get("url", "CLONE")).removeprefix("file://")
    editable = "-e " if told.get("dir_info", {}).get("editable") else ""
    return f'{sys.executable} -m pip install {editable}"{where}[{extra}]"'


def how_to_train() -> str:
    """How this environment gets what training needs."""
    return "make train-deps" if (INSTALLED / "Makefile").is_file() else install_command("train")


def missing_packages() -> tuple[list[str], list[str]]:
    """Packages that a run needs, and those of them that are not installed.

    Raises:
        metadata.PackageNotFoundError: the project itself is not.
    """
    listed = metadata.requires(DISTRIBUTION) or []
    names = [re.split(r"[^\w.-]", one, maxsplit=1)[0] for one in listed if "extra ==" not in one]
    there = {re.sub(r"[-_.]+", "-", one.name).lower() for one in metadata.distributions()}
    return names, [name for name in names if re.sub(r"[-_.]+", "-", name).lower() not in there]


def damaged_packages() -> dict[str, str]:
    """Installed packages of which a file is missing or has another size than was recorded, with the first such file."""
    return {one.name: told for one in metadata.distributions() if (told := _damage(one))}


def _damage(package: metadata.Distribution) -> str:
    folder = str(package.locate_file(""))
    for name, digest, size in csv.reader((package.read_text("RECORD") or "").splitlines()):
        if not digest or name.endswith(".pyc"):
            continue
        try:
            found = Path(folder, name).stat().st_size
        except OSError:
            return f"{name} is missing"
        if size and found != int(size):
            return f"{name} has {found} bytes, not {size}"
    return ""


def need_torch(*, experiments: bool = False) -> None:
    """Check that training can run here, and that experiments can.

    Raises:
        InputError: packages are missing; the message says how to get them.
    """
    needed = ("torch", "onnx", "onnxscript", *(("scipy",) if experiments else ()))
    missing = [name for name in needed if find_spec(name) is None]
    if missing:
        raise InputError(f"training needs {', '.join(missing)}; install with: {how_to_train()}")
