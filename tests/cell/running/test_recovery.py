"""What can be cleared goes on: an acknowledged protective stop, a gripper that restarted with empty fingers."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import pytest

from bracket_cell.running.device_writer import DeviceActor, GripperHold
from bracket_ground.interfaces.clock import ManualClock
from bracket_ground.interfaces.command import Command, GripperCommand, JointTrajectory
from bracket_ground.interfaces.faults import Action, SafetyDecision
from bracket_ground.interfaces.observation import ArmState, GripperState, ObjectStatus, Observation
from bracket_ground.interfaces.operator import OperatorOrder
from btxml.engine.status import Status
from tests.cell.fakes import PARKED, FakeGripper, Rig

OPEN = GripperCommand(0.085, 0.1, 40.0)


@dataclass
class RestartingGripper(FakeGripper):
    """Loses its activation when it is told to, and has it again once it was activated."""

    lost: bool = False
    held: bool = False

    def state(self) -> GripperState:
        status = ObjectStatus.CONTACT_CLOSING if self.held else ObjectStatus.AT_POSITION
        return replace(super().state(), activated=not self.lost, object_status=status)

    def activate(self) -> None:
        super().activate()
        self.lost = False


def restarting() -> tuple[Rig, RestartingGripper]:
    """A rig with such a gripper."""
    rig = Rig(gripper=RestartingGripper)
    assert isinstance(rig.gripper, RestartingGripper)
    return rig, rig.gripper


def test_an_empty_gripper_that_restarted_is_activated_once_somebody_acknowledged_it_and_told_its_goal_again() -> None:
    rig, gripper = restarting()
    calls: list[list[str]] = []

    def act(tick: int) -> Status:
        if tick == 0:
            rig.services.now.command.gripper = OPEN
        if tick == 3:
            gripper.lost = True
        calls.append(list(gripper.calls))
        if tick == 10:
            rig.operator.put(OperatorOrder("acknowledge"))
        if tick == 20:
            rig.operator.put(OperatorOrder("resume"))
        return Status.SUCCESS if tick == 40 else Status.RUNNING

    outcome, _ = rig.run(act)
    assert outcome.end == "finished"
    assert calls[20] == ["command"], "nothing moves before somebody said so, twice"
    assert calls[40] == ["command", "activate", "command"]


@dataclass
class GrippingGripper(FakeGripper):
    """Holds a part of 27 mm; a knock makes the fingers move for a moment."""

    moving: bool = False
    opening_m: float = 0.027

    def state(self) -> GripperState:
        status = ObjectStatus.MOVING if self.moving else ObjectStatus.CONTACT_CLOSING
        return replace(super().state(), object_status=status, opening_m=self.opening_m)


@pytest.mark.parametrize(("opening_m", "stopped"), [(0.0275, False), (0.02, True)])
def test_fingers_that_grip_keep_their_force_while_the_arm_is_held_and_a_hand_knocks_them(
    opening_m: float, stopped: bool
) -> None:
    rig = Rig(gripper=GrippingGripper)
    gripper = rig.gripper
    assert isinstance(gripper, GrippingGripper)
    calls: list[str] = []

    def act(tick: int) -> Status:
        if tick == 0:
            rig.services.now.command.gripper = GripperCommand(0.0, 0.1, 40.0)
        if tick == 5:
            rig.arm.mode = "safeguard_stop"
        gripper.moving = tick == 8  # without its force the part would fall out
        gripper.opening_m = opening_m if tick >= 8 else 0.027
        calls.extend(gripper.calls if tick == 20 else ())
        return Status.SUCCESS if tick == 20 else Status.RUNNING

    rig.run(act)
    assert "command" in calls
    assert ("hold" in calls) == stopped


def test_fingers_that_were_sent_off_again_after_a_hold_grip_nothing_so_far() -> None:
    """They lost their part, and were stopped; where they once gripped it says nothing about the way they go on."""
    gripper = GrippingGripper(ManualClock())
    fingers = GripperHold(gripper)
    fingers.sent(GripperCommand(0.0, 0.1, 40.0))

    def tick(opening_m: float, *, moving: bool, held: bool) -> None:
        gripper.moving, gripper.opening_m = moving, opening_m
        arm = ArmState(0.0, PARKED, (0.0,) * 6, moving=False)
        fingers.keep(Observation(0, 0.0, arm, gripper.state()), SafetyDecision(Action.HOLD if held else Action.RUN))

    tick(0.027, moving=False, held=False)
    tick(0.020, moving=True, held=True)
    tick(0.020, moving=True, held=False)
    assert gripper.calls == ["hold", "command"]
    tick(0.025, moving=True, held=True)
    assert gripper.calls == ["hold", "command", "hold"]


def test_a_gripper_that_restarted_is_left_alone_as_long_as_nobody_acknowledges() -> None:
    rig, gripper = restarting()

    def act(tick: int) -> Status:
        gripper.lost = tick >= 3
        rig.services.now.command.activate_gripper = tick == 8
        return Status.SUCCESS if tick == 30 else Status.RUNNING

    rig.run(act)
    assert "activate" not in gripper.calls
    assert rig.arm.shares[-20:] == [0.0] * 20


def test_one_with_a_part_between_its_fingers_ends_the_run_and_is_not_activated() -> None:
    rig, gripper = restarting()
    gripper.held = True

    def act(tick: int) -> Status:
        gripper.lost = tick >= 3
        rig.operator.put(OperatorOrder("acknowledge"))
        return Status.RUNNING

    outcome, _ = rig.run(act)
    assert (outcome.end, outcome.exit_status) == ("fault", 3)
    assert "with a part between its fingers" in outcome.reason
    assert "activate" not in gripper.calls


def test_a_protective_stop_is_unlocked_by_an_acknowledgement_and_goes_on() -> None:
    rig = Rig()
    commands: list[Command] = []

    def act(tick: int) -> Status:
        if tick == 3:
            rig.arm.mode = "protective_stop"
        if tick == 10:
            rig.operator.put(OperatorOrder("acknowledge"))
        if "acknowledge" in rig.arm.calls:
            rig.arm.mode = "normal"
        if tick == 60:
            rig.operator.put(OperatorOrder("resume"))
        commands.append(rig.services.now.command)
        return Status.SUCCESS if tick == 80 else Status.RUNNING

    outcome, _ = rig.run(act)
    assert outcome.end == "finished"
    assert rig.arm.calls.count("acknowledge") == 2, "once more with the order to go on"
    assert set(rig.arm.shares[8:60]) == {0.0}, "to acknowledge it starts no motion"
    assert rig.arm.shares[80] == 1.0


def test_an_arm_that_is_held_off_its_path_is_an_alarm_and_gives_the_path_up_once_that_is_acknowledged() -> None:
    rig = Rig()
    calls: list[list[str]] = []
    early: list[str] = []

    def act(tick: int) -> Status:
        if tick == 3:
            rig.services.now.command.follow = JointTrajectory(np.array([0.0, 1.0]), np.array([PARKED, (0.1,) * 6]))
            rig.arm.positions_rad = (0.05,) * 6
        early.extend(rig.panel.alarms if tick == 200 else ())
        if tick == 300:
            rig.operator.put(OperatorOrder("acknowledge"))
        if tick == 325:
            rig.operator.put(OperatorOrder("resume"))
        calls.append(list(rig.arm.calls))
        return Status.SUCCESS if tick == 340 else Status.RUNNING

    outcome, _ = rig.run(act)
    assert outcome.end == "finished"
    assert early == []
    alarm, gone = rig.panel.alarms
    assert (alarm, gone) == ("the arm does not follow its trajectory; acknowledge it when it may go on", "")
    assert sum(text.endswith(alarm) for text in rig.observer.messages) == 1
    assert sum(text.endswith("acknowledged by the operator") for text in rig.observer.messages) == 1
    assert "stop" not in calls[300]
    assert calls[320].count("stop") == 1
    assert set(rig.arm.shares[300:325]) == {0.0}
    assert rig.arm.shares[340] == 1.0


def test_what_waits_for_a_person_is_an_alarm_on_the_panel_until_somebody_acknowledged_it() -> None:
    rig = Rig()

    def act(tick: int) -> Status:
        if tick == 3:
            rig.arm.mode = "protective_stop"
        if tick == 20:
            assert len(rig.panel.alarms) == 1
            rig.operator.put(OperatorOrder("acknowledge"))
        if "acknowledge" in rig.arm.calls:
            rig.arm.mode = "normal"
        return Status.SUCCESS if tick == 60 else Status.RUNNING

    rig.run(act)
    alarm, gone = rig.panel.alarms
    assert alarm.startswith("protective stop")
    assert alarm.endswith("acknowledge it when it may go on")
    assert gone == ""
    assert any(text.endswith("acknowledge it when it may go on") for text in rig.observer.messages)


@pytest.mark.parametrize("unasked", [False, True])
def test_an_arm_whose_safeguard_closed_is_brought_back_unasked_only_where_its_row_says_so(unasked: bool) -> None:
    rig, refused = Rig(), list[object]()
    actor = DeviceActor(rig.devices, rig.operator, lambda *what: refused.append(what))
    actor.act(Command(), rig.controller.observe(), SafetyDecision(Action.HOLD, 0.0, brings_back=unasked))
    assert ("acknowledge" in rig.arm.calls) == unasked
    assert not refused
