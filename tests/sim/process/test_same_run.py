"""A world in a process of its own, in lock-step: the log is the same to the bit."""

from __future__ import annotations

import hashlib
import json
import sys
from collections import defaultdict
from pathlib import Path
from typing import Any

import pytest
from mcap.reader import make_reader

from cell.configuration import DEFAULT_CONFIGURATION
from tests.processes import finished, started

DURATION_S = 7.0
MEASURED_IN_WALL_TIME = ("/timing", "/log")
TOLD = ("end", "ticks", "placements", "help_requests", "inferred_goal", "contacts")


def test_the_log_is_the_same_whichever_process_simulates(tmp_path: Path) -> None:
    """As in tests/integration/test_overlap.py, whose run with this seed grasps a part after 6 s."""
    configuration = shortened(tmp_path)
    cell = [sys.executable, "-m", "cell"]
    chosen = ["--config", str(configuration), "--goal", "g1", "--seed", "3"]
    line, digests = recorded([*cell, "run", *chosen, "--log", str(tmp_path / "here.mcap"), "--json"])
    address = tmp_path / "world.sock"
    with started([*cell, "lab", "world", *chosen, "--at", str(address)]) as world:
        assert world.stderr is not None
        assert "the world is at" in world.stderr.readline()
        there = [*cell, "lab", "run", *chosen, "--world", str(address), "--log", str(tmp_path / "there.mcap"), "--json"]
        other_line, other_digests = recorded(there)
    assert digests == other_digests
    assert {"/camera/overhead", "/bench", "/joint_samples", "/can", "/truth", "/tick"} <= set(digests)
    for name in TOLD:
        assert line[name] == other_line[name], name


def shortened(folder: Path) -> Path:
    text = DEFAULT_CONFIGURATION.read_text()
    for old, new in (
        ("product: products.yaml", f"product: {DEFAULT_CONFIGURATION.parent / 'products.yaml'}"),
        ("simulation: sim.yaml", f"simulation: {DEFAULT_CONFIGURATION.parent / 'sim.yaml'}"),
        ("max_duration_s: 300.0", f"max_duration_s: {DURATION_S}"),
    ):
        assert old in text
        text = text.replace(old, new)
    path = folder / "cell.yaml"
    path.write_text(text)
    return path


def recorded(command: list[str]) -> tuple[dict[str, Any], dict[str, str]]:
    """The JSON line of a run, and a digest of each topic of its log."""
    result = finished(command)
    assert result.stdout, result.stderr
    line: dict[str, Any] = json.loads(result.stdout.splitlines()[-1])
    digests: dict[str, hashlib._Hash] = defaultdict(hashlib.sha256)
    with Path(line["log"]).open("rb") as stream:
        for _, channel, message in make_reader(stream).iter_messages(log_time_order=False):
            digests[channel.topic].update(message.log_time.to_bytes(8) + message.data)
            digests["order"].update(channel.topic.encode())
    return line, {topic: value.hexdigest() for topic, value in digests.items() if topic not in MEASURED_IN_WALL_TIME}


@pytest.mark.parametrize("there", [False, True])
def test_an_address_without_a_world_is_bad_input(tmp_path: Path, there: bool) -> None:
    address = tmp_path / "world.sock"
    if there:
        address.write_text("no socket")
    command = [sys.executable, "-m", "cell", "lab", "run", "--world", str(address), "--log", str(tmp_path / "l.mcap")]
    result = finished(command)
    assert result.returncode == 2
    assert result.stderr.startswith(f"cell: {address}: no world is there")
    assert len(result.stderr.splitlines()) == 1, result.stderr
    assert not (tmp_path / "l.mcap").exists()
