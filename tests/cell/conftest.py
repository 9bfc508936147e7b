"""Logs that are recorded once for all workers: the robot alone through the commissioning tree, begins of assemblies."""

from __future__ import annotations

import fcntl
import os
import resource
import shutil
from collections.abc import Iterator
from functools import partial
from pathlib import Path
from typing import Any

import pytest
from rich.console import Console

from bracket_cell.configuration import DEFAULT_CONFIGURATION
from bracket_cell.log.read.reader import Log, read_log
from bracket_cell.runs.options import RunOptions
from bracket_cell.runs.run import run
from tests import ROOT

COMMISSION = ROOT / "trees" / "commission.xml"
ALGORITHM_1 = ROOT / "trees" / "assemble.xml"
BROWSERS = ("chromium", "chromium-browser", "google-chrome")


@pytest.fixture(scope="module")
def chromium() -> Iterator[Any]:
    """Starts a browser, called with its arguments."""
    sync_api = pytest.importorskip("playwright.sync_api", reason="playwright is not installed")
    path = next((found for name in BROWSERS if (found := shutil.which(name))), None)
    if path is None:
        pytest.skip(f"no browser is installed, so nobody has looked at the page: {', '.join(BROWSERS)}")
    with sync_api.sync_playwright() as playwright:
        yield partial(playwright.chromium.launch, executable_path=path)


@pytest.fixture
def small_files() -> Iterator[None]:
    """No file can grow beyond 20 kB, as on a disk that is full."""
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (20_000, hard))
    yield
    resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))


def changed_configuration(folder: Path, old: str, new: str) -> Path:
    """A copy of the shipped configuration with one value changed."""
    shutil.copytree(DEFAULT_CONFIGURATION.parent, folder, dirs_exist_ok=True)
    path = folder / DEFAULT_CONFIGURATION.name
    text = path.read_text()
    assert old in text
    path.write_text(text.replace(old, new))
    return path


def recorded(folder: Path, tree: Path, duration_s: float, seed: int = 1, settings: str = "", bold: bool = False) -> Log:
    """The log of a run in simulation that ends after a while.

    Args:
        settings: lines of YAML for the log.
        bold: the robot acts whatever the goal is.
    """
    configuration = changed_configuration(folder / "config", "max_duration_s: 300.0", f"max_duration_s: {duration_s}")
    text = configuration.read_text().replace("wrong_act_s: 300.0", f"wrong_act_s: {1.0 if bold else 300.0}")
    configuration.write_text(text.replace("\nlog:\n", f"\nlog:\n{settings}"))
    log = folder / "log.mcap"
    run(RunOptions(tree, configuration, "g0", seed, "fast", log), Console(quiet=True))
    return read_log(log)


def shared(factory: pytest.TempPathFactory, name: str, tree: Path, duration_s: float, **chosen: Any) -> Log:
    """As `recorded`, by the first worker that asks; the others wait and read the same file."""
    base = factory.getbasetemp()
    folder = (base.parent if "PYTEST_XDIST_WORKER" in os.environ else base) / name
    folder.mkdir(exist_ok=True)
    whole = folder / "whole"
    with (folder / "lock").open("w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        if whole.exists():
            return read_log(folder / "log.mcap")
        log = recorded(folder, tree, duration_s, **chosen)
        whole.touch()
        return log


@pytest.fixture(scope="session")
def commission_log(tmp_path_factory: pytest.TempPathFactory) -> Log:
    return shared(tmp_path_factory, "setup", COMMISSION, 60.0)


@pytest.fixture(scope="session")
def assembly_log(tmp_path_factory: pytest.TempPathFactory) -> Log:
    """Until the person has screwed for the first time and the guard has spoken."""
    return shared(tmp_path_factory, "assembly", ALGORITHM_1, 6.0)


@pytest.fixture(scope="session")
def tray_log(tmp_path_factory: pytest.TempPathFactory) -> Log:
    """Until the robot, which acts on little evidence here, has looked into the tray for the first time."""
    return shared(tmp_path_factory, "tray", ALGORITHM_1, 12.0, seed=3, bold=True)
