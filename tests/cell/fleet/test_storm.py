"""All troubles in one sweep; each run has one row: a bad disk, killed, frozen, scheduler killed, store away."""

from __future__ import annotations

import json
import os
import signal
import socket
import subprocess
import sys
import threading
import time
from collections import Counter
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

import psutil
import pytest

from bracket_cell.fleet import store
from bracket_cell.fleet.engine import cluster, results
from bracket_cell.fleet.store import results_folder
from bracket_ground.files.row_store import RowStore
from tests import ROOT
from tests.cell.fleet import working
from tests.cell.fleet.test_cluster import DASK, task

RUNS = 300
STORE_AWAY_S, SCHEDULER_AWAY_S = 30.0, 10.0
ENDS_S = 20.0  # in which a worker ends whose scheduler is gone
NAMES = ("runs.jsonl",)


class Cluster:
    """A scheduler and four workers as people start them; worker 2 cannot write where it is to."""

    def __init__(self, folder: Path) -> None:
        with socket.socket() as free:
            free.bind(("127.0.0.1", 0))
            self.port = free.getsockname()[1]
        self.address, self._folder = f"tcp://127.0.0.1:{self.port}", folder
        self._paths = os.pathsep.join(filter(None, [str(ROOT), *sys.path]))
        self._again: threading.Timer | None = None
        self.scheduler = self.begin("scheduler", ["scheduler", "--port", str(self.port)])
        time.sleep(2)
        self.workers = [self.begin_worker(name) for name in "1234"]

    def begin_worker(self, name: str) -> subprocess.Popen[bytes]:
        """One that joins the scheduler."""
        disk = str(self._folder) * (name == "2")
        return self.begin(name, ["worker", self.address, "--nthreads", "1", "--name", name], disk)

    def begin(self, name: str, arguments: list[str], disk: str = "") -> subprocess.Popen[bytes]:
        usual = ["--dashboard-address", "127.0.0.1:0", "--host", "127.0.0.1"]
        usual += ["--local-directory", str(self._folder / name)] if arguments[0] == "worker" else []
        settings = {"DASK_DISTRIBUTED__SCHEDULER__WORKER_TTL": "20s", "DISK_OF_TEST": disk or os.devnull}
        environment = {**os.environ, **settings, "PYTHONPATH": self._paths}
        with (self._folder / f"{name}.log").open("ab") as log:
            command = [*DASK, *arguments, *usual]
            return subprocess.Popen(command, env=environment, stdout=log, stderr=log, cwd=self._folder)

    def signal_worker(self, number: int, sign: signal.Signals) -> None:
        """To its process, not to the nanny that watches it."""
        for child in psutil.Process(self.workers[number - 1].pid).children():
            child.send_signal(sign)

    def kill_scheduler(self) -> None:
        self.scheduler.kill()
        self.scheduler.wait()
        self._again = threading.Timer(SCHEDULER_AWAY_S, self._back)
        self._again.start()

    def _back(self) -> None:
        """As a service manager does it: workers end with their scheduler, and are begun again, too."""
        self.scheduler = self.begin("scheduler", ["scheduler", "--port", str(self.port)])
        for number, old in enumerate(self.workers):
            with suppress(subprocess.TimeoutExpired):  # the frozen one
                old.wait(ENDS_S)
                self.workers[number] = self.begin_worker(str(number + 1))

    def end(self) -> None:
        if self._again is not None:
            self._again.join()  # else it begins workers that nobody ends
        for process in (*self.workers, self.scheduler):
            for child in (*psutil.Process(process.pid).children(recursive=True), process):
                child.kill()
            process.wait()


@contextmanager
def started(folder: Path) -> Iterator[Cluster]:
    made = Cluster(folder)
    try:
        yield made
    finally:
        made.end()


def away_for(place: Path, for_s: float) -> None:
    place.rename(place.with_name("away"))
    threading.Timer(for_s, lambda: place.with_name("away").rename(place)).start()


@pytest.mark.slow
def test_each_of_many_runs_has_one_row_through_all_troubles(
    tmp_path: Path, capfd: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(store, "EVERY_S", 1.0)
    place = tmp_path / "store"
    place.mkdir()
    with (
        started(tmp_path) as made,
        cluster(1, made.address) as client,
        results_folder(f"file://{place}", NAMES) as (folder, more),
    ):
        client.wait_for_workers(4, timeout=180)
        troubles = {
            30: lambda: made.signal_worker(3, signal.SIGKILL),
            60: lambda: made.signal_worker(4, signal.SIGSTOP),
            120: lambda: away_for(place, STORE_AWAY_S),
            180: made.kill_scheduler,
        }
        rows = RowStore(folder / "runs.jsonl", ["key"])
        for count, row in enumerate(results(client, map(task, range(RUNS)), working.row_on_disk), 1):
            rows.add(row)
            more()
            troubles.get(count, lambda: None)()
    found = [json.loads(line) for line in (place / "runs.jsonl").read_text().splitlines()]
    assert Counter(row["seed"] for row in found) == Counter(range(RUNS))
    assert {row["end"] for row in found} == {"finished"}
    told = capfd.readouterr().err
    assert "is left out, as it had trouble: IsADirectoryError: " in told
    assert f"the scheduler {made.address} is gone" in told
    assert "the runs go on, and it is tried again" in told
    assert "Traceback" not in told
