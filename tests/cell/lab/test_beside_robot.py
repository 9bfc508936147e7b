"""Recordings in which the controller works beside the person: both build the bracket, and frames show the arm."""

from __future__ import annotations

import json
import os
import signal
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest

from bracket_cell.configuration import load_configuration, load_product, simulated
from bracket_ground.files.data_folder import DataFolder
from bracket_ground.interfaces.frame import Frame
from bracket_lab.drawing.actions import write_segments
from bracket_lab.drawing.hands import hand_frames
from bracket_lab.drawing.placed import holes_of
from bracket_lab.drawing.recording import Assembly, Film, Source
from bracket_lab.drawing.sight import GEOM_POSITIONS
from bracket_lab.evaluations.reaches import record_beside_robot
from bracket_sim.rendering.photographer import Exposure

CONFIGURATION = simulated(load_configuration(), "nominal", "careful")
BENCH, PRODUCT = CONFIGURATION.bench, load_product(CONFIGURATION)
SEED = 800_321


@pytest.fixture(scope="module")
def assembly() -> Assembly:
    """The begin of one."""
    controller = CONFIGURATION.controller.model_copy(update={"max_duration_s": 16.0})
    return record_beside_robot(CONFIGURATION.model_copy(update={"controller": controller}), PRODUCT, SEED)


def test_a_signal_leaves_no_half_recording(monkeypatch: pytest.MonkeyPatch) -> None:
    """The controller hears it and ends the run safely."""
    keep = Film.keep

    def signalled(film: Film, exposure: Exposure) -> Frame:
        os.kill(os.getpid(), signal.SIGINT)
        return keep(film, exposure)

    monkeypatch.setattr(Film, "keep", signalled)
    with pytest.raises(KeyboardInterrupt):
        record_beside_robot(CONFIGURATION, PRODUCT, SEED)


def pads(assembly: Assembly, number: int) -> np.ndarray:
    """Where the gripper's fingers are at a moment."""
    geoms = [assembly.world.model.geom(name).id for name in ("pad_left", "pad_right")]
    return np.array(assembly.moments[number].exposure.moments[-1][GEOM_POSITIONS][geoms])


@pytest.mark.slow
def test_person_and_robot_build_the_bracket_together() -> None:
    assembly = record_beside_robot(CONFIGURATION, PRODUCT, SEED)
    last = assembly.moments[-1]
    found = holes_of(Source(assembly, PRODUCT, BENCH), last)
    assert {position: part for position, (part, _) in found.items()} == dict(PRODUCT.goal_placements(assembly.goal))
    bodies = assembly.world.bodies
    went_m = np.linalg.norm(last.parts_m - assembly.moments[0].parts_m, axis=1)
    assert {body.owner for body, way_m in zip(bodies, went_m, strict=True) if way_m > 0.1} == {"person", "robot"}
    placed = [label for label in assembly.labels if label.kind == "assembly"]
    assert {label.position for label in placed} < set(PRODUCT.positions)


@pytest.mark.long
def test_the_arm_is_where_the_controller_moved_it(assembly: Assembly) -> None:
    moved = [
        np.abs(pads(assembly, after) - pads(assembly, before)).max() > 1e-3
        for before, after in pairwise(range(len(assembly.moments)))
    ]
    assert 0.2 < np.mean(moved) < 0.95
    parked = range(5, 6)  # it has not begun to move
    seen = next(hand_frames(Source(assembly, PRODUCT, BENCH), [parked]))
    assert np.array_equal(seen.poses[GEOM_POSITIONS], assembly.moments[5].exposure.moments[-1][GEOM_POSITIONS])


def test_segments_are_written_as_of_any_recording(assembly: Assembly, tmp_path: Path) -> None:
    write_segments(Source(assembly, PRODUCT, BENCH), DataFolder(tmp_path / "new", "test"), thin=True)
    _, *rows = [json.loads(line) for line in (tmp_path / "new" / "segments.jsonl").read_text().splitlines()]
    assert {row["truth"]["kind"] for row in rows} >= {"assembly", "transit", "idle"}
