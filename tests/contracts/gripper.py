"""What every `Gripper` must do, whatever is at the other end of its bus; run by the tests of each node."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import pytest

from bracket_ground.interfaces.clock import Clock
from bracket_ground.interfaces.command import GripperCommand
from bracket_ground.interfaces.devices import Gripper
from bracket_ground.interfaces.observation import GripperState, ObjectStatus

TICK_S = 0.040
STEP_M = 0.085 / 255


@dataclass
class Bench:
    """A gripper with its clock, and how a part gets between its fingers.

    Attributes:
        put_part: a part of this width now stands between the fingers.
    """

    gripper: Gripper
    clock: Clock
    put_part: Callable[[float], None]

    def wait(self, duration_s: float) -> GripperState:
        """Let time pass in ticks; the state at the end."""
        end_s = self.clock.now_s() + duration_s
        state = self.gripper.state()
        while self.clock.now_s() < end_s:
            self.clock.sleep_until(self.clock.now_s() + TICK_S)
            state = self.gripper.state()
        return state

    def settle(self, limit_s: float = 3.0) -> GripperState:
        """Wait until the fingers rest."""
        self.clock.sleep_until(self.clock.now_s() + TICK_S)
        for _ in range(round(limit_s / TICK_S)):
            state = self.gripper.state()
            if state.object_status is not ObjectStatus.MOVING:
                return state
            self.clock.sleep_until(self.clock.now_s() + TICK_S)
        raise AssertionError("the fingers never came to rest")

    def activated(self) -> GripperState:
        """Activate and wait for it."""
        self.gripper.activate()
        for _ in range(250):
            state = self.wait(TICK_S)
            if state.activated:
                return state
        raise AssertionError("never activated")


def check_reading(bench: Bench) -> None:
    """States are new, not of a time to come, and who reads and holds changes nothing."""
    bench.wait(0.2)
    first = bench.gripper.state()
    bench.gripper.hold()
    state = bench.wait(0.4)
    assert first.time_s < state.time_s <= bench.clock.now_s()
    assert state.opening_m == pytest.approx(first.opening_m, abs=0.001)
    assert not state.activated


def check_activation(bench: Bench) -> None:
    assert not bench.wait(0.2).activated
    bench.activated()
    assert bench.gripper.state().fault == 0


def check_positions_are_reached(bench: Bench) -> None:
    bench.activated()
    for opening_m in (0.085, 0.020, 0.050):
        sent = bench.gripper.command(GripperCommand(opening_m, 0.15, 60.0))
        assert sent.opening_m == pytest.approx(opening_m, abs=STEP_M)
        state = bench.settle()
        assert state.object_status is ObjectStatus.AT_POSITION
        assert state.opening_m == pytest.approx(opening_m, abs=0.003)
        assert not state.holding


def check_commands_are_cut_to_the_registers(bench: Bench) -> None:
    bench.activated()
    sent = bench.gripper.command(GripperCommand(0.2, 5.0, 1000.0))
    assert (sent.opening_m, sent.speed_m_s, sent.force_n) == pytest.approx((0.085, 0.150, 235.0))
    sent = bench.gripper.command(GripperCommand(-1.0, 0.0, 0.0))
    assert (sent.opening_m, sent.speed_m_s, sent.force_n) == pytest.approx((0.0, 0.020, 20.0), abs=1e-9)


def check_a_part_is_held_and_kept(bench: Bench) -> None:
    bench.activated()
    bench.gripper.command(GripperCommand(0.085, 0.15, 60.0))
    bench.settle()
    bench.put_part(0.034)
    bench.gripper.command(GripperCommand(0.0, 0.15, 60.0))
    state = bench.settle()
    assert state.holding
    assert state.opening_m == pytest.approx(0.034, abs=0.003)
    bench.gripper.hold()
    assert bench.wait(1.0).opening_m == pytest.approx(0.034, abs=0.003)


def check_no_stale_status_after_a_command(bench: Bench) -> None:
    bench.activated()
    bench.gripper.command(GripperCommand(0.085, 0.15, 60.0))
    bench.settle()
    bench.gripper.command(GripperCommand(0.010, 0.15, 60.0))
    assert bench.gripper.state().object_status is ObjectStatus.MOVING


def check_hold_stops_the_fingers(bench: Bench) -> None:
    bench.activated()
    bench.gripper.command(GripperCommand(0.085, 0.15, 60.0))
    bench.settle()
    bench.gripper.command(GripperCommand(0.0, 0.02, 60.0))
    bench.wait(0.4)
    bench.gripper.hold()
    stopped = bench.wait(0.2)
    assert bench.wait(0.4).opening_m == pytest.approx(stopped.opening_m, abs=0.001)
    assert stopped.opening_m > 0.060


CHECKS = (
    check_reading,
    check_activation,
    check_positions_are_reached,
    check_commands_are_cut_to_the_registers,
    check_a_part_is_held_and_kept,
    check_no_stale_status_after_a_command,
    check_hold_stops_the_fingers,
)
