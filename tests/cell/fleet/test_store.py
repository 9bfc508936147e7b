"""Results go to any address: a folder here is copied there, and a sweep there goes on."""

from __future__ import annotations

import errno
import json
import socket
from collections.abc import Iterator
from pathlib import Path

import pytest

from bracket_cell.fleet.store import get, put, results_folder
from bracket_cell.fleet.table import write_table
from bracket_ground.errors import InputError

NAMES = ("runs.jsonl", "runs.parquet")


@pytest.fixture(params=["memory", "object store"])
def place(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> Iterator[str]:
    """An address in memory, and one of an object store that runs beside the test."""
    if request.param == "memory":
        yield "memory://results/sweep"
        return
    pytest.importorskip("gcsfs")
    server = pytest.importorskip("gcp_storage_emulator.server")
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    running = server.create_server("127.0.0.1", port, in_memory=True, default_bucket="results")
    running.start()
    monkeypatch.setenv("STORAGE_EMULATOR_HOST", f"http://127.0.0.1:{port}")
    yield "gs://results/sweep"
    running.stop()


def test_what_is_written_is_there_next_time(place: str, tmp_path: Path) -> None:
    with results_folder(place, NAMES) as (folder, more):
        (folder / "runs.jsonl").write_text(json.dumps({"key": "a"}) + "\n")
        more()
    with results_folder(place, NAMES) as (folder, _):
        assert (folder / "runs.jsonl").read_text() == '{"key": "a"}\n'
        assert not (folder / "runs.parquet").exists()
    (tmp_path / "run.mcap").write_bytes(b"a log")
    put(tmp_path / "run.mcap", f"{place}/logs/run.mcap")
    (tmp_path / "here").mkdir()
    [found] = get(f"{place}/logs/run.mcap", tmp_path / "here")
    assert found.read_bytes() == b"a log"


@pytest.mark.parametrize("place", ["nosuch://bucket/x", "s3://bucket/x"])
def test_a_store_that_cannot_be_used_is_told_in_one_line(
    place: str, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("AWS_ENDPOINT_URL", "http://127.0.0.1:9")
    monkeypatch.setenv("AWS_MAX_ATTEMPTS", "1")
    with pytest.raises(InputError, match="cannot be used"), results_folder(place, NAMES):
        pass
    assert not list(tmp_path.iterdir())


def test_a_full_disk_is_told_in_the_words_of_the_system(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    class Full:
        def __init__(self, *_: object) -> None:
            raise OSError(errno.ENOSPC, "Error writing bytes to file. Detail: [errno 28] no space")  # as Arrow says it

    monkeypatch.setattr("pyarrow.parquet.ParquetWriter", Full)
    with pytest.raises(InputError, match=r"runs\.parquet: cannot be written: No space left on device$"):
        write_table([{"seed": 1}], tmp_path / "runs.parquet")
