"""One contract for both executors: answers in the order of the jobs, no waiting, a bounded backlog, faults told."""

from __future__ import annotations

import os
import signal
import time
from collections.abc import Callable, Iterator

import numpy as np
import pytest

from bracket_cell.remote.detecting import DetectByCamera
from bracket_cell.remote.worker import NotAnswering, await_ready
from bracket_cell.running.inference import BACKLOG, DetectorExecutor, Executor, LockStep
from bracket_ground.errors import DeviceFault
from bracket_ground.interfaces.clock import ManualClock
from bracket_ground.interfaces.frame import Frame
from bracket_ground.interfaces.perception import Action, BenchView
from bracket_ground.interfaces.pose import Pose

PATIENCE_S = 30.0
SHAPE = 12, 16, 3


def frame(number: int, shape: tuple[int, ...] = SHAPE) -> Frame:
    return Frame("overhead", number, 0.0, np.full(shape, number, np.uint8), Pose((0.0, 0.0, 1.0)))


def look(seen: Frame) -> BenchView:
    """Answers with the number of the frame, and what its image shows."""
    assert (seen.image == seen.image[0, 0, 0]).all()
    return BenchView(seen.sequence, float(seen.image[0, 0, 0]), None, {}, Action("idle", 1.0))


def build_looking() -> DetectByCamera:
    return {"overhead": look}


def build_dying() -> DetectByCamera:
    return {"overhead": lambda seen: os._exit(seen.sequence)}


def build_failing() -> DetectByCamera:
    return {"overhead": lambda seen: look(frame(seen.sequence // 0))}


def build_refusing() -> DetectByCamera:
    raise ZeroDivisionError("as it began")


def build_sleeping_maker() -> DetectByCamera:
    time.sleep(PATIENCE_S)
    return build_looking()


def build_sleepy() -> DetectByCamera:
    def answer(seen: Frame) -> BenchView:
        time.sleep(PATIENCE_S)
        return look(seen)

    return {"overhead": answer}


def process(build: Callable[[], DetectByCamera], silent_s: float = PATIENCE_S) -> DetectorExecutor[BenchView]:
    return DetectorExecutor("detector", "overhead", SHAPE, build, silent_s)


def pid(executor: DetectorExecutor[BenchView]) -> int:
    return executor.process.child.process_id


class Case:
    """An executor, and how to let time pass for it."""

    def __init__(self, executor: Executor[Frame, BenchView], wait: Callable[[], None]) -> None:
        self.executor = executor
        self._wait = wait

    def next_answer(self) -> tuple[int, float]:
        deadline_s = time.monotonic() + PATIENCE_S
        while (answer := self.executor.poll()) is None:
            assert time.monotonic() < deadline_s, "no answer came"
            self._wait()
        return answer.sequence, answer.time_s


def beside(executor: DetectorExecutor[BenchView]) -> Case:
    return Case(executor, lambda: time.sleep(0.001))


@pytest.fixture(params=["lock step", "process"])
def case(request: pytest.FixtureRequest) -> Iterator[Case]:
    if request.param == "lock step":
        clock = ManualClock()
        made = Case(LockStep(look, clock, 0.5), lambda: clock.sleep_until(clock.now_s() + 0.1))
    else:
        made = beside(process(build_looking))
    yield made
    made.executor.close()
    made.executor.close()


def test_answers_come_in_the_order_of_their_jobs(case: Case) -> None:
    assert case.executor.poll() is None
    for number in range(BACKLOG):
        assert case.executor.submit(frame(number))
    assert [case.next_answer() for _ in range(BACKLOG)] == [(number, number) for number in range(BACKLOG)]
    assert case.executor.poll() is None
    assert case.executor.submit(frame(12))
    assert case.next_answer() == (12, 12)


def test_an_image_of_another_size_is_seen_too(case: Case) -> None:
    case.executor.submit(frame(7, (4, 6, 3)))
    assert case.next_answer() == (7, 7)


def test_an_answer_is_not_there_before_its_latency() -> None:
    clock = ManualClock()
    executor = LockStep(look, clock, 0.5)
    executor.submit(frame(3))
    clock.sleep_until(0.499)
    assert executor.poll() is None
    clock.sleep_until(0.5)
    assert executor.poll() == look(frame(3))


def test_jobs_beyond_the_backlog_are_refused() -> None:
    executors: list[Executor[Frame, BenchView]] = [LockStep(look, ManualClock(), 0.5), process(build_sleepy)]
    for executor in executors:
        assert [executor.submit(frame(number)) for number in range(BACKLOG + 1)] == [True] * BACKLOG + [False]
        executor.close()


def test_a_process_outlives_signals_that_are_meant_for_the_controller() -> None:
    executor = process(build_looking)
    case = beside(executor)
    executor.submit(frame(2))
    assert case.next_answer() == (2, 2)
    for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
        os.kill(pid(executor), number)
    executor.submit(frame(3))
    assert case.next_answer() == (3, 3)
    executor.close()


@pytest.mark.parametrize(
    ("build", "words"),
    [(build_dying, "exit code 7"), (build_failing, "ZeroDivisionError"), (build_refusing, "ZeroDivisionError")],
)
def test_a_process_that_dies_or_fails_is_a_fault(build: Callable[[], DetectByCamera], words: str) -> None:
    executor = process(build)
    executor.submit(frame(7))
    with pytest.raises(DeviceFault, match=rf"detector \(pid {pid(executor)}\): .*{words}"):
        beside(executor).next_answer()
    executor.close()


def test_a_process_that_somebody_stopped_is_named_and_may_go_on() -> None:
    executor = process(build_looking, silent_s=0.0)
    await_ready(executor.process)
    os.kill(pid(executor), signal.SIGSTOP)
    executor.submit(frame(1))
    with pytest.raises(NotAnswering, match=rf"detector \(pid {pid(executor)}\): does not answer for \d+\.\d s"):
        executor.poll()
    os.kill(pid(executor), signal.SIGCONT)
    while not executor.process.arrived(executor._waiting[0]):
        time.sleep(0.001)
    assert executor.poll() == look(frame(1))
    executor.close()


def test_a_process_that_is_stopped_while_it_begins_is_not_waited_for() -> None:
    executor = process(build_sleeping_maker)
    os.kill(pid(executor), signal.SIGSTOP)
    with pytest.raises(DeviceFault, match=rf"detector \(pid {pid(executor)}\): somebody stopped it"):
        await_ready(executor.process)
    executor.close()


def test_one_that_has_nothing_to_do_is_asked_whether_it_is_there() -> None:
    executor = process(build_looking, silent_s=0.3)
    await_ready(executor.process)
    os.kill(pid(executor), signal.SIGSTOP)
    with pytest.raises(NotAnswering):
        beside(executor).next_answer()
    executor.close()
