"""`cell lab data`: as much memory for many recordings as for a few."""

from __future__ import annotations

import gc
from pathlib import Path

from cell.commands.main import main
from sim.worker.worker import Worker


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
    return sum(type(one) is Worker for one in gc.get_objects())
