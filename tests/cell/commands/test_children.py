"""Commands that run beside a command end with it."""

from __future__ import annotations

import signal
import sys
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest

from cell.commands.terminal import BESIDE
from cell.commands.training import made_data as children
from cell.commands.training.made_data import Children

LIMIT_S = 120.0  # against waiting for ever


def test_what_a_command_says_and_its_status_are_kept(tmp_path: Path) -> None:
    with (tmp_path / "said.txt").open("w") as told:
        assert Children().run([sys.executable, "-c", "print('done'); raise SystemExit(3)"], told) == 3
    assert (tmp_path / "said.txt").read_text() == "done\n"


def test_they_know_that_another_command_runs_them() -> None:
    asks = f"import os; raise SystemExit(7 if {BESIDE!r} in os.environ else 0)"
    assert Children().run([sys.executable, "-c", asks], None) == 7


def test_those_that_run_are_interrupted_and_no_other_begins(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(children, "GRACE_S", 0.0)
    some, waits = Children(), [sys.executable, "-c", "import threading; threading.Event().wait(3600)"]
    with ThreadPoolExecutor(2) as pool:
        status = [pool.submit(some.run, waits, None) for _ in range(2)]
        while len(some._running) < len(status):
            assert not any(one.done() for one in status)
        some.interrupt()
        assert all(one.result(LIMIT_S) != 0 for one in status)
    assert some.run([sys.executable, "-c", f"open({str(tmp_path / 'begun')!r}, 'w')"], None) != 0
    assert not (tmp_path / "begun").exists()


def test_those_that_do_not_hear_of_it_are_terminated(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """What a shell begins in the background ignores SIGINT: such a training waited for its data for ever."""
    monkeypatch.setattr(children, "GRACE_S", 0.0)
    monkeypatch.setattr(children, "LONGEST_S", 0.2)
    ready = tmp_path / "ready"
    code = f"import signal, threading; signal.signal(signal.SIGINT, signal.SIG_IGN); open({str(ready)!r}, 'w'); "
    some, words = Children(), [sys.executable, "-c", f"{code}threading.Event().wait(3600)"]
    with ThreadPoolExecutor(1) as pool:
        status = pool.submit(some.run, words, None)
        while not ready.exists():
            assert not status.done()
        some.interrupt()
        assert status.result(LIMIT_S) == -signal.SIGTERM
