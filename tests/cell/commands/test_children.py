"""Commands that run beside a command end with it."""

from __future__ import annotations

import signal
import sys
import time
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest

from bracket_cell.commands.terminal import BESIDE
from bracket_lab.commands.training import made_data as children
from bracket_lab.commands.training.made_data import Children

LIMIT_S = 120.0  # against waiting for ever


def waits(ready: Path, on_interrupt: str) -> list[str]:
    """A command that waits for ever, and makes a file once it does with SIGINT what it should."""
    code = f"import signal, threading; signal.signal(signal.SIGINT, signal.{on_interrupt}); open({str(ready)!r}, 'w'); "
    return [sys.executable, "-c", f"{code}threading.Event().wait(3600)"]


def test_what_a_command_says_and_its_status_are_kept(tmp_path: Path) -> None:
    with (tmp_path / "said.txt").open("w") as told:
        assert Children().run([sys.executable, "-c", "print('done'); raise SystemExit(3)"], told) == 3
    assert (tmp_path / "said.txt").read_text() == "done\n"


def test_they_know_that_another_command_runs_them() -> None:
    asks = f"import os; raise SystemExit(7 if {BESIDE!r} in os.environ else 0)"
    assert Children().run([sys.executable, "-c", asks], None) == 7


def test_those_that_run_are_interrupted_and_no_other_begins(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(children, "GRACE_S", 0.0)
    ready = [tmp_path / name for name in ("one", "other")]
    some = Children()
    with ThreadPoolExecutor(2) as pool:
        status = [pool.submit(some.run, waits(path, "default_int_handler"), None) for path in ready]
        while not all(path.exists() for path in ready):
            assert not any(future.done() for future in status)
            time.sleep(0.01)
        some.interrupt()
        assert [future.result(LIMIT_S) for future in status] == [-signal.SIGINT] * 2
    assert some.run([sys.executable, "-c", f"open({str(tmp_path / 'begun')!r}, 'w')"], None) != 0
    assert not (tmp_path / "begun").exists()


def test_those_that_do_not_hear_of_it_are_terminated(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """What a shell begins in the background ignores SIGINT: such a training waited for its data for ever."""
    monkeypatch.setattr(children, "GRACE_S", 0.0)
    monkeypatch.setattr(children, "LONGEST_S", 0.2)
    ready = tmp_path / "ready"
    some = Children()
    with ThreadPoolExecutor(1) as pool:
        status = pool.submit(some.run, waits(ready, "SIG_IGN"), None)
        while not ready.exists():
            assert not status.done()
            time.sleep(0.01)
        some.interrupt()
        assert status.result(LIMIT_S) == -signal.SIGTERM
