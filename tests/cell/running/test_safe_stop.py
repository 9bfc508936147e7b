"""A stop that is one: whatever comes while the run ends, arm and gripper are brought to rest and told of truthfully."""

from __future__ import annotations

import os
import signal
import sys
from dataclasses import replace
from types import FrameType
from typing import Any

import pytest

from bracket_cell.running import controller as controller_module
from bracket_cell.running.safe_stop import condition
from bracket_cell.watching.observer import Outcome, TickRecord
from bracket_ground.errors import DeviceFault
from bracket_ground.interfaces.observation import ArmState, GripperState, ObjectStatus, Observation
from bracket_ground.interfaces.operator import OperatorOrder
from btxml.engine.status import Status
from tests.cell.fakes import FakeObserver, FakeTree, Rig


def forever(_: int) -> Status:
    return Status.RUNNING


class SignalAtLine:
    """Sends SIGINT when the nth line of the controller is about to run, counted from the first signal on."""

    def __init__(self, nth: int) -> None:
        self.nth, self.seen, self.sent = nth, 0, False

    def trace(self, frame: FrameType, event: str, _: Any) -> Any:
        if frame.f_code.co_filename != controller_module.__file__:
            return None
        if event == "line":
            self.seen += 1
            if self.seen == self.nth:
                self.sent = True
                os.kill(os.getpid(), signal.SIGINT)
                os.kill(os.getpid(), signal.SIGINT)
        return self.trace


def test_signals_at_every_line_of_the_controller_end_in_a_stop_of_arm_and_gripper() -> None:
    """A5: a second signal between the loop and the stop left the arm running."""
    nth = 0
    while True:
        nth += 1
        rig, at = Rig(), SignalAtLine(nth)

        def act(tick: int, at: SignalAtLine = at) -> Status:
            if tick == 1:
                os.kill(os.getpid(), signal.SIGTERM)
                sys.settrace(at.trace)
                frame: FrameType | None = sys._getframe()
                while frame is not None:
                    frame.f_trace = at.trace
                    frame = frame.f_back
            return Status.RUNNING

        try:
            outcome, tree = rig.run(act)
        finally:
            sys.settrace(None)
        assert outcome.end == "interrupted", (nth, outcome)
        assert rig.arm.calls[-1] == "stop"
        assert rig.gripper.calls[-1] == "hold"
        assert tree.halts == 1
        assert len(rig.observer.outcomes) == 1
        if not at.sent:
            break
    assert nth > 100


def test_a_tick_that_raises_while_two_signals_come_still_stops() -> None:
    rig = Rig()

    class Nasty(Exception):
        def __str__(self) -> str:
            os.kill(os.getpid(), signal.SIGINT)
            os.kill(os.getpid(), signal.SIGINT)
            raise RuntimeError("no words")

    def act(tick: int) -> Status:
        if tick == 2:
            raise Nasty
        return Status.RUNNING

    outcome, _ = rig.run(act)
    assert (outcome.end, outcome.reason) == ("fault", "Nasty")
    assert rig.arm.calls[-1] == "stop"


@pytest.mark.parametrize("error", [SystemExit(0), GeneratorExit(), MemoryError(), RecursionError()])
def test_whatever_a_node_raises_is_a_safe_stop(error: BaseException) -> None:
    rig = Rig()

    def act(tick: int) -> Status:
        if tick == 2:
            raise error
        return Status.RUNNING

    outcome, _ = rig.run(act)
    assert outcome.exit_status == 3
    assert rig.arm.calls[-1] == "stop"


def test_an_arm_that_does_not_answer_is_not_said_to_stand() -> None:
    """A6: nobody waited, and the failed stop was hidden behind the same words."""
    rig = Rig()

    def act(tick: int) -> Status:
        if tick == 2:
            rig.arm.stop_error = ConnectionResetError("RTDE connection lost")

            def lost() -> ArmState:
                raise ConnectionResetError("RTDE connection lost")

            rig.arm.state = lost  # type: ignore[method-assign]
        return Status.RUNNING

    outcome, _ = rig.run(act)
    assert outcome.exit_status == 3
    assert "the arm did not stop: ConnectionResetError: RTDE connection lost" in outcome.reason
    assert "the arm did not come to rest: not known to stand 2 s after the stop" in outcome.reason
    assert outcome.condition == "the arm is not known to stand, the gripper holds nothing"


@pytest.mark.parametrize("refusal", [DeviceFault("arm", "busy"), SystemExit(0)])
def test_a_stop_that_fails_once_is_ordered_again(refusal: BaseException) -> None:
    rig = Rig()
    calls: list[str] = []

    def stop() -> None:
        calls.append("stop")
        if len(calls) == 1:
            raise refusal

    rig.arm.stop = stop  # type: ignore[method-assign]
    rig.arm.coast_polls = 0
    states = iter([True, True, False])

    def state() -> ArmState:
        moving = bool(calls) and next(states, False)
        return ArmState(rig.clock.now_s(), (0.0,) * 6, (0.0,) * 6, moving)

    rig.arm.state = state  # type: ignore[method-assign]
    outcome, _ = rig.run(lambda tick: Status.SUCCESS if tick == 1 else Status.RUNNING)
    assert calls == ["stop", "stop"]
    assert outcome.end == "finished"


def test_the_stop_keeps_arm_and_gripper_alive_and_is_recorded() -> None:
    """B10: no record stood between the last tick and standstill, and the gripper was not asked."""
    rig = Rig()
    rig.arm.coast_polls = 8
    asked: list[float] = []
    plain = rig.gripper.state

    def state() -> GripperState:
        asked.append(rig.clock.now_s())
        return plain()

    rig.gripper.state = state  # type: ignore[method-assign]
    rig.run(lambda tick: Status.SUCCESS if tick == 1 else Status.RUNNING)
    stopping = [record for record in rig.observer.records if record.status == "STOPPING"]
    assert len(stopping) == 9
    assert asked[-1] == pytest.approx(stopping[-1].observation.time_s)
    assert rig.arm.shares[-9:] == [0.0] * 9
    assert all(record.judgement is not None and record.judgement.speed_scale == 0 for record in stopping)


def test_the_summary_tells_what_the_gripper_holds() -> None:
    rig = Rig()
    rig.services.memory.held_part = "o3"
    held = GripperState(0.0, True, ObjectStatus.CONTACT_CLOSING, 0.04, 0.0, 0)

    def state() -> GripperState:
        return GripperState(**{**vars(held), "time_s": rig.clock.now_s()})

    rig.gripper.state = state  # type: ignore[method-assign]
    outcome, _ = rig.run(lambda _: Status.SUCCESS)
    assert outcome.condition == "the arm stands, the gripper holds o3"


def test_an_emergency_stop_leaves_the_gripper_alone() -> None:
    rig = Rig()

    def act(tick: int) -> Status:
        if tick == 2:
            plain = rig.arm.state

            def pressed() -> ArmState:
                return ArmState(**{**vars(plain()), "mode": "emergency_stop"})

            rig.arm.state = pressed  # type: ignore[method-assign]
        return Status.RUNNING if tick < 5 else Status.FAILURE

    outcome, _ = rig.run(act)
    assert (outcome.end, outcome.reason) == ("failed", "the tree failed")
    assert "hold" not in rig.gripper.calls


class Broken(FakeObserver):
    """An observer that raises wherever it is asked."""

    def tick(self, record: TickRecord) -> None:  # noqa: ARG002
        raise OSError(27, "File too large")

    def close(self, outcome: Outcome) -> None:  # noqa: ARG002
        raise OSError(28, "No space left on device")


def test_observers_never_change_how_a_run_ends() -> None:
    """B8: a witness that raised stopped the cell; a contact sheet on a full disk made exit status 3 of it."""
    broken, sound = Broken(), FakeObserver()
    rig = Rig(observers=[broken, sound])
    outcome, tree = rig.run(lambda tick: Status.SUCCESS if tick == 5 else Status.RUNNING)
    assert (outcome.end, outcome.exit_status, tree.ticks) == ("finished", 0, 6)
    assert len(outcome.observer_problems) == 2
    assert "File too large" in outcome.observer_problems[0]
    assert len(sound.outcomes) == 1
    told = [line for line in sound.messages if "an observer failed" in line]
    assert len(told) == 2


def test_a_hold_makes_nobody_move_and_a_paused_node_goes_on() -> None:
    rig = Rig()
    allowed: list[float] = []

    def act(tick: int) -> Status:
        seen: Observation = rig.services.now.observation
        allowed.append(seen.speed_scale)
        if tick == 3:
            rig.arm.mode = "safeguard_stop"
        if tick == 10:
            rig.arm.mode = "normal"
            rig.operator.put(OperatorOrder("acknowledge"))
        if tick == 11:
            rig.operator.put(OperatorOrder("resume"))
        return Status.SUCCESS if tick == 40 else Status.RUNNING

    outcome, tree = rig.run(act)
    assert outcome.end == "finished"
    assert allowed[:4] == [1.0] * 4
    assert allowed[4:23] == [0.0] * 19  # while it is open, and half a second beyond
    assert set(allowed[24:]) == {1.0}
    assert isinstance(tree, FakeTree)
    worked = [record.observation.worked_s for record in rig.observer.records]
    assert worked[24] - worked[5] < 0.1


KNOWN = GripperState(1.0, True, ObjectStatus.CONTACT_CLOSING, 0.027, 0.1, 0)
EMPTY = replace(KNOWN, object_status=ObjectStatus.AT_POSITION)


@pytest.mark.parametrize(
    ("gripper", "part", "told"),
    [
        (KNOWN, "o1", "the gripper holds o1"),
        (EMPTY, "o1", "the gripper holds nothing"),
        (EMPTY, "", "the gripper holds nothing"),
        (replace(EMPTY, time_s=0.8), "o1", "nothing is known of the gripper; it may hold o1"),
        (replace(EMPTY, time_s=0.8), "", "nothing is known of the gripper; it may hold a part"),
        (replace(EMPTY, echoed=False), "o1", "nothing is known of the gripper; it may hold o1"),
        (replace(EMPTY, activated=False), "o1", "nothing is known of the gripper; it may hold o1"),
        (replace(EMPTY, activated=False), "", "nothing is known of the gripper; it may hold a part"),
        (replace(EMPTY, object_status=ObjectStatus.MOVING), "o1", "nothing is known of the gripper; it may hold o1"),
        (replace(KNOWN, time_s=float("nan")), "o1", "nothing is known of the gripper; it may hold o1"),
    ],
)
def test_the_last_line_never_says_that_the_gripper_is_empty_where_that_is_not_known(
    gripper: GripperState, part: str, told: str
) -> None:
    seen = Observation(25, 1.0, ArmState(1.0, (0.0,) * 6, (0.0,) * 6, False), gripper)
    assert condition(seen, part) == f"the arm stands, {told}"


@pytest.mark.parametrize("time_s", [0.9, 1.2, float("nan")])
def test_the_last_line_never_says_that_the_arm_stands_where_its_state_is_not_of_now(time_s: float) -> None:
    seen = Observation(25, 1.0, ArmState(time_s, (0.0,) * 6, (0.0,) * 6, False), KNOWN)
    assert condition(seen, "o1") == "the arm is not known to stand, the gripper holds o1"
