"""How parts lie, told from rendered images of the wrist camera, against the simulator's truth."""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import cache

import numpy as np
import pytest

from bracket_cell.learned.parts.lying_fit import LyingFitter
from bracket_cell.learned.parts.lying_parts import LyingPartResolver, covers
from bracket_cell.wiring.detectors import Detectors
from bracket_ground.interfaces.frame import Frame
from bracket_ground.interfaces.perception import PartDetection
from bracket_ground.interfaces.pose import Pose
from bracket_ground.interfaces.resting_pose import SIDES, UPRIGHT, rest_on
from bracket_lab.drawing.trays import TrayCamera
from bracket_sim.scene.clutter import sample_clutter
from bracket_sim.scene.settings import ClutterSettings
from bracket_sim.truth.labels import resting_parts
from tests.benchmarks.perception_accuracy import look, open_sim
from tests.learned.classical.scenes import BENCH, CONFIGURATION, PRODUCT

FLOOR_M = BENCH.tray.centre_m[2]


@cache
def camera() -> TrayCamera:
    return TrayCamera(PRODUCT, BENCH)


def lying(part: str, up: str, x_m: float, y_m: float, yaw_rad: float) -> Pose:
    rest = rest_on(PRODUCT.parts[part], up)
    assert rest is not None
    return Pose.from_yaw((x_m, y_m, FLOOR_M), yaw_rad) @ rest


def sorted_out(parts: Sequence[tuple[str, Pose]]) -> tuple[tuple[PartDetection, ...], tuple[PartDetection, ...]]:
    image, pose = camera().take(parts)
    frame = Frame("wrist", 0, 0.0, image, pose)
    return LyingPartResolver(BENCH, PRODUCT).sort(
        frame, Detectors(BENCH, PRODUCT, CONFIGURATION.perception).make("parts").detect(frame)
    )


def tilt_deg(first: Pose, second: Pose, axis: int) -> float:
    return math.degrees(math.acos(min(1.0, float(first.rotation[:, axis] @ second.rotation[:, axis]))))


@pytest.mark.parametrize("up", SIDES)
@pytest.mark.parametrize("part", PRODUCT.parts)
def test_it_is_told_how_a_part_lies(part: str, up: str) -> None:
    rng = np.random.default_rng([SIDES.index(up), int(part[1])])
    true = lying(part, up, 0.56 + rng.uniform(-0.06, 0.06), -0.38 + rng.uniform(-0.1, 0.1), rng.uniform(-3, 3))
    standing, others = sorted_out([(part, true)])
    assert standing == ()
    assert [(other.part, other.upright) for other in others] == [(part, False)]
    told = others[0].lies
    assert told is not None
    middle = np.array([0.0, 0.0, PRODUCT.parts[part].size_m[2] / 2])
    assert np.linalg.norm(told.transform(middle) - true.transform(middle)) < 0.003
    assert tilt_deg(told, true, 2) < 6


def test_parts_that_lie_beside_others_are_told_each_once() -> None:
    scene = [
        ("o2", lying("o2", "+y", 0.50, -0.46, 0.5)),
        ("o1", lying("o1", "+x", 0.62, -0.45, 2.0)),
        ("o3", lying("o3", UPRIGHT, 0.50, -0.30, 1.0)),
        ("o1", lying("o1", UPRIGHT, 0.60, -0.33, -0.4)),
    ]
    standing, others = sorted_out(scene)
    assert sorted(detection.part for detection in standing) == ["o1", "o3"]
    assert sorted(other.part for other in others) == ["o1", "o2"]
    for part, true in scene[:2]:
        told = next(other.lies for other in others if other.part == part)
        assert told is not None
        assert np.linalg.norm(np.subtract(told.position_m, true.position_m)) < 0.004


def test_a_part_that_was_told_to_stand_and_lies_is_told_to_lie() -> None:
    true = lying("o3", "+x", 0.56, -0.38, 0.7)
    image, pose = camera().take([("o3", true)])
    frame = Frame("wrist", 0, 0.0, image, pose)
    found = Detectors(BENCH, PRODUCT, CONFIGURATION.perception).make("parts").detect(frame)
    wrong = PartDetection(
        "o3", 0.6, lying("o3", UPRIGHT, 0.56, -0.38, 0.7), PRODUCT.parts["o3"].size_m, found[0].box_px
    )
    standing, others = LyingPartResolver(BENCH, PRODUCT).sort(frame, [wrong])
    assert standing == ()
    assert others[0].lies is not None
    assert tilt_deg(others[0].lies, true, 2) < 6


def test_what_lies_where_a_part_stands_is_that_part() -> None:
    part = PartDetection("o2", 0.9, Pose.from_yaw((0.5, -0.4, 0.016), 0.5), PRODUCT.parts["o2"].size_m, (0, 0, 9, 9))
    inside = PartDetection("o1", 0.4, Pose((0.51, -0.4, 0.004)), (0.1, 0.1, 0.1), (0, 0, 9, 9), upright=False)
    beside = PartDetection("o1", 0.4, Pose((0.56, -0.4, 0.004)), (0.1, 0.1, 0.1), (0, 0, 9, 9), upright=False)
    assert covers(part, inside)
    assert not covers(part, beside)


def test_a_thing_of_no_type_is_not_told_to_be_a_part_that_lies() -> None:
    seed = 8000501
    rng = np.random.default_rng(seed)
    settings = ClutterSettings(lying_share=0.5, foreign_objects=3)
    clutter = sample_clutter(PRODUCT, BENCH.tray, ["o1", "o2", "o3", "o2"], rng, settings)
    cell = open_sim(CONFIGURATION, PRODUCT, seed, worker=False, clutter=clutter)
    cell.world.set_arm(BENCH.arm_look_rad)
    frame, truth = look(cell), resting_parts(cell.world)
    found = Detectors(BENCH, PRODUCT, CONFIGURATION.perception).make("parts").detect(frame)
    cell.close()
    told = [
        detection for detection in LyingPartResolver(BENCH, PRODUCT).sort(frame, found)[1] if detection.lies is not None
    ]
    assert told
    for detection in told:
        assert detection.lies is not None
        there = detection.lies.position_m[:2]
        nearest = min(truth, key=lambda each: math.dist(each.world_from_part.position_m[:2], there))
        assert nearest.part == detection.part


def test_what_a_silhouette_of_a_third_of_a_part_says_does_not_count() -> None:
    """A small part between two higher ones, whose boxes hide most of its own."""
    scene = [
        ("o3", lying("o3", UPRIGHT, 0.5954, -0.2619, -0.731)),
        ("o1", lying("o1", UPRIGHT, 0.5579, -0.2887, 2.739)),
        ("o2", lying("o2", UPRIGHT, 0.5179, -0.2601, -1.844)),
    ]
    standing, others = sorted_out(scene)
    assert sorted(detection.part for detection in standing) == ["o1", "o2", "o3"]
    assert others == ()


def test_what_is_doubtful_is_looked_at_once(monkeypatch: pytest.MonkeyPatch) -> None:
    """A thing comes once for each type that it may be of, and nothing else is near it: one look tells as much."""
    image, pose = camera().take([("o1", lying("o1", "+y", 0.56, -0.38, 0.4))])
    looks: list[str] = []
    monkeypatch.setattr(LyingFitter, "fit", lambda *_: looks.append("look"))
    found = [
        PartDetection(part, sure, Pose((0.56, -0.38, FLOOR_M)), (0.05, 0.03, 0.02), (200, 150, 240, 190), upright=False)
        for part, sure in (("unknown", 0.6), ("o1", 0.5), ("o2", 0.4))
    ]
    standing, others = LyingPartResolver(BENCH, PRODUCT).sort(Frame("wrist", 0, 0.0, image, pose), found)
    assert (len(standing), len(others)) == (0, 3)
    assert looks == ["look"]
