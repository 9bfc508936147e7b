"""Contact: where the arm could clamp a hand it closes no gap faster than ISO/TS 15066 has it; elsewhere it may."""

from __future__ import annotations

import math
import re
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from bracket_cell.skills.motion.arm_outline import turned
from bracket_cell.skills.motion.contact import CONTACT, ContactMap, clamp_m_s
from bracket_cell.skills.motion.planner import Load
from bracket_cell.skills.motion.separation import SEPARATION, SeparationMonitor
from bracket_ground.interfaces.pose import Array, Pose
from bracket_ground.interfaces.robot import RobotModel, default_robot, load_robot
from tests.integration.cell_rig import BENCH, motion_planner

STEP_S = 0.04
PLATE_M = np.array([(x, y, z) for x in (0.0, 0.4) for y in (-0.2, 0.2) for z in (-0.1, 0.0)])
MAP = ContactMap([PLATE_M])
SPEEDS = st.floats(-0.5, 0.5)


def cube(*centres_m: tuple[float, float, float]) -> Array:
    """Corners (3, 8, K, 1) of a cube of 4 cm at K places."""
    corners = np.array([(x, y, z) for x in (-0.02, 0.02) for y in (-0.02, 0.02) for z in (-0.02, 0.02)])
    return turned((np.array(centres_m)[:, np.newaxis] + corners)[:, np.newaxis])


def heavier(tool_kg: float) -> RobotModel:
    robot = default_robot()
    return robot.model_copy(update={"gripper": robot.gripper.model_copy(update={"with_part_kg": tool_kg})})


def test_the_limit_is_that_of_the_contact_model() -> None:
    """ISO/TS 15066, A.3.4: F**2 / 2 k = m_R v**2 / 2; the UR10's links weigh 28.7 kg by its URDF."""
    robot = default_robot()
    assert robot.moving_kg == pytest.approx(28.7)
    mass_kg = 28.7 / 2 + robot.gripper.loaded_kg
    assert CONTACT.stiffness_n_m * mass_kg * clamp_m_s(robot, 140.0) ** 2 == pytest.approx(140.0**2)


@given(st.floats(0.1, 20.0), st.floats(0.1, 20.0))
def test_a_heavier_tool_is_never_faster(one_kg: float, other_kg: float) -> None:
    light, heavy = sorted((one_kg, other_kg))
    assert clamp_m_s(heavier(heavy), 140.0) <= clamp_m_s(heavier(light), 140.0)


def test_an_arm_without_masses_counts_as_a_heavy_one(tmp_path: Path) -> None:
    text = re.sub("<inertial>.*?</inertial>", "", default_robot().urdf_text, flags=re.DOTALL)
    (tmp_path / "arm.urdf").write_text(text)
    own = default_robot().model_dump(mode="json", exclude_none=True) | {"urdf": "arm.urdf"}
    (tmp_path / "arm.yaml").write_text(str(own))
    robot = load_robot("arm.yaml", tmp_path)
    assert robot.moving_kg == 0
    assert clamp_m_s(robot, 140.0) < clamp_m_s(default_robot(), 140.0)


@given(SPEEDS, SPEEDS, SPEEDS)
@settings(max_examples=60, deadline=None)
def test_over_a_plate_only_the_way_down_closes_a_gap(x: float, y: float, z: float) -> None:
    start = np.array([0.2, 0.0, 0.08])
    found = MAP.closing_m_s(cube(tuple(start), tuple(start + STEP_S * np.array([x, y, z]))), STEP_S)
    assert found.shape == (1, 1)
    assert float(found[0, 0]) == pytest.approx(max(0.0, -z), abs=1e-9)


def test_beside_a_wall_only_the_way_to_it_does() -> None:
    at = (-0.10, 0.0, -0.05)  # below the plate's upper side, 8 cm before its edge
    for way, closing in (((0.008, 0.0, 0.0), 0.2), ((-0.008, 0.0, 0.0), 0.0), ((0.0, 0.008, 0.0), 0.0)):
        to = tuple(float(a + b) for a, b in zip(at, way, strict=True))
        assert float(MAP.closing_m_s(cube(at, to), STEP_S)[0, 0]) == pytest.approx(closing)  # type: ignore[arg-type]


def test_a_gap_that_clamps_nothing_does_not_count() -> None:
    high = CONTACT.gap_m + 0.05
    assert not MAP.closing_m_s(cube((0.2, 0.0, high), (0.2, 0.0, high - 0.01)), STEP_S).any()
    assert MAP.closing_m_s(cube((0.2, 0.0, math.nan), (0.2, 0.0, math.nan)), STEP_S)[0, 0] != 0


def monitor(clamp_n: float | None) -> SeparationMonitor:
    own = motion_planner()
    separation = own.settings.separation.model_copy(update={"clamp_n": clamp_n})
    return type(own)(own.product, BENCH, own.settings.model_copy(update={"separation": separation})).separation


def test_a_slow_arm_closes_no_gap_faster_than_that() -> None:
    """Straight down to the bracket, at full speed."""
    planner = motion_planner()
    start, place = np.array(BENCH.arm_look_rad), Pose((0.72, 0.14, 0.40), (0.0, 1.0, 0.0, 0.0))
    above = planner.reach([place], start, Load(0.04))
    assert not isinstance(above, str), above
    path = planner.straight_move(above[1], Pose((0.72, 0.14, 0.10), above[0].quaternion_wxyz), Load(0.04))
    assert not isinstance(path, str), path
    limit_m_s, own = clamp_m_s(default_robot(), 140.0), monitor(140.0)
    times: Array = np.arange(0.0, path.duration_s, SEPARATION.mark_s, dtype=np.float64)
    corners = turned(own.outline.corners_m(own.outline.placed(path.along(times))))
    closing_m_s = float(own.contacts.closing_m_s(corners, SEPARATION.mark_s).max())
    assert closing_m_s > limit_m_s
    assert closing_m_s * own.slow_share(path) <= limit_m_s + 1e-6
    assert own.slow_share(path) < monitor(None).slow_share(path)
