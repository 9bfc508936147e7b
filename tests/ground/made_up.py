"""Drivers of a made-up maker that know nothing but the ground: an arm of seven joints, and 60 mm fingers."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np

from bracket_ground.contracts import arm, gripper
from bracket_ground.errors import DeviceFault
from bracket_ground.interfaces.clock import ManualClock
from bracket_ground.interfaces.command import GripperCommand, JointTrajectory
from bracket_ground.interfaces.devices import KEEP_ALIVE_S
from bracket_ground.interfaces.observation import ArmState, GripperState, JointSamples, ObjectStatus
from bracket_ground.interfaces.paced_path import PacedPath

PERIOD_S, STROKE_M = 0.004, 0.060
BLOCKED = ("bracket_cell", "bracket_sim", "bracket_lab", "btxml", "pytest")


class AcmeArm:
    """Seven joints that are where their set points are."""

    def __init__(self, clock: ManualClock, joints: int = 7) -> None:
        self._clock, self._path = clock, PacedPath(np.zeros(joints), PERIOD_S, np.full(joints, 5.0))
        self._at_s, self._paced_s, self._share, self._stopped = 0.0, 0.0, 0.0, False
        self._kept = [(0.0, np.zeros(joints), np.zeros(joints))]

    def state(self) -> ArmState:
        self._catch_up()
        at_s, joints, speeds = self._kept[-1]
        return ArmState(
            at_s,
            tuple(joints.tolist()),
            tuple(speeds.tolist()),
            self._path.moving,
            "protective_stop" if self._stopped else "normal",
            self._path.path_s if self._path.moving else None,
            "it met something" if self._stopped else "",
        )

    def follow(self, trajectory: JointTrajectory) -> JointTrajectory:
        if self._stopped:
            raise DeviceFault("arm", "a protective stop waits for somebody")
        self._catch_up()
        self._path.follow(trajectory, 1.0)
        return trajectory

    def stop(self) -> None:
        self._catch_up()
        self._path.stop()

    def pace(self, share: float) -> None:
        self._catch_up()
        self._share, self._paced_s = share, self._clock.now_s()

    def acknowledge(self) -> None:
        self._stopped = False

    def samples(self) -> JointSamples | None:
        self._catch_up()
        times, joints, speeds = (np.array(rows) for rows in zip(*self._kept, strict=True))
        self._kept = self._kept[-1:]
        new = len(times) - 1
        return JointSamples(times[-new:], joints[-new:], speeds[-new:], np.zeros_like(joints[-new:])) if new else None

    def meet_something(self) -> None:
        self._path.stand(self._path.at_rad)
        self._stopped = True

    def _catch_up(self) -> None:
        while self._at_s + PERIOD_S <= self._clock.now_s() + 1e-9:
            self._at_s += PERIOD_S
            alive = self._at_s - self._paced_s < KEEP_ALIVE_S
            before = self._kept[-1][1]
            joints = self._path.advance(self._share if alive else 0.0, PERIOD_S)
            self._kept.append((self._at_s, joints, (joints - before) / PERIOD_S))


class AcmeGripper:
    """Fingers that go at their speed until they are there, or at a part."""

    def __init__(self, clock: ManualClock) -> None:
        self._clock, self._at_s, self._since_s = clock, 0.0, float("inf")
        self._opening_m = self._goal_m = STROKE_M
        self._speed_m_s, self.part_m = 0.01, 0.0

    def state(self) -> GripperState:
        self._catch_up()
        held = self._goal_m < self.part_m and self._opening_m == self.part_m
        there = ObjectStatus.CONTACT_CLOSING if held else ObjectStatus.AT_POSITION
        status = there if held or self._opening_m == self._goal_m else ObjectStatus.MOVING
        return GripperState(self._at_s, self._clock.now_s() > self._since_s + 0.5, status, self._opening_m, 0.0, 0)

    def activate(self) -> None:
        self._since_s = min(self._since_s, self._clock.now_s())

    def command(self, command: GripperCommand) -> GripperCommand:
        self._catch_up()
        cut = (np.clip(command.opening_m, 0, STROKE_M), np.clip(command.speed_m_s, 0.01, 0.2))
        sent = replace(
            command, opening_m=float(cut[0]), speed_m_s=float(cut[1]), force_n=float(np.clip(command.force_n, 5, 80))
        )
        self._goal_m, self._speed_m_s = sent.opening_m, sent.speed_m_s
        return sent

    def hold(self) -> None:
        self._catch_up()
        if self._goal_m >= self.part_m or self._opening_m != self.part_m:
            self._goal_m = self._opening_m

    def close(self) -> None:
        """Nothing is open."""

    def _catch_up(self) -> None:
        step_m = self._speed_m_s * (self._clock.now_s() - self._at_s)
        self._at_s = self._clock.now_s()
        least_m = self.part_m if self._opening_m >= self.part_m else 0.0
        wanted_m = max(self._goal_m, least_m)
        self._opening_m += float(np.clip(wanted_m - self._opening_m, -step_m, step_m))


class DeafArm(AcmeArm):
    """It goes on when it hears nothing, and tells no stop."""

    def pace(self, share: float) -> None:
        super().pace(max(share, 1.0))


class StrongGripper(AcmeGripper):
    """It says that it does what it was asked for, whatever that is."""

    def command(self, command: GripperCommand) -> GripperCommand:
        super().command(command)
        return command


def _run(check: Callable[[Any], None], bench_of: Callable[[Any], Any], driver: type) -> None:
    """One check of a driver, on a bench of its own."""
    check(bench_of(driver))


def failed(kind: str) -> list[str]:
    """The checks that a driver of this kind does not pass."""
    checks: dict[str, Callable[[], None]] = {}
    for name, made in (("arm", AcmeArm), ("deaf arm", DeafArm)):
        for check in arm.CHECKS if kind == name else ():
            checks[check.__name__] = partial(_run, check, arm_bench, made)
    for name, fingers in (("gripper", AcmeGripper), ("strong gripper", StrongGripper)):
        for grip in gripper.CHECKS if kind == name else ():
            checks[grip.__name__] = partial(_run, grip, gripper_bench, fingers)
    assert checks
    wrong = []
    for name, run in checks.items():
        try:
            run()
        except AssertionError:
            wrong.append(name)
    return wrong


def arm_bench(made: type[AcmeArm]) -> arm.Bench:
    clock = ManualClock()
    acme = made(clock)
    return arm.Bench(acme, clock, acme.meet_something)


def gripper_bench(made: type[AcmeGripper]) -> gripper.Bench:
    clock = ManualClock()
    fingers = made(clock)
    return gripper.Bench(fingers, clock, lambda width_m: setattr(fingers, "part_m", width_m), STROKE_M, (0.01, 0.2))
