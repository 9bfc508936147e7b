"""A robot and cameras as they are: noise, tracking error and latencies are as configured, and ideal is exact."""

from __future__ import annotations

import numpy as np
import pytest
from pydantic import ValidationError

from bracket_cell.skills.drivers.checked_arm import CheckedArm
from bracket_ground.errors import DeviceFault
from bracket_ground.interfaces.bench import Bench
from bracket_ground.interfaces.command import JointTrajectory
from bracket_ground.interfaces.product import Product
from bracket_ground.interfaces.robot import default_robot
from bracket_sim.cell import SimCell
from bracket_sim.devices.sensed_arm import SensedArm
from bracket_sim.scene.settings import SimSettings

PERIOD_S = 0.008


def open_cell(product: Product, bench: Bench, channel: str, **hardware: float) -> SimCell:
    blind = bench.model_copy(update={"overhead": bench.overhead.model_copy(update={"rate_hz": 0.01})})
    values = {
        "joint_noise_rad": 0.0,
        "joint_speed_noise_rad_s": 0.0,
        "trailing_s": 0.0,
        "command_latency_s": 0.0,
        "camera_latency_s": 0.0,
    }
    settings = SimSettings.model_validate({"hardware": values | hardware})
    return SimCell(product, blind, settings, "virtual", channel, 0, "g0", worker=False, clutter=())


def ramp(cell: SimCell, goal_rad: float, duration_s: float) -> JointTrajectory:
    """The first joint at constant speed."""
    start = cell.world.data.qpos[cell.world.arm_qpos].copy()
    path = np.tile(start, (2, 1))
    path[1, 0] += goal_rad
    return JointTrajectory(np.array([0.0, duration_s]), path)


def test_measured_joints_have_the_configured_noise(product: Product, bench: Bench) -> None:
    cell = open_cell(product, bench, "noise", joint_noise_rad=1e-3, joint_speed_noise_rad_s=5e-3)
    errors, speeds = [], []
    for tick in range(100):
        cell.devices.clock.sleep_until(tick * PERIOD_S)
        state = cell.devices.arm.state()
        assert state == cell.devices.arm.state()  # one measurement a period
        errors.append(np.array(state.positions_rad) - cell.world.data.qpos[cell.world.arm_qpos])
        speeds.append(state.velocities_rad_s)
    cell.close()
    assert np.std(errors) == pytest.approx(1e-3, rel=0.15)
    assert np.std(speeds) == pytest.approx(5e-3, rel=0.15)


def test_the_arm_trails_by_the_configured_time(product: Product, bench: Bench) -> None:
    cell = open_cell(product, bench, "trailing", trailing_s=0.03)
    trajectory = ramp(cell, 0.4, 1.0)
    cell.devices.arm.follow(trajectory)
    for tick in range(20):
        cell.devices.arm.pace(1.0)
        cell.devices.clock.sleep_until(0.04 * tick)
    at, told_s = cell.devices.clock.now_s(), cell.devices.arm.state().path_s
    behind = trajectory.positions_rad[0, 0] + 0.4 * at - cell.world.data.qpos[cell.world.arm_qpos[0]]
    cell.close()
    assert behind == pytest.approx(0.4 * 0.03, abs=5e-4)
    assert told_s == pytest.approx(at - 0.03, abs=PERIOD_S)  # where it is, not where it is told to be


def test_a_command_is_taken_up_after_the_latency(product: Product, bench: Bench) -> None:
    began = {}
    for latency_s in (0.0, 0.04):
        cell = open_cell(product, bench, f"latency-{latency_s}", command_latency_s=latency_s, joint_noise_rad=1e-9)
        cell.devices.arm.follow(ramp(cell, 0.2, 0.5))
        assert cell.devices.arm.state().moving
        while not cell.arm.driven_rad_s.any():
            cell.devices.arm.pace(1.0)
            cell.devices.clock.sleep_until(cell.devices.clock.now_s() + PERIOD_S)
        began[latency_s] = cell.devices.clock.now_s()
        cell.close()
    assert began[0.04] - began[0.0] == pytest.approx(0.04)


def test_a_bad_trajectory_is_refused_at_once(product: Product, bench: Bench) -> None:
    cell = open_cell(product, bench, "refused", command_latency_s=0.04)
    with pytest.raises(DeviceFault, match="rad/s"):
        CheckedArm(cell.devices.arm, default_robot()).follow(ramp(cell, 3.0, 0.2))
    cell.close()


def test_frames_come_after_the_latency(product: Product, bench: Bench) -> None:
    cell = open_cell(product, bench, "frames", camera_latency_s=0.05)
    cell.devices.wrist.trigger()
    while (frame := cell.devices.wrist.latest()) is None:
        cell.devices.clock.sleep_until(cell.devices.clock.now_s() + PERIOD_S)
    delay_s = cell.devices.clock.now_s() - frame.time_s
    cell.close()
    assert delay_s == pytest.approx(0.056)  # the first control period after .05 s


def test_hardware_is_named_or_spelled_out() -> None:
    assert SimSettings().hardware == SimSettings.model_validate({"hardware": "ideal"}).hardware
    assert SimSettings.model_validate({"hardware": "ur10_usb"}).hardware.trailing_s == 0.03
    with pytest.raises(ValidationError, match="legal: ideal, ur10_usb"):
        SimSettings.model_validate({"hardware": "ur5"})


def test_an_ideal_robot_is_not_wrapped(product: Product, bench: Bench) -> None:
    cell = open_cell(product, bench, "ideal")
    assert cell.devices.arm is cell.arm
    cell.close()
    real = open_cell(product, bench, "real", joint_noise_rad=1e-6)
    assert isinstance(real.devices.arm, SensedArm)
    real.close()
