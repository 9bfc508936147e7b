"""Frames and detectors beside the physics: the log is the same to the bit, and a failure there is a device fault."""

from __future__ import annotations

import hashlib
import json
import os
import signal
import subprocess
import sys
from collections import defaultdict
from contextlib import closing
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np
from mcap.reader import make_reader

from cell.configuration import DEFAULT_CONFIGURATION
from cell.watching.observer import TickRecord
from cell.wiring.detectors import detectors_of
from sim.cell import SimCell
from sim.rendering.render_process import RenderProcess
from tests.integration.cell_rig import ASSEMBLE, BENCH, CAN, CONFIGURATION, PRODUCT, SIMULATION, Recorded, run_tree

DURATION_S = 14.0
MEASURED_IN_WALL_TIME = ("/timing", "/log")


def recorded(folder: Path, overlap: bool) -> tuple[dict[str, object], dict[str, str]]:
    """The JSON line of a short run with this setting, and a digest of each topic of its log."""
    text = DEFAULT_CONFIGURATION.read_text()
    for old, new in (
        ("product: products.yaml", f"product: {DEFAULT_CONFIGURATION.parent / 'products.yaml'}"),
        ("max_duration_s: 300.0", f"max_duration_s: {DURATION_S}"),
    ):
        assert old in text
        text = text.replace(old, new)
    folder.mkdir()
    simulation = DEFAULT_CONFIGURATION.with_name("sim.yaml").read_text()
    (folder / "sim.yaml").write_text(f"{simulation}overlap: {str(overlap).lower()}\n")
    configuration, log = folder / "cell.yaml", folder / "log.mcap"
    configuration.write_text(text)
    command = ["run", "--config", str(configuration), "--goal", "g1", "--seed", "3", "--log", str(log), "--json"]
    result = subprocess.run([sys.executable, "-m", "cell", *command], capture_output=True, text=True, check=False)
    line: dict[str, object] = json.loads(result.stdout.splitlines()[-1])
    digests: dict[str, hashlib._Hash] = defaultdict(hashlib.sha256)
    with log.open("rb") as stream:
        for _, channel, message in make_reader(stream).iter_messages(log_time_order=False):
            digests[channel.topic].update(message.log_time.to_bytes(8) + message.data)
            digests["order"].update(channel.topic.encode())
    return line, {topic: value.hexdigest() for topic, value in digests.items() if topic not in MEASURED_IN_WALL_TIME}


def test_the_log_is_the_same_with_and_without_overlap(tmp_path: Path) -> None:
    line, digests = recorded(tmp_path / "beside", overlap=True)
    other_line, other_digests = recorded(tmp_path / "one", overlap=False)
    assert digests == other_digests
    assert {"/camera/overhead", "/camera/wrist", "/bench", "/parts", "/joint_samples", "/note/belief"} <= set(digests)
    for name in ("end", "ticks", "placements", "help_requests", "inferred_goal"):
        assert line[name] == other_line[name], name


@dataclass
class Killer(Recorded):
    """Kills the render process at a tick."""

    process_id: int = 0
    tick_number: int = 0

    def tick(self, record: TickRecord) -> None:
        super().tick(record)
        if record.observation.tick == self.tick_number:
            os.kill(self.process_id, signal.SIGKILL)


def test_a_render_process_that_dies_is_a_fault_of_a_device() -> None:
    detect = partial(detectors_of, BENCH, PRODUCT, CONFIGURATION.perception)
    with closing(SimCell(PRODUCT, BENCH, SIMULATION, *CAN, 3, "g1", overlap=True, detect=detect)) as cell:
        assert isinstance(cell.devices.host, RenderProcess)
        killer = Killer(process_id=cell.devices.host.process_ids[0], tick_number=40)
        outcome, recorded = run_tree(cell, ASSEMBLE, recorded=killer)
    assert outcome.end == "fault"
    assert outcome.reason.startswith(f"renderer (pid {killer.process_id}): it died")
    assert not outcome.detail, "a typed fault has no traceback"
    # Where a detector waits for a frame the run ends at once; else a camera is lost, which may come back for 20 s.
    assert 40 < outcome.ticks < 50 or 540 < outcome.ticks < 550
    assert np.ptp(recorded.joints[50:] or recorded.joints[-1:], axis=0).max() < 1e-3, "the arm stands meanwhile"
