"""`cell lab data`: as much memory for many recordings as for a few."""

from __future__ import annotations

import gc
import signal
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from bracket_cell.commands.main import main
from bracket_lab.commands.run import world
from bracket_sim.worker.worker import Worker


@pytest.mark.long
def test_what_recordings_are_made_of_does_not_stay(tmp_path: Path) -> None:
    call = ["lab", "data", "hands", "--look", "nominal", "--seeds", "0:3", "--out", str(tmp_path / "new")]
    gc.collect()
    before = _workers()
    gc.disable()  # it comes of itself only where there are many small objects; a recording is a few large ones
    try:
        assert main(call) == 0
        assert _workers() <= before + 1  # the last one's
    finally:
        gc.enable()


def _workers() -> int:
    return sum(type(item) is Worker for item in gc.get_objects())


def test_a_world_that_cannot_say_where_it_is_closes_its_processes(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """As where whoever started it has gone; at exit they would be waited for, for ever."""
    closed: list[bool] = []
    devices, server = SimpleNamespace(close=lambda: closed.append(True)), SimpleNamespace(end=lambda: None)

    def gone(*_: Any, **__: Any) -> None:
        raise BrokenPipeError

    monkeypatch.setattr("bracket_lab.commands.run.open_world", lambda *_: (server, devices))
    monkeypatch.setattr("bracket_lab.commands.run.console", lambda: SimpleNamespace(print=gone))
    monkeypatch.setattr(signal, "signal", lambda *_: None)
    with pytest.raises(BrokenPipeError):
        world(at=tmp_path / "w.sock")
    assert closed == [True]
