"""One contract for both executors: answers in the order of the jobs, no waiting, a bounded backlog, faults told."""

from __future__ import annotations

import os
import signal
import time
from collections.abc import Callable, Iterator

import pytest

from cell.errors import DeviceFault
from cell.interfaces.clock import ManualClock
from cell.running.inference import BACKLOG, Executor, LockStep, WorkerProcess

PATIENCE_S = 30.0


def build_square() -> Callable[[int], int]:
    return lambda number: number * number


def build_dying() -> Callable[[int], int]:
    return lambda number: os._exit(number)


def build_failing() -> Callable[[int], int]:
    return lambda number: 1 // (number - number)


def build_sleepy() -> Callable[[int], int]:
    def answer(number: int) -> int:
        time.sleep(PATIENCE_S)
        return number

    return answer


class Case:
    """An executor, and how to let time pass for it."""

    def __init__(self, executor: Executor[int, int], wait: Callable[[], None]) -> None:
        self.executor = executor
        self._wait = wait

    def next_answer(self) -> int:
        deadline_s = time.monotonic() + PATIENCE_S
        while (answer := self.executor.poll()) is None:
            assert time.monotonic() < deadline_s, "no answer came"
            self._wait()
        return answer


@pytest.fixture(params=["lock step", "worker process"])
def case(request: pytest.FixtureRequest) -> Iterator[Case]:
    if request.param == "lock step":
        clock = ManualClock()
        made = Case(LockStep(build_square(), clock, 0.5), lambda: clock.sleep_until(clock.now_s() + 0.1))
    else:
        made = Case(WorkerProcess("squares", build_square), lambda: time.sleep(0.001))
    yield made
    made.executor.close()
    made.executor.close()


def test_answers_come_in_the_order_of_their_jobs(case: Case) -> None:
    assert case.executor.poll() is None
    for number in range(BACKLOG):
        assert case.executor.submit(number)
    assert [case.next_answer() for _ in range(BACKLOG)] == [number * number for number in range(BACKLOG)]
    assert case.executor.poll() is None
    assert case.executor.submit(12)
    assert case.next_answer() == 144


def test_an_answer_is_not_there_before_its_latency() -> None:
    clock = ManualClock()
    executor = LockStep(build_square(), clock, 0.5)
    executor.submit(3)
    clock.sleep_until(0.499)
    assert executor.poll() is None
    clock.sleep_until(0.5)
    assert executor.poll() == 9


def test_jobs_beyond_the_backlog_are_refused() -> None:
    clock = ManualClock()
    executors: list[Executor[int, int]] = [
        LockStep(build_square(), clock, 0.5),
        WorkerProcess("sleepy", build_sleepy),
    ]
    for executor in executors:
        assert [executor.submit(number) for number in range(BACKLOG + 1)] == [True] * BACKLOG + [False]
        executor.close()


def test_a_worker_outlives_signals_that_are_meant_for_the_controller() -> None:
    executor: WorkerProcess[int, int] = WorkerProcess("squares", build_square)
    case = Case(executor, lambda: time.sleep(0.001))
    executor.submit(2)
    assert case.next_answer() == 4
    for number in (signal.SIGINT, signal.SIGTERM):
        os.kill(executor.process_id, number)
    executor.submit(3)
    assert case.next_answer() == 9
    executor.close()


@pytest.mark.parametrize(("build", "words"), [(build_dying, "exit code 7"), (build_failing, "ZeroDivisionError")])
def test_a_worker_that_dies_or_fails_is_a_fault(build: Callable[[], Callable[[int], int]], words: str) -> None:
    executor: WorkerProcess[int, int] = WorkerProcess("detector", build)
    executor.submit(7)
    with pytest.raises(DeviceFault, match=f"detector: .*{words}"):
        Case(executor, lambda: time.sleep(0.001)).next_answer()
    executor.close()
