"""Devices that play a log: the contracts of camera, arm and gripper, as far as they can be kept."""

from __future__ import annotations

import pytest

from bracket_cell.configuration import load_configuration
from bracket_cell.log.read.reader import Log
from bracket_cell.log.replay.recorded import RecordedArm, RecordedCamera, RecordedGripper
from bracket_cell.skills.drivers.settings import RecordedSettings
from bracket_ground.contracts import arm, gripper
from bracket_ground.contracts import camera as camera_contract
from bracket_ground.contracts.camera import CHECKS, Check
from bracket_ground.errors import DeviceFault
from bracket_ground.interfaces.clock import ManualClock


@pytest.mark.contract
@pytest.mark.parametrize("check", CHECKS[:-1])
def test_contract_of_a_log(assembly_log: Log, check: Check) -> None:
    clock, bench = ManualClock(), load_configuration().bench
    camera = RecordedCamera(RecordedSettings(log=assembly_log.path), clock, bench, "overhead")
    check(camera_contract.Bench(camera, clock, (bench.overhead.width_px, bench.overhead.height_px)))


@pytest.mark.contract
def test_contract_of_a_recorded_arm_and_gripper(assembly_log: Log) -> None:
    clock, settings = ManualClock(100.0), RecordedSettings(log=assembly_log.path)
    gripper.check_reading(gripper.Bench(RecordedGripper(settings, clock), clock, lambda _: None))
    clock = ManualClock(100.0)
    arm.check_standing(arm.Bench(RecordedArm(settings, clock), clock, lambda: None))


def test_a_log_tells_arm_and_gripper_in_its_order_and_moves_nothing(assembly_log: Log) -> None:
    clock, settings = ManualClock(100.0), RecordedSettings(log=assembly_log.path)
    arm_of_log, gripper_of_log = RecordedArm(settings, clock), RecordedGripper(settings, clock)
    first = assembly_log.ticks[0].observation
    assert arm_of_log.state().positions_rad == first.arm.positions_rad
    assert gripper_of_log.state().opening_m == first.gripper.opening_m
    times_s: list[float] = []
    for _ in range(20):
        clock.sleep_until(clock.now_s() + 0.04)
        assert clock.now_s() - 0.1 <= arm_of_log.state().time_s <= clock.now_s()
        if (samples := arm_of_log.samples()) is not None:
            times_s += samples.times_s.tolist()
    assert len(times_s) > 20
    assert times_s == sorted(set(times_s))
    assert times_s[-1] <= clock.now_s()
    with pytest.raises(DeviceFault, match="follows nothing"):
        arm_of_log.follow(None)  # type: ignore[arg-type]
    arm_of_log.stop()
    clock.sleep_until(1000.0)
    with pytest.raises(DeviceFault, match="the log is over after"):
        gripper_of_log.state()
