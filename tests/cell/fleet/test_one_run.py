"""The process that calls are made in: what it cannot read is an error, and keeps no other call from it."""

from __future__ import annotations

import os
import signal
import sys
import threading
import time
from types import ModuleType
from typing import Any

import pytest

from bracket_cell.fleet import one_run
from bracket_cell.fleet.one_run import ChildDied, in_child
from bracket_ground.errors import CellError
from tests.cell.fleet import working


@pytest.fixture(autouse=True)
def ended() -> Any:
    yield
    if one_run._child is not None:
        one_run._child._process.kill()
        one_run._child.close()
        one_run._child = None


def test_a_function_that_is_not_there_is_an_error_and_the_next_call_is_answered(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    module = ModuleType("only_here")
    exec("def answer(): return 1", module.__dict__)
    monkeypatch.setitem(sys.modules, "only_here", module)
    with pytest.raises(ModuleNotFoundError, match="only_here"):
        in_child(module.answer)
    assert next_call_is_answered()


def test_ctrl_c_does_not_reach_it_and_a_run_can_be_sent_one() -> None:
    assert in_child(os.getsid, 0) != os.getsid(0)
    assert signal.SIGINT not in in_child(signal.pthread_sigmask, signal.SIG_BLOCK, [])


def test_an_error_that_cannot_be_made_again_is_told_in_words_and_the_next_call_is_answered() -> None:
    with pytest.raises(CellError, match="Awkward: the run: it is odd"):
        in_child(working.awkward)
    assert next_call_is_answered()


@pytest.mark.long
def test_a_call_that_never_ends_is_ended_and_the_next_call_is_answered() -> None:
    with pytest.raises(ChildDied, match="ended for using the processor without end"):
        in_child(working.spin)
    assert next_call_is_answered()


@pytest.mark.long
def test_a_process_that_is_stopped_is_known_named_and_its_worker_freed(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(one_run, "IDLE_S", 1.0)
    stopped: list[int] = []

    def stop() -> None:
        child = one_run._child
        assert child is not None
        stopped.append(child._process.pid)
        os.kill(child._process.pid, signal.SIGSTOP)

    assert in_child(os.getpid)
    for work, given in ((os.getpid, b""), (len, b"a call that fills its pipe" * 100_000)):
        stop()
        assert in_child(work, *([given] if given else [])) in (one_run._child._process.pid, len(given))  # type: ignore[union-attr]
        assert one_run._child._process.pid != stopped[-1]  # type: ignore[union-attr]


@pytest.mark.long
def test_one_that_waits_for_ever_is_a_row_that_names_it(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(one_run, "IDLE_S", 0.5)
    with pytest.raises(ChildDied, match=r"the run's process \(pid \d+\) did nothing for 0\.5 s and was ended"):
        in_child(time.sleep, 3600)
    assert next_call_is_answered()


@pytest.mark.long
def test_one_that_works_is_not_ended_however_long_it_takes(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(one_run, "IDLE_S", 1.5)
    assert in_child(working.busy, 4.0) >= 4.0


def next_call_is_answered() -> bool:
    """By another process than this one, in a time."""
    found: list[int] = []
    asking = threading.Thread(target=lambda: found.append(in_child(os.getpid)), daemon=True)
    asking.start()
    asking.join(20)
    return bool(found) and found[0] != os.getpid()
