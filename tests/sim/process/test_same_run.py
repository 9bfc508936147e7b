"""Frames, detectors and the world may run in processes of their own: the log is the same to the bit."""

from __future__ import annotations

import hashlib
import json
import sys
from collections import defaultdict
from pathlib import Path
from typing import Any

import pytest
from mcap.reader import make_reader

from bracket_cell.commands.main import main
from bracket_cell.configuration import DEFAULT_CONFIGURATION
from tests.processes import finished, started

DURATION_S = 6.6  # with this seed a part is grasped after 6 s
CHOSEN = ("--goal", "g1", "--seed", "3")
CELL = (sys.executable, "-m", "bracket_cell")
MEASURED_IN_WALL_TIME = ("/timing", "/log")
TOLD = ("end", "ticks", "placements", "help_requests", "inferred_goal", "contacts")

Recorded = tuple[dict[str, Any], dict[str, str]]


@pytest.fixture(scope="module")
def configuration(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """That of a run in which nothing runs beside the physics."""
    return shortened(tmp_path_factory.mktemp("one") / "cell.yaml", overlap=False)


@pytest.fixture(scope="module")
def alone(configuration: Path) -> Recorded:
    return recorded(
        [*CELL, "run", "--config", str(configuration), *CHOSEN],
        configuration.with_name("log.mcap"),
        {"PYTHONHASHSEED": "1"},
    )


@pytest.mark.long
def test_the_log_is_the_same_whichever_processes_simulate_draw_and_detect(alone: Recorded, tmp_path: Path) -> None:
    """Nothing hangs on the order of sets either, which is another one in each process."""
    address, beside = tmp_path / "world.sock", shortened(tmp_path / "cell.yaml", overlap=True)
    chosen = ["--config", str(beside), *CHOSEN]
    with started([*CELL, "lab", "world", *chosen, "--at", str(address)]) as world:
        assert world.stderr is not None
        assert "the world is at" in world.stderr.readline()
        there = [*CELL, "lab", "run", *chosen, "--world", str(address)]
        assert_same(recorded(there, tmp_path / "there.mcap", {"PYTHONHASHSEED": "2"}), alone)
    written = {"/camera/overhead", "/camera/wrist", "/bench", "/parts", "/joint_samples", "/note/belief"}
    assert written | {"/can", "/truth", "/tick"} <= set(alone[1])


def assert_same(one: Recorded, other: Recorded) -> None:
    assert one[1] == other[1]
    assert {name: one[0][name] for name in TOLD} == {name: other[0][name] for name in TOLD}


def shortened(path: Path, *, overlap: bool) -> Path:
    """The shipped configuration for a short run."""
    text, shipped = DEFAULT_CONFIGURATION.read_text(), DEFAULT_CONFIGURATION.parent
    for old, new in (
        ("product: products.yaml", f"product: {shipped / 'products.yaml'}"),
        ("max_duration_s: 300.0", f"max_duration_s: {DURATION_S}"),
    ):
        assert old in text
        text = text.replace(old, new)
    path.write_text(text)
    simulation = (shipped / "sim.yaml").read_text()
    path.with_name("sim.yaml").write_text(f"{simulation}overlap: {str(overlap).lower()}\n")
    return path


def recorded(command: list[str], log: Path, environment: dict[str, str] | None = None) -> Recorded:
    """The JSON line of a run, and a digest of each topic of its log."""
    result = finished([*command, "--log", str(log), "--json"], environment=environment)
    assert result.stdout, result.stderr
    line: dict[str, Any] = json.loads(result.stdout.splitlines()[-1])
    digests: dict[str, hashlib._Hash] = defaultdict(hashlib.sha256)
    with log.open("rb") as stream:
        for _, channel, message in make_reader(stream).iter_messages(log_time_order=False):
            digests[channel.topic].update(message.log_time.to_bytes(8) + message.data)
            digests["order"].update(channel.topic.encode())
    return line, {topic: value.hexdigest() for topic, value in digests.items() if topic not in MEASURED_IN_WALL_TIME}


@pytest.mark.parametrize("there", [False, True])
def test_an_address_without_a_world_is_bad_input(
    tmp_path: Path, there: bool, capsys: pytest.CaptureFixture[str]
) -> None:
    address = tmp_path / "world.sock"
    if there:
        address.write_text("no socket")
    assert main(["lab", "run", "--world", str(address), "--log", str(tmp_path / "l.mcap")]) == 2
    told = capsys.readouterr().err
    assert told.startswith(f"cell: {address}: no world is there")
    assert len(told.splitlines()) == 1, told
    assert not (tmp_path / "l.mcap").exists()
