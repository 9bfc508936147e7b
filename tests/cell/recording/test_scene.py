"""What viewers show of a log follows from what the log says."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from bracket_cell.configuration import load_configuration, load_product
from bracket_cell.recording.recorder import Heading, McapRecorder
from bracket_cell.recording.scene import CellModel
from bracket_cell.runs.assembled import tool_on_bench_m
from bracket_cell.settings import LogSettings
from bracket_cell.skills.motion.planner import MotionPlanner
from bracket_cell.watching.observer import SentCommand, TickRecord
from bracket_ground.interfaces.command import Command, Display
from bracket_ground.interfaces.observation import ArmState, GripperState, ObjectStatus, Observation
from bracket_ground.interfaces.perception import Action, BenchView, HandSample, HoleView, PartDetection, PartsView
from bracket_ground.interfaces.pose import Pose
from tests.cell.fakes import frame
from tests.cell.recording.test_recorder import OUTCOME
from tests.cell.viewing.viewer import decoded, topics, world_from

JOINTS_RAD = (0.4, -1.2, 1.7, -2.0, -1.5, 0.3)
OPENING_M = 0.05


@pytest.fixture(scope="module")
def cell() -> CellModel:
    configuration = load_configuration()
    product = load_product(configuration)
    return CellModel(product, configuration.bench, MotionPlanner(product, configuration.bench, configuration.motion))


def seen(tick: int, **fields: Any) -> Observation:
    time_s = tick * 0.04
    gripper = GripperState(time_s, True, ObjectStatus.AT_POSITION, OPENING_M, 0.0, 0)
    return Observation(tick, time_s, ArmState(time_s, JOINTS_RAD, (0.0,) * 6, False), gripper, **fields)


def record(observation: Observation, notes: Any = (), display: Display | None = None) -> TickRecord:
    return TickRecord(observation, "RUNNING", (), notes, Command(display=display), SentCommand(), 0.001, False)


def written(path: Path, cell: CellModel, *records: TickRecord) -> dict[str, list[Any]]:
    recorder = McapRecorder(path, LogSettings(), Heading(), cell)
    recorder.frame(frame(0, 0.0))
    for tick_record in records:
        recorder.tick(tick_record)
    recorder.close(OUTCOME)
    return decoded(path)


def test_frames_lead_from_the_world_to_the_tool_as_kinematics_do(tmp_path: Path, cell: CellModel) -> None:
    found = written(tmp_path / "log.mcap", cell, record(seen(0)))
    frames = {
        transform.child_frame_id: transform
        for topic in ("/tf/robot", "/tf/bench")
        for transform in found[topic][0].transforms
    }
    assert world_from(frames, "tool") == pytest.approx(
        cell.motion.kinematics.forward(np.array(JOINTS_RAD)).matrix, abs=1e-9
    )
    assert world_from(frames, "bracket")[:3, 3] == pytest.approx(cell.bench.bracket.position_m)
    left, right = (world_from(frames, f"finger_{side}")[:3, 3] for side in ("left", "right"))
    assert np.linalg.norm(left - right) == pytest.approx(OPENING_M + 0.012)


def test_an_arm_that_stands_writes_no_frames(tmp_path: Path, cell: CellModel) -> None:
    found = written(tmp_path / "log.mcap", cell, *(record(seen(tick)) for tick in range(5)))
    assert len(found["/tf/robot"]) == 1
    assert len(found["/joint_states"]) == 5
    assert [joint.position for joint in found["/joint_states"][4].joints] == list(JOINTS_RAD)


def test_every_body_stands_in_a_known_frame(tmp_path: Path, cell: CellModel) -> None:
    found = written(tmp_path / "log.mcap", cell, record(seen(0)))
    frames = {"world"} | {
        transform.child_frame_id for topic in ("/tf/robot", "/tf/bench") for transform in found[topic][0].transforms
    }
    bodies = [body for topic in ("/scene/robot", "/scene/bench") for body in found[topic][0].entities]
    assert {"forearm_link", "palm", "finger_left", "bench", "holes"} <= {body.id for body in bodies}
    assert {body.frame_id for body in bodies} <= frames
    hull = next(body for body in bodies if body.id == "forearm_link").triangles[0]
    assert max(hull.indices) < len(hull.points)
    assert len(hull.indices) % 3 == 0


def test_the_hand_and_the_holes_are_drawn_where_they_were_seen(tmp_path: Path, cell: CellModel) -> None:
    hand = HandSample(0.0, (10, 20, 60, 80), (0.7, 0.1), (0.8, 0.1), "o2")
    holes = {"p1": HoleView("o1", 1.0, 0.0), "p2": HoleView(None, 1.0, 0.0), "p3": HoleView("o3", 1.0, 0.0, False)}
    view = BenchView(0, 0.0, hand, holes, Action("idle", 1.0))
    gone = BenchView(1, 0.04, None, holes, Action("idle", 1.0))
    found = written(tmp_path / "log.mcap", cell, record(seen(0, bench=view)), record(seen(1, bench=gone)))
    first, second = found["/camera/overhead/hand"]
    assert {(p.x, p.y) for p in first.points[0].points} == {(10, 20), (60, 20), (60, 80), (10, 80)}
    assert any("o2" in text.text for text in first.texts)
    assert not second.points, "a hand that is gone is not shown any longer"
    volume, gone_too = found["/scene/hands"]
    [wall] = volume.entities[0].triangles
    across = {round(abs(point.y - 0.1), 6) for point in wall.points if point.z == 0.0}
    assert len(wall.points) == 8
    assert max(across) + min(across) >= 2 * cell.motion.separation.settings.hand_radius_m
    assert set(wall.indices) == set(range(8))
    assert not gone_too.entities
    assert gone_too.deletions
    [marks] = found["/camera/overhead/holes"]
    assert [text.text for text in marks.texts] == ["p1 o1", "p2 -", "p3 o3 tilted", "p4 ?", "p5 ?", "p6 ?"]
    camera, bracket = cell.bench.overhead, cell.bench.bracket.pose
    expected = camera.model.project(camera.mount.pose, bracket.transform(np.array([[0.0, 0.200, 0.0]])))[0]
    assert (marks.circles[0].position.x, marks.circles[0].position.y) == pytest.approx(tuple(expected))


def test_parts_and_beliefs_replace_those_before(tmp_path: Path, cell: CellModel) -> None:
    part = PartDetection("o2", 0.9, Pose.from_yaw((0.5, -0.4, 0.016), 0.3), (0.065, 0.034, 0.045), (1, 2, 30, 40))
    view = PartsView(0, 0.0, (part,))
    belief = (("belief", {"placed": {"p3": "o1"}, "goals": {"g0": 1.0}}),)
    found = written(
        tmp_path / "log.mcap",
        cell,
        record(seen(0, parts=view), belief, Display(guidance={"o1": ("p1", "p3"), "o2": ("p4",)})),
        record(seen(1, parts=view)),
        record(seen(2, parts=PartsView(1, 0.08, ()))),
    )
    one, none = found["/scene/parts"]
    assert one.entities[0].cubes[0].pose.position.z == pytest.approx(0.016 + 0.045 / 2)
    assert [d.type for d in none.deletions] == [1]
    assert not none.entities
    assert [text.text for text in found["/camera/wrist/parts"][0].texts] == ["0: o2 0.90"]
    bodies = {body.id: body.cubes[0].color.a for body in found["/scene/assembly"][-1].entities}
    assert bodies == {"o1 at p3": 1.0, "o1 at p1": pytest.approx(0.3), "o2 at p4": pytest.approx(0.3)}


def test_images_and_their_calibration_share_a_frame(tmp_path: Path, cell: CellModel) -> None:
    found = written(tmp_path / "log.mcap", cell, record(seen(0)))
    image, calibration = found["/camera/overhead"][0], found["/camera/overhead/calibration"][0]
    assert image.frame_id == calibration.frame_id == found["/tf/camera_overhead"][0].child_frame_id
    assert list(calibration.K) == cell.bench.overhead.model.matrix.ravel().tolist()
    assert topics(tmp_path / "log.mcap")["/camera/overhead"] == "foxglove.CompressedImage"


@pytest.mark.parametrize("told", [JOINTS_RAD[:-1], (*JOINTS_RAD, 0.1), (math.nan, *JOINTS_RAD[1:])])
def test_what_the_arm_tells_is_written_as_it_is(tmp_path: Path, cell: CellModel, told: tuple[float, ...]) -> None:
    """A log holds the ticks of a fault: those in which the arm tells a joint too few, too many, or no number."""
    wrong = replace(seen(1), arm=ArmState(0.04, told, (0.0,) * 6, False))
    found = written(tmp_path / "log.mcap", cell, record(seen(0)), record(wrong), record(seen(2)))
    joints = [[joint.position for joint in states.joints] for states in found["/joint_states"]]
    assert np.array_equal(joints[1], told[:6], equal_nan=True)
    assert joints[2] == pytest.approx(JOINTS_RAD)
    assert len(found["/tf/robot"]) == 1, "where its links are nobody knows"


def test_the_tool_of_an_arm_that_does_not_tell_is_near_nothing(cell: CellModel) -> None:
    kinematics = cell.motion.kinematics
    assert max(tool_on_bench_m(kinematics, seen(0))) < 2
    few = replace(seen(1), arm=ArmState(0.04, JOINTS_RAD[:-1], (0.0,) * 6, False))
    assert tool_on_bench_m(kinematics, few) == (math.inf, math.inf)
