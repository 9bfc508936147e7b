"""A cluster as people start it: a scheduler and workers with their nannies, as processes of their own."""

from __future__ import annotations

import gc
import os
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import psutil
import pytest

from bracket_cell.fleet.engine import cluster, results
from bracket_cell.fleet.packing import Packed
from bracket_cell.fleet.task import Task
from bracket_ground.errors import InputError
from tests import ROOT
from tests.cell.fleet import working

RUNS = 40
DASK = (sys.executable, "-m", "dask")


def task(number: int) -> Task:
    packed = Packed("t", "c", (("n", str(number).encode()),))
    return Task(packed, number, "g0", None, None, None, None, (("tree", "t"),))


@contextmanager
def started(folder: Path) -> Iterator[tuple[str, list[subprocess.Popen[bytes]]]]:
    """A scheduler, two workers as `dask worker` starts them, and one that lacks the package."""
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    address, dashboard = f"tcp://127.0.0.1:{port}", ["--dashboard-address", "127.0.0.1:0", "--host", "127.0.0.1"]
    paths = os.pathsep.join(filter(None, [str(ROOT), *sys.path]))
    here = {**os.environ, "PYTHONPATH": paths}
    lacking = folder / "lacking"
    (lacking / "bracket_cell").mkdir(parents=True)
    (lacking / "bracket_cell" / "__init__.py").write_text("raise ImportError('no such package here')\n")
    commands = [
        ([*DASK, "scheduler", "--port", str(port), *dashboard], here),
        *(
            ([*DASK, "worker", address, "--nthreads", "1", "--name", name, *dashboard,
              "--local-directory", str(folder / name)], {**here, "PYTHONPATH": path})
            for name, path in (("one", paths), ("two", paths), ("odd", str(lacking)))
        ),
    ]  # fmt: skip
    running: list[subprocess.Popen[bytes]] = []
    try:
        for command, environment in commands:
            with (folder / f"{len(running)}.log").open("wb") as log:
                running.append(subprocess.Popen(command, env=environment, stdout=log, stderr=log, cwd=folder))
            time.sleep(0.5)
        yield address, running
    finally:
        for process in reversed(running):
            for child in (*psutil.Process(process.pid).children(recursive=True), process):
                child.kill()
            process.wait()


@pytest.mark.slow
def test_default_workers_do_all_runs_though_one_is_killed_and_one_lacks_the_package(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    rows = []
    with started(tmp_path) as (address, processes), cluster(1, address) as client:
        client.wait_for_workers(3, timeout=120)
        for row in results(client, map(task, range(RUNS)), working.row):
            rows.append(row)
            if len(rows) == 5:
                for child in psutil.Process(processes[1].pid).children():
                    os.kill(child.pid, signal.SIGKILL)  # its nanny begins another
    assert sorted(row["seed"] for row in rows) == list(range(RUNS))
    assert {row["end"] for row in rows} == {"finished"}
    told = capsys.readouterr().err
    assert "worker odd does not agree and gets no runs: has no package cell" in told
    assert "worker one" not in told


@pytest.mark.parametrize("address", ["tcp://127.0.0.1:9", "foo"])
def test_a_scheduler_that_is_not_there_is_told_in_one_line(address: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("bracket_cell.fleet.engine.CONNECT_S", 0.5)
    with pytest.raises(InputError, match="no Dask scheduler answers"), cluster(1, address):
        pass


def test_workers_do_not_hear_the_ctrl_c_that_ends_a_sweep() -> None:
    """They wrote tracebacks over the last words."""
    gc.collect()  # a client that found no scheduler, collected while Dask begins a loop, would hold that up for 10 s
    with cluster(1) as client:
        (blocked,) = client.run(signal.pthread_sigmask, signal.SIG_BLOCK, []).values()
        assert signal.SIGINT in blocked
    assert signal.SIGINT not in signal.pthread_sigmask(signal.SIG_BLOCK, [])
