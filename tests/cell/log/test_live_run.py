"""A run that is watched live decides as one that is not, and its viewer sees it."""

from __future__ import annotations

import json
import socket
import threading
import time
from collections import Counter
from pathlib import Path

import pytest
from rich.console import Console
from websockets.exceptions import ConnectionClosed

from bracket_cell.commands.main import main
from bracket_cell.log.read.reader import Log, read_log
from bracket_cell.log.report.query import diff
from bracket_cell.runs.options import RunOptions
from bracket_cell.runs.run import run
from tests.cell.conftest import ALGORITHM_1, changed_configuration
from tests.cell.viewing.viewer import live_viewer

WATCHED = ("/camera/overhead", "/camera/overhead/hand", "/tick", "/observation", "/joint_states", "/tf/robot")


class Watching(threading.Thread):
    """A viewer that connects as soon as it can and counts what comes until the run ends."""

    def __init__(self, port: int) -> None:
        super().__init__(daemon=True)
        self.counts: Counter[str] = Counter()
        self.first_tick = self.last_tick = -1
        self._port = port

    def run(self) -> None:
        while True:
            try:
                self._watch()
            except ConnectionRefusedError:
                time.sleep(0.02)
            except ConnectionClosed:
                return

    def _watch(self) -> None:
        with live_viewer(self._port) as viewer:
            viewer.learn(*WATCHED)
            viewer.subscribe(*WATCHED)
            while (message := viewer.message(20.0)) is not None:
                topic, _, data = message
                self.counts[topic] += 1
                if topic == "/tick":
                    self.last_tick = json.loads(data)["tick"]
                    self.first_tick = self.last_tick if self.first_tick < 0 else self.first_tick


def free_port() -> int:
    with socket.socket() as one:
        one.bind(("127.0.0.1", 0))
        port: int = one.getsockname()[1]
        return port


@pytest.mark.long
def test_a_watched_run_decides_as_one_that_is_not(assembly_log: Log, tmp_path: Path) -> None:
    port = free_port()
    watching = Watching(port)
    watching.start()
    configuration = changed_configuration(tmp_path / "config", "max_duration_s: 300.0", "max_duration_s: 6.0")
    log = tmp_path / "log.mcap"
    run(RunOptions(ALGORITHM_1, configuration, "g0", 1, "fast", log, live_port=port), Console(quiet=True))
    watching.join(20.0)
    assert not watching.is_alive(), "the viewer was not told of the end"
    live = read_log(log)
    assert diff(assembly_log, live).identical
    assert watching.counts["/tick"] == watching.last_tick - watching.first_tick + 1, "ticks are missing"
    assert watching.last_tick == live.ticks[-1].number
    assert all(watching.counts[topic] for topic in WATCHED)


def test_a_taken_port_is_bad_input_and_leaves_no_log(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    log = tmp_path / "log.mcap"
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        taken.listen()
        port = str(taken.getsockname()[1])
        assert main(["run", "--open", f"live={port}", "--log", str(log)]) == 2
    assert f"port {port} cannot be used" in capsys.readouterr().err
    assert not log.exists()
