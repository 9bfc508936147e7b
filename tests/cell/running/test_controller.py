"""The loop: rate, commands, answers, and a safe stop however it ends."""

from __future__ import annotations

import os
import signal
from collections.abc import Callable

import numpy as np
import pytest

from bracket_cell.settings import ControllerSettings
from bracket_cell.watching.observer import EXIT_STATUS, Outcome, TickRecord
from bracket_ground.errors import DeviceFault
from bracket_ground.interfaces.command import Display, GripperCommand, JointTrajectory
from bracket_ground.interfaces.observation import ArmState
from btxml.engine.status import Status
from tests.cell.fakes import Rig, frame


def after(ticks: int, status: Status) -> Callable[[int], Status]:
    """Running for some ticks, then a status."""
    return lambda tick: status if tick == ticks else Status.RUNNING


def raising(error: BaseException, tick: int = 3) -> Callable[[int], Status]:
    """Running, then an exception."""

    def act(now: int) -> Status:
        if now == tick:
            raise error
        return Status.RUNNING

    return act


def stopped_safely(rig: Rig, halts: int) -> bool:
    """Arm, gripper and tree were stopped, in this order of the devices, and the log was closed once."""
    return (
        rig.arm.calls[-1] == "stop"
        and rig.gripper.calls[-1] == "hold"
        and halts == 1
        and len(rig.observer.outcomes) == 1
    )


def test_ticks_come_at_the_configured_rate() -> None:
    rig = Rig(ControllerSettings(tick_hz=25.0))
    rig.run(after(50, Status.SUCCESS))
    times = [record.observation.time_s for record in rig.observer.records]
    assert np.allclose(np.diff(times), 0.04)
    assert [record.observation.tick for record in rig.observer.records] == list(range(52))
    assert [record.status for record in rig.observer.records][-2:] == ["SUCCESS", "STOPPING"]


def test_an_arm_gives_up_the_path_of_a_controller_that_died() -> None:
    """Else it goes on along it as soon as this controller lets it move, which nobody ordered."""
    rig = Rig()
    rig.arm.state = lambda: ArmState(rig.clock.now_s(), (0.0,) * 6, (0.0,) * 6, "stop" not in rig.arm.calls, path_s=0.5)  # type: ignore[method-assign]
    calls: list[int] = []

    def act(tick: int) -> Status:
        calls.append(rig.arm.calls.count("stop"))
        if tick == 2:
            rig.services.now.command.follow = JointTrajectory(np.array([0.0]), np.zeros((1, 6)))
        return after(4, Status.SUCCESS)(tick)

    rig.run(act)
    assert calls == [0, 1, 1, 1, 1], "once, after the first tick"
    assert rig.arm.calls[:2] == ["stop", "follow"]


@pytest.mark.parametrize(("status", "end"), [(Status.SUCCESS, "finished"), (Status.FAILURE, "failed")])
def test_the_run_ends_with_the_root(status: Status, end: str) -> None:
    rig = Rig()
    outcome, tree = rig.run(after(4, status))
    assert (outcome.end, outcome.ticks) == (end, 5 + 1)
    assert outcome.condition == "the arm stands, the gripper holds nothing"
    assert stopped_safely(rig, tree.halts)


def test_the_run_ends_when_time_is_over() -> None:
    rig = Rig(ControllerSettings(max_duration_s=2.0))
    outcome, tree = rig.run(after(10**6, Status.SUCCESS))
    assert outcome.end == "timeout"
    assert outcome.sim_time_s == pytest.approx(2.0 + 0.04)
    assert stopped_safely(rig, tree.halts)


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM, signal.SIGHUP])
def test_a_signal_ends_the_run_after_its_tick(number: signal.Signals) -> None:
    def act(tick: int) -> Status:
        if tick == 3:
            os.kill(os.getpid(), number)
        return Status.RUNNING

    rig = Rig()
    outcome, tree = rig.run(act)
    assert (outcome.end, outcome.reason, outcome.ticks) == ("interrupted", f"stopped by {number.name}", 4 + 1)
    assert stopped_safely(rig, tree.halts)


def test_a_second_signal_interrupts_a_tick_that_hangs() -> None:
    def act(tick: int) -> Status:
        while tick == 3:
            os.kill(os.getpid(), signal.SIGINT)
        return Status.RUNNING

    rig = Rig()
    outcome, tree = rig.run(act)
    assert outcome.end == "interrupted"
    assert stopped_safely(rig, tree.halts)


def test_signal_handlers_are_as_before_the_run() -> None:
    before = signal.getsignal(signal.SIGINT), signal.getsignal(signal.SIGTERM)
    Rig().run(after(1, Status.SUCCESS))
    assert (signal.getsignal(signal.SIGINT), signal.getsignal(signal.SIGTERM)) == before


def test_a_fault_of_a_device_is_a_safe_stop() -> None:
    rig = Rig()

    def act(tick: int) -> Status:
        if tick == 2:
            rig.gripper.fault = DeviceFault("gripper", "no heartbeat")
        return Status.RUNNING

    outcome, tree = rig.run(act)
    assert (outcome.end, outcome.reason, outcome.exit_status) == ("fault", "gripper: no heartbeat", 3)
    assert stopped_safely(rig, tree.halts)


def test_any_exception_of_a_node_is_a_safe_stop_and_its_tick_is_recorded() -> None:
    rig = Rig()
    error = ZeroDivisionError("division by zero")
    error.add_note("in Leaf (tree.xml:3)")
    outcome, tree = rig.run(raising(error))
    assert (outcome.end, outcome.reason) == ("fault", "ZeroDivisionError: division by zero, in Leaf (tree.xml:3)")
    assert "raising" in outcome.detail or "act" in outcome.detail
    assert [record.status for record in rig.observer.records][-2:] == ["ERROR", "STOPPING"]
    assert len(rig.observer.records) == outcome.ticks == 4 + 1
    assert stopped_safely(rig, tree.halts)


def test_an_interrupted_observer_is_no_fault_of_the_run() -> None:
    """As where it keeps rows of trials, and a signal ended one of them."""
    rig = Rig()

    def tick(record: TickRecord) -> None:
        if record.status != "STOPPING":
            raise KeyboardInterrupt

    rig.observer.tick = tick  # type: ignore[method-assign]
    outcome, tree = rig.run(after(9, Status.SUCCESS))
    assert (outcome.end, outcome.reason) == ("interrupted", "interrupted")
    assert stopped_safely(rig, tree.halts)


def test_a_device_that_fails_to_stop_does_not_keep_the_others_from_stopping() -> None:
    rig = Rig()
    rig.arm.stop_error = DeviceFault("arm", "no answer")
    outcome, tree = rig.run(after(1, Status.SUCCESS))
    assert outcome.end == "fault"
    assert "the arm did not stop: arm: no answer" in outcome.reason
    assert stopped_safely(rig, tree.halts)


def test_a_stop_that_failed_is_told_also_where_the_reason_is_the_same() -> None:
    rig = Rig()
    rig.arm.stop_error = DeviceFault("arm", "connection lost")
    outcome, _ = rig.run(raising(DeviceFault("arm", "connection lost")))
    assert outcome.reason == "arm: connection lost; the arm did not stop: arm: connection lost"


def test_the_run_waits_until_the_arm_stands() -> None:
    rig = Rig()
    rig.arm.coast_polls = 10
    outcome, _ = rig.run(after(0, Status.SUCCESS))
    assert outcome.end == "finished"
    assert rig.clock.now_s() == pytest.approx(11 * 0.04)
    assert [record.status for record in rig.observer.records] == ["SUCCESS"] + ["STOPPING"] * 11


def test_an_arm_that_the_stop_took_off_its_path_is_not_told_to_be_off_it() -> None:
    rig = Rig()
    rig.arm.swing_polls = 10

    def act(tick: int) -> Status:
        if tick == 1:
            rig.services.now.command.follow = JointTrajectory(np.array([0.0, 1.0]), np.array([[0.0] * 6, [1.0] * 6]))
        return after(1, Status.SUCCESS)(tick)

    rig.run(act)
    assert [record.status for record in rig.observer.records].count("STOPPING") > 3
    assert not any("follow its trajectory" in message for message in rig.observer.messages)


def test_an_arm_that_never_stands_is_a_fault() -> None:
    rig = Rig(ControllerSettings(stop_timeout_s=1.0))
    rig.arm.coast_polls = 10**6
    outcome, _ = rig.run(after(0, Status.SUCCESS))
    assert outcome.end == "fault"
    assert "still moving 1 s after the stop" in outcome.reason


def test_a_slow_tick_is_an_overrun() -> None:
    rig = Rig(ControllerSettings(tick_hz=500.0))

    def act(tick: int) -> Status:
        if tick == 1:
            np.linalg.svd(np.random.default_rng(0).normal(size=(300, 300)))  # several periods of 2 ms
        return after(5, Status.SUCCESS)(tick)

    outcome, _ = rig.run(act)
    flagged = [record.observation.tick for record in rig.observer.records if record.overrun]
    assert 1 in flagged
    assert outcome.overruns == len(flagged)
    assert all((record.wall_s > 0.002) == record.overrun for record in rig.observer.records)


def test_commands_reach_the_devices_and_what_was_sent_is_recorded() -> None:
    rig = Rig()
    trajectory = JointTrajectory(np.array([0.0, 1.0]), np.zeros((2, 6)))
    display = Display(message="hello")

    def act(tick: int) -> Status:
        command = rig.services.now.command
        if tick == 0:
            command.follow, command.gripper = trajectory, GripperCommand(0.0404)
            command.activate_gripper = command.look = True
            command.display = display
        return after(2, Status.SUCCESS)(tick)

    rig.run(act)
    assert rig.arm.calls == ["follow", "stop"]
    assert rig.gripper.calls == ["activate", "command", "hold"]
    assert rig.wrist.triggers == 1
    assert rig.panel.shown == [display]
    first, second, *_ = rig.observer.records
    assert first.sent.trajectory is trajectory
    assert first.sent.gripper == GripperCommand(0.040)
    assert second.sent.gripper is None


def test_stop_wins_over_follow() -> None:
    rig = Rig()

    def act(tick: int) -> Status:
        if tick == 0:
            rig.services.now.command.follow = JointTrajectory(np.array([0.0]), np.zeros((1, 6)))
            rig.services.now.command.stop_arm = True
        return after(1, Status.SUCCESS)(tick)

    rig.run(act)
    assert "follow" not in rig.arm.calls


def test_an_answer_is_seen_only_after_its_latency() -> None:
    rig = Rig(latency_s=0.1)
    seen: dict[int, int | None] = {}

    def act(tick: int) -> Status:
        view = rig.services.now.observation.bench
        seen[tick] = None if view is None else view.sequence
        if tick == 0:
            rig.overhead.newest = frame(7)  # observed by tick 1 at 0.04 s, answered at 0.14 s
        return after(6, Status.SUCCESS)(tick)

    rig.run(act)
    assert [seen[tick] for tick in range(7)] == [None, None, None, None, 7, 7, 7]
    assert [one.sequence for one in rig.observer.frames] == [7]


def test_notes_belong_to_the_tick_that_made_them() -> None:
    rig = Rig()

    def act(tick: int) -> Status:
        rig.controller.journal.note("plan", number=tick)
        return after(2, Status.SUCCESS)(tick)

    rig.run(act)
    records = rig.observer.records
    notes = [tuple(note for note in record.notes if note[0] != "cause") for record in records]
    assert notes == [*((("plan", {"number": tick}),) for tick in range(3)), ()]


def test_exit_statuses_are_those_of_the_design() -> None:
    assert EXIT_STATUS == {"finished": 0, "failed": 1, "timeout": 1, "interrupted": 1, "fault": 3}
    assert Outcome("fault", "", 0, 0, 0.0, 0.0).exit_status == 3
