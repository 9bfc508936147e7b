"""What is installed: the project's distributions, where they came from, their extras, and files that went missing."""

from __future__ import annotations

import csv
import importlib
import json
import re
import sys
from importlib import metadata, resources
from pathlib import Path
from typing import Any

from bracket_ground.errors import InputError

DISTRIBUTION, SIMULATOR, LABORATORY = "bracket-cell", "bracket-sim", "bracket-lab"
FOLDERS = {DISTRIBUTION: "cell", SIMULATOR: "sim", LABORATORY: "lab"}  # in a clone; each has a pyproject.toml
_HERE = Path(str(resources.files("bracket_cell"))).parent
INSTALLED = _HERE.parent if (_HERE / "pyproject.toml").is_file() else _HERE  # the clone, or the installed packages


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
        raise InputError(f"{why} needs the package {package} ({error}): {install_command(extra=extra)}") from None


def install_command(distribution: str = "", extra: str = "") -> str:
    """How this environment gets a distribution, or an extra: from where the cell came from, never by a bare name."""
    records = [found.read_text("direct_url.json") for found in metadata.distributions(name=DISTRIBUTION)]
    record = json.loads(next(filter(None, records), "{}"))  # a build leaves a second entry in the clone, without it
    url = str(record.get("url", f"CLONE/{FOLDERS[DISTRIBUTION]}")).removeprefix("file://")
    folder = Path(url).with_name(FOLDERS[distribution or _with_extra(extra)])
    editable = "-e " if record.get("dir_info", {}).get("editable") else ""
    return f'{sys.executable} -m pip install {editable}"{folder}{f"[{extra}]" if extra else ""}"'


def _with_extra(extra: str) -> str:
    """The distribution that offers an extra; the cell where none is installed that does."""
    offered = {found.name: found.metadata.get_all("Provides-Extra") or () for found in metadata.distributions()}
    return next((name for name in FOLDERS if extra in offered.get(name, ())), DISTRIBUTION)


def offers(distribution: str) -> bool:
    """Whether it is installed."""
    return any(True for _ in metadata.distributions(name=distribution))


def how_to_install(distribution: str) -> str:
    """How this environment gets the simulator or the laboratory."""
    target = {SIMULATOR: "make run", LABORATORY: "make train-deps"}[distribution]
    return target if (INSTALLED / "Makefile").is_file() else install_command(distribution)


def missing_packages() -> tuple[list[str], list[str]]:
    """Packages that a run needs, and those of them that are not installed.

    Raises:
        metadata.PackageNotFoundError: the project itself is not.
    """
    there = {re.sub(r"[-_.]+", "-", found.name).lower() for found in metadata.distributions()}
    listed = [line for name in FOLDERS if name in there for line in metadata.requires(name) or ()]
    names = [re.split(r"[^\w.-]", line, maxsplit=1)[0] for line in listed if "extra ==" not in line]
    return names, [name for name in names if re.sub(r"[-_.]+", "-", name).lower() not in there]


def damaged_packages() -> dict[str, str]:
    """Installed packages of which a file is missing or has another size than was recorded, with the first such file."""
    return {distribution.name: told for distribution in metadata.distributions() if (told := _damage(distribution))}


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
