"""What every `Gripper` must do, whatever is at the other end of its bus; run by the tests of each node."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from bracket_ground.contracts import TICK_S, require_prompt
from bracket_ground.interfaces.clock import Clock
from bracket_ground.interfaces.command import GripperCommand
from bracket_ground.interfaces.devices import Gripper
from bracket_ground.interfaces.observation import GripperState, ObjectStatus

STEPS = 255  # that an opening is told in at least


@dataclass
class Bench:
    """A gripper with its clock, and how a part gets between its fingers.

    Attributes:
        put_part: a part of this width now stands between the fingers.
        stroke_m: the widest opening.
        speed_m_s, force_n: least and most that a command is cut to; None where the maker does not say.
    """

    gripper: Gripper
    clock: Clock
    put_part: Callable[[float], None]
    stroke_m: float = 0.085
    speed_m_s: tuple[float, float] | None = None
    force_n: tuple[float, float] | None = None

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
    assert abs(state.opening_m - first.opening_m) <= 0.001
    assert not state.activated


def check_no_call_waits(bench: Bench) -> None:
    """No call waits: the tree ticks every 40 ms."""
    require_prompt(state=bench.gripper.state)


def check_activation(bench: Bench) -> None:
    assert not bench.wait(0.2).activated
    bench.activated()
    assert bench.gripper.state().fault == 0


def check_positions_are_reached(bench: Bench) -> None:
    bench.activated()
    for opening_m in (bench.stroke_m, 0.25 * bench.stroke_m, 0.6 * bench.stroke_m):
        sent = bench.gripper.command(GripperCommand(opening_m, 0.15, 60.0))
        assert abs(sent.opening_m - opening_m) <= bench.stroke_m / STEPS
        state = bench.settle()
        assert state.object_status is ObjectStatus.AT_POSITION
        assert abs(state.opening_m - opening_m) <= 0.003
        assert not state.holding


def check_commands_are_cut_to_the_registers(bench: Bench) -> None:
    bench.activated()
    most = bench.gripper.command(GripperCommand(2 * bench.stroke_m, 50.0, 10000.0))
    least = bench.gripper.command(GripperCommand(-1.0, 0.0, 0.0))
    assert np.allclose((most.opening_m, least.opening_m), (bench.stroke_m, 0.0), atol=1e-9)
    assert 0.0 < least.speed_m_s <= most.speed_m_s < 50.0
    assert 0.0 <= least.force_n < most.force_n < 10000.0
    for limits, cut in (
        (bench.speed_m_s, (least.speed_m_s, most.speed_m_s)),
        (bench.force_n, (least.force_n, most.force_n)),
    ):
        assert limits is None or np.allclose(limits, cut)
    again = bench.gripper.command(most)
    assert np.allclose(
        (again.opening_m, again.speed_m_s, again.force_n), (most.opening_m, most.speed_m_s, most.force_n)
    )


def check_a_part_is_held_and_kept(bench: Bench) -> None:
    bench.activated()
    bench.gripper.command(GripperCommand(bench.stroke_m, 0.15, 60.0))
    bench.settle()
    part_m = 0.4 * bench.stroke_m
    bench.put_part(part_m)
    bench.gripper.command(GripperCommand(0.0, 0.15, 60.0))
    state = bench.settle()
    assert state.holding
    assert abs(state.opening_m - part_m) <= 0.003
    bench.gripper.hold()
    assert abs(bench.wait(1.0).opening_m - part_m) <= 0.003


def check_no_stale_status_after_a_command(bench: Bench) -> None:
    bench.activated()
    bench.gripper.command(GripperCommand(bench.stroke_m, 0.15, 60.0))
    bench.settle()
    bench.gripper.command(GripperCommand(0.010, 0.15, 60.0))
    assert bench.gripper.state().object_status is ObjectStatus.MOVING


def check_hold_stops_the_fingers(bench: Bench) -> None:
    bench.activated()
    bench.gripper.command(GripperCommand(bench.stroke_m, 0.15, 60.0))
    bench.settle()
    sent = bench.gripper.command(GripperCommand(0.0, 0.02, 60.0))
    bench.wait(min(0.4, 0.2 * bench.stroke_m / sent.speed_m_s))  # a controller may have a speed of its own
    bench.gripper.hold()
    stopped = bench.wait(0.2)
    assert abs(bench.wait(0.4).opening_m - stopped.opening_m) <= 0.001
    assert stopped.opening_m > 0.7 * bench.stroke_m


CHECKS = (
    check_reading,
    check_no_call_waits,
    check_activation,
    check_positions_are_reached,
    check_commands_are_cut_to_the_registers,
    check_a_part_is_held_and_kept,
    check_no_stale_status_after_a_command,
    check_hold_stops_the_fingers,
)
