"""What is missing on this machine, and the exact command that gets it (`cell doctor`)."""

from __future__ import annotations

import re
import sys
import tempfile
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from importlib import metadata
from pathlib import Path

import can

from cell.configuration import DEFAULT_CONFIGURATION, Configuration, load_configuration, load_product
from cell.interfaces.errors import CellError
from cell.interfaces.product import Product
from cell.running.rendering import chosen_backend, renders

GL_PACKAGES = "libegl1 libgl1-mesa-dri libopengl0 libosmesa6"


@dataclass(frozen=True)
class Finding:
    """One thing that was looked at.

    Attributes:
        remedy: a command or sentence that helps; empty where all is well.
    """

    what: str
    ok: bool
    remedy: str = ""


def examine(path: Path = DEFAULT_CONFIGURATION) -> list[Finding]:
    """Look at everything that `cell run` needs."""
    findings = [_python(), *_packages(), _rendering(), _font()]
    try:
        configuration = load_configuration(path)
        product = load_product(configuration, path)
    except CellError as error:
        return [*findings, Finding("configuration", False, str(error))]
    findings.append(Finding(f"configuration {path}", True))
    findings += [_weights(name, configuration, product) for name in ("semantic", "grasp")]
    return [*findings, _can(configuration), _writable(configuration.log.folder)]


def _python() -> Finding:
    version = ".".join(map(str, sys.version_info[:3]))
    fits = (3, 11) <= sys.version_info[:2] < (3, 13)
    return Finding(f"Python {version}", fits, "" if fits else "install Python 3.11 or 3.12, remove .venv, make run")


def _packages() -> Iterator[Finding]:
    """The runtime's packages, as the installed project lists them."""
    try:
        needed = metadata.requires("cell") or []
    except metadata.PackageNotFoundError:
        yield Finding("the project is installed in this environment", False, "make .venv/runtime")
        return
    for requirement in needed:
        if "extra ==" in requirement:
            continue
        name = re.split(r"[^\w.-]", requirement, maxsplit=1)[0]
        try:
            yield Finding(f"{name} {metadata.version(name)}", True)
        except metadata.PackageNotFoundError:
            yield Finding(name, False, "make .venv/runtime")


def _rendering() -> Finding:
    backend = chosen_backend()
    if renders(backend):
        return Finding(f"rendering by {backend}", True)
    other = " (or: export MUJOCO_GL=osmesa)" if backend != "osmesa" and renders("osmesa") else ""
    return Finding(f"rendering by {backend}", False, f"apt-get install -y {GL_PACKAGES}{other}")


def _font() -> Finding:
    """Only `cell show --png` needs it, so that a run begins without."""
    from trees.views.picture import FONT_PACKAGE, draws_text

    what = "a font for pictures of trees (cell show --png)"
    return Finding(what, True) if draws_text() else Finding(what, False, f"apt-get install -y {FONT_PACKAGE}")


def _weights(name: str, configuration: Configuration, product: Product) -> Finding:
    from learned.grasp.planner import load_grasp_planner
    from learned.semantic.planner import load_semantic_planner

    loaders: dict[str, Callable[..., object]] = {"semantic": load_semantic_planner, "grasp": load_grasp_planner}
    planner = getattr(configuration.planners, name)
    try:
        loaders[name](planner.kind, planner.weights, product)
    except CellError as error:
        return Finding(f"{name} planner {planner.kind}", False, f"{error}; cell train {name} --kind {planner.kind}")
    return Finding(f"{name} planner {planner.kind}", True)


def _can(configuration: Configuration) -> Finding:
    settings = configuration.gripper_can
    what = f"CAN {settings.interface} {settings.channel}"
    try:
        can.Bus(interface=settings.interface, channel=settings.channel, bitrate=settings.bitrate).shutdown()
    except (can.CanError, OSError, ValueError) as error:
        remedy = f"{error}; for SocketCAN: ip link set {settings.channel} up type can bitrate {settings.bitrate}"
        return Finding(what, False, remedy)
    return Finding(what, True)


def _writable(folder: Path) -> Finding:
    try:
        folder.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=folder):
            return Finding(f"logs can be written to {folder}", True)
    except OSError as error:
        return Finding(f"logs can be written to {folder}", False, f"{error.strerror}; choose a file by --log")
