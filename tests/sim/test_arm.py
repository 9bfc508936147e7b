"""The simulated arm: follows what it may follow, stops within its limits, refuses the rest."""

from __future__ import annotations

import re

import numpy as np
import pytest
from pydantic import ValidationError

from bracket_ground.errors import DeviceFault
from bracket_ground.interfaces.bench import Bench
from bracket_ground.interfaces.command import JointTrajectory
from bracket_ground.interfaces.pose import Array
from bracket_sim.devices.arm import KEPT_SAMPLES
from bracket_sim.scene.settings import PhysicsSettings
from tests.sim.conftest import MakeRig
from tests.sim.rig import Rig

PERIOD_S = 0.008


def ramp(rig: Rig, goal_rad: Array, duration_s: float) -> JointTrajectory:
    """Minimum-jerk joint motion from where the arm is."""
    start = np.array(rig.cell.arm.state().positions_rad)
    times: Array = np.linspace(0.0, duration_s, round(duration_s / PERIOD_S) + 1)
    phase = times / duration_s
    progress = 10 * phase**3 - 15 * phase**4 + 6 * phase**5
    return JointTrajectory(times, start + np.outer(progress, goal_rad - start))


def test_the_arm_tracks_and_arrives(make_rig: MakeRig, bench: Bench) -> None:
    rig = make_rig()
    goal = np.array(bench.arm_look_rad)
    rig.cell.arm.follow(ramp(rig, goal, 3.0))
    errors = []
    while rig.cell.arm.state().moving:
        rig.wait(0.04)
        errors.append(rig.cell.arm.tracking_error_rad)
    assert len(errors) == 75
    assert max(errors) < 0.005
    rig.wait(0.2)
    np.testing.assert_allclose(rig.cell.arm.state().positions_rad, goal, atol=5e-4)


def test_an_arm_in_physics_that_came_to_no_finite_state_tells_no_state_that_others_would_believe(
    make_rig: MakeRig,
) -> None:
    rig = make_rig()
    world = rig.cell.world
    world.data.qvel[world.arm_qvel[0]] = np.nan
    world.step_period()  # MuJoCo begins anew, and joints seem to be faster than they can be
    world.step_period()
    with pytest.raises(DeviceFault, match="simulation: its physics came to no finite state"):
        rig.cell.arm.state()


def test_a_stop_stays_on_the_path_and_within_the_limit(make_rig: MakeRig, bench: Bench) -> None:
    rig = make_rig()
    arm = rig.cell.arm
    start = np.array(arm.state().positions_rad)
    trajectory = ramp(rig, np.array(bench.arm_look_rad), 3.0)
    arm.follow(trajectory)
    rig.wait(1.5)
    arm.stop()
    speeds = [np.array(arm.state().velocities_rad_s)]
    while arm.state().moving:
        rig.wait(PERIOD_S)
        speeds.append(np.array(arm.state().velocities_rad_s))
    rig.wait(0.3)
    decelerations = np.abs(np.diff(speeds, axis=0)).max(axis=0) / PERIOD_S
    assert (decelerations < 1.5 * np.array(rig.cell.world.robot.acceleration_rad_s2)).all()
    stopped = np.array(arm.state().positions_rad)
    travel = trajectory.positions_rad[-1] - start
    share = (stopped - start) @ travel / (travel @ travel)
    assert 0.5 < share < 0.7
    np.testing.assert_allclose(stopped, start + share * travel, atol=2e-3)
    assert np.abs(arm.state().velocities_rad_s).max() < 1e-3


def test_a_held_arm_stands_on_its_path_and_goes_on_to_its_end(make_rig: MakeRig, bench: Bench) -> None:
    rig = make_rig()
    arm, clock = rig.cell.arm, rig.cell.devices.clock
    start, goal = np.array(arm.state().positions_rad), np.array(bench.arm_look_rad)
    trajectory = ramp(rig, goal, 3.0)
    arm.follow(trajectory)
    shares = [1.0] * 30 + [0.0] * 40 + [0.3] * 40 + [1.0] * 60
    speeds = []
    for share in shares:
        arm.pace(share)
        clock.sleep_until(clock.now_s() + 0.04)
        state = arm.state()
        speeds.append(np.abs(state.velocities_rad_s).max())
        assert state.path_s is not None
        assert np.abs(np.array(state.positions_rad) - trajectory.at(state.path_s)).max() < 0.02
    assert max(speeds[55:70]) < 1e-3
    assert arm.state().moving is False
    np.testing.assert_allclose(arm.state().positions_rad, goal, atol=5e-4)
    assert not np.allclose(start, goal)


def test_an_arm_that_nobody_paces_stands_still_by_itself(make_rig: MakeRig, bench: Bench) -> None:
    rig = make_rig()
    arm, clock = rig.cell.arm, rig.cell.devices.clock
    arm.follow(ramp(rig, np.array(bench.arm_look_rad), 3.0))
    rig.wait(1.5)
    clock.sleep_until(clock.now_s() + 0.2 + 0.8)
    state = arm.state()
    assert state.moving
    assert state.stands
    rig.wait(3.0)
    assert not arm.state().moving


def test_a_stop_of_a_standing_arm_is_harmless(make_rig: MakeRig) -> None:
    rig = make_rig()
    before = rig.cell.arm.state().positions_rad
    rig.cell.arm.stop()
    rig.wait(0.2)
    np.testing.assert_allclose(rig.cell.arm.state().positions_rad, before, atol=1e-5)


def test_an_arm_that_is_held_back_stops_and_says_why(make_rig: MakeRig, bench: Bench) -> None:
    rig = make_rig()
    rig.cell.arm.follow(ramp(rig, np.array(bench.arm_look_rad), 3.0))
    rig.cell.world.data.qfrc_applied[rig.cell.world.arm_qvel[0]] = 2000.0
    rig.wait(1.0)
    state = rig.cell.arm.state()
    assert state.mode == "protective_stop"
    assert re.search(r"protective stop: shoulder_pan is .* rad from its trajectory, limit", state.reason)


def test_an_arm_that_meets_something_stops_and_says_why(make_rig: MakeRig, bench: Bench) -> None:
    rig = make_rig()
    rig.cell.arm.follow(ramp(rig, np.array(bench.arm_look_rad), 3.0))
    rig.wait(3.2)
    into_the_table = np.array(bench.arm_look_rad)
    into_the_table[1] += 0.8
    rig.cell.arm.follow(ramp(rig, into_the_table, 3.0))
    rig.wait(3.2)
    state = rig.cell.arm.state()
    assert state.mode == "protective_stop"
    assert re.search(r"protective stop: something pushes the tool with \d+ N, limit 150 N", state.reason)
    with pytest.raises(DeviceFault, match="protective stop"):
        rig.cell.arm.follow(ramp(rig, np.array(bench.arm_look_rad), 3.0))
    rig.cell.arm.acknowledge()
    assert rig.cell.arm.state().mode == "normal"


def test_a_knock_between_two_control_periods_stops_the_arm(make_rig: MakeRig) -> None:
    rig = make_rig()
    shoulder = rig.cell.world.arm_qvel[1]
    rig.cell.world.data.qfrc_constraint[shoulder] = 500.0
    rig.cell.arm.observe(0.002)
    rig.cell.world.data.qfrc_constraint[shoulder] = 0.0
    rig.wait(0.02)
    assert "something pushes the tool" in rig.cell.arm.state().reason


def test_joints_are_measured_at_500_hz_and_handed_out_once(make_rig: MakeRig, bench: Bench) -> None:
    rig = make_rig()
    arm = rig.cell.arm
    arm.follow(ramp(rig, np.array(bench.arm_look_rad), 3.0))
    found = []
    for _ in range(5):
        rig.wait(0.04)
        found.append(arm.samples())
        assert found[-1].positions_rad[-1].tolist() == list(arm.state().positions_rad)
        assert found[-1].times_s[-1] == pytest.approx(arm.state().time_s)
    assert [samples.positions_rad.shape for samples in found] == [(20, 6)] * 5
    times_s = np.concatenate([samples.times_s for samples in found])
    np.testing.assert_allclose(np.diff(times_s), 0.002, atol=1e-9)
    positions = np.concatenate([samples.positions_rad for samples in found])
    speeds = np.concatenate([samples.velocities_rad_s for samples in found])
    np.testing.assert_allclose(np.diff(positions, axis=0)[50:] / 0.002, speeds[51:], atol=0.02)
    assert np.abs(found[-1].efforts_nm).max() > 0.1
    assert len(arm.samples().times_s) == 0


def test_samples_that_nobody_takes_are_bounded_and_the_newest_stay(make_rig: MakeRig) -> None:
    rig = make_rig()
    for number in range(KEPT_SAMPLES + 10):
        rig.cell.arm.observe(float(number))
    kept = rig.cell.arm.samples().times_s
    assert kept.tolist() == [float(number) for number in range(10, KEPT_SAMPLES + 10)]


def test_measuring_within_a_control_period_changes_no_motion(make_rig: MakeRig) -> None:
    one, other = make_rig().cell.world, make_rig().cell.world
    for world in (one, other):
        world.data.ctrl[world.arm_ctrl] += 0.05
    for _ in range(50):
        one.step_period()
        for _ in range(4):
            other.step_sample()
    assert (one.data.qpos == other.data.qpos).all()
    assert (one.data.qvel == other.data.qvel).all()


@pytest.mark.parametrize("sample_s", [0.0015, 0.003, 0.0002])
def test_a_sample_period_that_does_not_fit_is_refused(sample_s: float) -> None:
    with pytest.raises(ValidationError, match=r"sample_period_s .* must be a whole number of steps of 0\.001 s"):
        PhysicsSettings(sample_period_s=sample_s)
