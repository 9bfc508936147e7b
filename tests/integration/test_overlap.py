"""Frames and detectors beside the physics: a failure there is a device fault."""

from __future__ import annotations

import os
import signal
from contextlib import closing
from dataclasses import dataclass
from functools import partial

import numpy as np
import pytest

from bracket_cell.watching.observer import TickRecord
from bracket_cell.wiring.detectors import detectors_of
from bracket_sim.cell import SimCell
from bracket_sim.rendering.render_process import RenderProcess
from tests.integration.cell_rig import ASSEMBLE, BENCH, CAN, CONFIGURATION, PRODUCT, SIMULATION, Recorded, run_tree


@dataclass
class Killer(Recorded):
    """Kills the render process at a tick."""

    process_id: int = 0
    tick_number: int = 0

    def tick(self, record: TickRecord) -> None:
        super().tick(record)
        if record.observation.tick == self.tick_number:
            os.kill(self.process_id, signal.SIGKILL)


@pytest.mark.long
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
