"""What goes wrong with workers, schedulers and stores is not the runs': each has one row."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
from collections import Counter
from pathlib import Path
from typing import Any

import psutil
import pytest

from bracket_cell.fleet import engine, store
from bracket_cell.fleet.engine import cluster, results
from bracket_cell.fleet.store import results_folder
from bracket_ground.errors import InputError
from tests.cell.fleet import working
from tests.cell.fleet.test_cluster import started, task

NAMES = ("runs.jsonl", "runs.parquet")


@pytest.mark.long
def test_a_worker_with_a_full_disk_is_named_and_left_out(capfd: pytest.CaptureFixture[str]) -> None:
    with cluster(2) as client:
        rows = list(results(client, map(task, range(12)), working.row_of_the_sound))
    assert Counter(row["seed"] for row in rows) == Counter(range(12))
    assert {row["end"] for row in rows} == {"finished"}
    told = capfd.readouterr().err
    assert told.count("is left out, as it had trouble: OSError: No space left on device") == 1
    assert "Traceback" not in told


@pytest.mark.long
def test_a_run_of_a_worker_with_a_full_disk_waits_for_one_that_is_still_asked(monkeypatch: pytest.MonkeyPatch) -> None:
    ask = engine._Crew._ask

    def late(self: engine._Crew, address: str, name: str) -> None:
        if self._client.scheduler_info()["workers"][address]["name"] == 0 or self._refused:
            ask(self, address, name)

    monkeypatch.setattr(engine._Crew, "_ask", late)
    with cluster(2) as client:
        rows = list(results(client, map(task, range(12)), working.row_of_the_sound))
    assert Counter((row["seed"], row["end"]) for row in rows) == Counter((seed, "finished") for seed in range(12))


@pytest.mark.slow
def test_a_frozen_worker_is_told_and_its_runs_go_to_the_other(
    monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr("bracket_cell.fleet.engine.FROZEN", "5s")
    rows: list[dict[str, Any]] = []
    with cluster(2) as client:
        client.wait_for_workers(2, timeout=60)
        address, pid = next(iter(client.run(os.getpid).items()))
        for row in results(client, map(task, range(200)), working.row):
            rows.append(row)
            if len(rows) == 5:
                os.kill(pid, signal.SIGSTOP)
    assert Counter(row["seed"] for row in rows) == Counter(range(200))
    assert {row["end"] for row in rows} == {"finished"}
    assert f"worker {address} is gone; others do its runs" in capfd.readouterr().err


@pytest.fixture
def flaky(monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """A store that is away while its list says so."""
    away: list[str] = []
    system = store._system

    def sometimes(address: str) -> tuple[Any, str]:
        if away:
            away.pop()
            raise OSError("no route to host")
        return system(address)

    monkeypatch.setattr(store, "_system", sometimes)
    monkeypatch.setattr(store, "EVERY_S", 0.0)
    return away


def test_a_store_that_was_away_has_every_row_once(flaky: list[str], capsys: pytest.CaptureFixture[str]) -> None:
    place = "memory://results/away"
    with results_folder(place, NAMES) as (folder, more):
        for number in range(6):
            with (folder / "runs.jsonl").open("a") as file:
                file.write(json.dumps({"key": number}) + "\n")
            flaky += ["away"] * (number == 2)
            more()
        flaky.append("away")
    assert capsys.readouterr().err.count("the runs go on") == 1
    with results_folder(place, NAMES) as (folder, _):
        rows = [json.loads(line)["key"] for line in (folder / "runs.jsonl").read_text().splitlines()]
    assert rows == list(range(6))


def test_a_store_with_folders_gets_its_own(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(store, "EVERY_S", 0.0)
    for number in range(2):
        with results_folder(f"file://{tmp_path}/new/out", NAMES) as (folder, more):
            with (folder / "runs.jsonl").open("a") as file:
                file.write(json.dumps({"key": number}) + "\n")
            more()
            [shard] = (tmp_path / "new" / "out" / store.SHARDS).glob("*.jsonl")
            assert json.loads(shard.read_text()) == {"key": number}
    assert [path.name for path in (tmp_path / "new" / "out").iterdir()] == ["runs.jsonl"]


def test_what_a_killed_sweep_sent_is_there_next_time(flaky: list[str], tmp_path: Path) -> None:
    place = "memory://results/killed"
    growing = store._Growing(place, tmp_path, NAMES)
    (tmp_path / "runs.jsonl").write_text('{"key": 1}\n')
    growing.more()
    with results_folder(place, NAMES) as (again, _):
        assert (again / "runs.jsonl").read_text() == '{"key": 1}\n'
    assert not flaky


def test_results_stay_here_where_the_store_stays_away(flaky: list[str], monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(store, "AWAY_S", 0.0)
    opened = results_folder("memory://results/gone", NAMES)
    folder, _ = opened.__enter__()
    (folder / "runs.jsonl").write_text('{"key": 1}\n')
    flaky += ["away"] * 5
    with pytest.raises(InputError, match=r"no route to host; the results are in (\S+)") as refused:
        opened.__exit__(None, None, None)
    kept = Path(str(refused.value).rpartition("are in ")[2])
    assert (kept / "runs.jsonl").read_text() == '{"key": 1}\n'


def test_results_are_at_the_store_where_the_runs_end_in_words(flaky: list[str]) -> None:
    place = "memory://results/ended"
    opened = results_folder(place, NAMES)
    folder, _ = opened.__enter__()
    (folder / "runs.jsonl").write_text('{"key": 1}\n')
    assert not opened.__exit__(InputError, InputError("no worker came"), None)
    assert not folder.exists()
    assert not flaky
    with results_folder(place, NAMES) as (again, _):
        assert (again / "runs.jsonl").read_text() == '{"key": 1}\n'


@pytest.mark.slow
def test_a_scheduler_that_is_killed_and_comes_back_loses_no_run(
    tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    rows: list[dict[str, Any]] = []
    with started(tmp_path) as (address, processes), cluster(1, address) as client:
        client.wait_for_workers(2, timeout=120)
        for row in results(client, map(task, range(30)), working.row):
            rows.append(row)
            if len(rows) == 5:
                for process in processes:
                    for child in (*psutil.Process(process.pid).children(recursive=True), process):
                        child.kill()
                    process.wait()
                processes[:] = [again(process) for process in processes]
    assert Counter(row["seed"] for row in rows) == Counter(range(30))
    assert {row["end"] for row in rows} == {"finished"}
    told = capfd.readouterr().err
    assert f"the scheduler {address} is gone" in told
    assert "Traceback" not in told


@pytest.mark.slow
@pytest.mark.parametrize("sign", [signal.SIGSTOP, signal.SIGKILL])
def test_a_scheduler_that_freezes_or_goes_ends_the_calls_in_words(
    sign: signal.Signals, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(engine, "AWAY_S", 5.0)
    monkeypatch.setattr(engine, "ANSWER_S", 5.0)
    with started(tmp_path) as (address, processes):
        answers = engine.mapped(working.squared, ((number, "") for number in range(10_000)), address=address)
        assert [next(answers), next(answers)] == [0, 1]
        processes[0].send_signal(sign)
        with pytest.raises(InputError, match=r"gone for 5 s; \d+ runs of this call are done"):
            list(answers)
    told = capfd.readouterr().err
    assert f"the scheduler {address} is gone" in told
    assert "Traceback" not in told


def again(process: subprocess.Popen[bytes]) -> subprocess.Popen[bytes]:
    """The same program once more."""
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join(filter(None, sys.path))}
    return subprocess.Popen(process.args, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL, env=environment)
