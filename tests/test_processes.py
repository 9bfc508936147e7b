"""A process of a test ends with the test, and so do its own children."""

from __future__ import annotations

import os
import subprocess
import sys
import textwrap
from pathlib import Path

import pytest

from tests import ROOT
from tests.processes import children, finished, runs, started

SLEEPS = "import time; time.sleep(600)"
STARTS = f"print(subprocess.Popen([sys.executable, '-c', {SLEEPS!r}]).pid, flush=True)"
PARENT = f"import subprocess, sys; {STARTS}; {SLEEPS}"


def test_what_a_process_started_ends_with_it() -> None:
    with started([sys.executable, "-c", PARENT]) as process:
        assert process.stdout is not None
        grandchild = int(process.stdout.readline())
        assert process.pid in children()
        assert runs(grandchild)
    while runs(grandchild):  # it is killed already, and the kernel is taking it down
        os.sched_yield()
    assert process.pid not in children()


def test_a_limit_ends_a_process() -> None:
    with pytest.raises(subprocess.TimeoutExpired):
        finished([sys.executable, "-c", SLEEPS], limit_s=0.2)
    assert not any(SLEEPS in line for line in children().values())


def test_the_test_that_leaves_a_child_fails_and_the_next_one_does_not(tmp_path: Path) -> None:
    (tmp_path / "conftest.py").write_text("from tests.conftest import _no_child_survives\n")
    (tmp_path / "test_two.py").write_text(
        textwrap.dedent(f"""
        import subprocess, sys
        left = []
        def test_leaves(): left.append(subprocess.Popen([sys.executable, "-c", {SLEEPS!r}]))
        def test_next(): assert left[0].wait() == -9
        """)
    )
    command = [sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider", str(tmp_path)]
    told = finished(command, tmp_path, {"PYTHONPATH": str(ROOT)})
    assert "2 passed, 1 error" in told.stdout
    assert "still running after the test" in told.stdout
    assert "ERROR at teardown of test_leaves" in told.stdout
