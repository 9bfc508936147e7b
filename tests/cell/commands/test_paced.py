"""`cell run --real-time N` of a simulated cell: N times slower, and without pixels no detector looks at images."""

from __future__ import annotations

import time
from pathlib import Path

import pytest

from bracket_cell.commands.main import main
from bracket_cell.runs import run
from bracket_ground.interfaces.clock import ManualClock, PacedClock

TREE = """<root BTCPP_format="4" main_tree_to_execute="T"><BehaviorTree ID="T">
<Sleep msec="500"/></BehaviorTree></root>"""


def test_a_paced_world_goes_as_many_times_slower_as_it_is_asked_to() -> None:
    world = ManualClock()
    paced, began_s = PacedClock(world, 4.0), time.monotonic()
    paced.sleep_until(0.1)
    assert time.monotonic() - began_s >= 0.4
    assert paced.slower == 4.0
    assert world.now_s() >= 0.1


def test_a_run_without_pixels_has_the_truth_at_any_pace(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(run, "worker_processes", lambda *_: pytest.fail("detectors of images, where there are none"))
    tree = tmp_path / "tree.xml"
    tree.write_text(TREE)
    began_s = time.monotonic()
    words = ["run", str(tree), "--look", "none", "--real-time=3", "--log", str(tmp_path / "run.mcap")]
    assert main(words) == 0
    assert time.monotonic() - began_s >= 1.5
