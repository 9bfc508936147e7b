"""Every process of a cell at real pace stopped or killed: the cell holds or ends, names it, and leaves nothing."""

from __future__ import annotations

import os
import re
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from bracket_cell.configuration import DEFAULT_CONFIGURATION
from tests.processes import runs, started

PATIENCE_S = 240.0  # until a run of a busy machine gets so far
HELD_S, ENDED_S = 2.0, 2.0  # what is promised
SLACK_S = 8.0  # ... on a machine that does other things, too; a run that hangs is far beyond
NAMES = ("world", "renderer", "bench watcher", "part detector")
HELD = tuple(name for name in NAMES if name != "world")


class Cell:
    """A run at real pace, and what it says."""

    def __init__(self, process: subprocess.Popen[str], said: Path) -> None:
        self.process, self._said = process, said

    @property
    def said(self) -> str:
        return " ".join(self._said.read_text().split())

    def until(self, words: str, limit_s: float = PATIENCE_S) -> None:
        """Until it has said something, as a pattern."""
        until_s = time.monotonic() + limit_s
        while not re.search(words, self.said):
            assert time.monotonic() < until_s, f"{words!r} was not said: {self.said}"
            assert self.process.poll() is None, self.said
            time.sleep(0.02)

    def pid(self, name: str) -> int:
        """Of one of its processes, once it is there."""
        until_s = time.monotonic() + PATIENCE_S
        while (found := self.processes().get(name)) is None:
            assert time.monotonic() < until_s, self.processes()
            assert self.process.poll() is None, self.said
            time.sleep(0.02)
        return found

    def processes(self) -> dict[str, int]:
        """By name; the renderer is a copy of the world, and its child."""
        found: dict[str, int] = {}
        for entry in Path("/proc").iterdir():
            if entry.name.isdigit():
                try:
                    stat = (entry / "stat").read_text().rpartition(")")[2].split()
                    words = (entry / "cmdline").read_text().rstrip("\0").split("\0")
                except OSError:  # it has ended meanwhile
                    continue
                parent, session = int(stat[1]), int(stat[3])
                if session == self.process.pid and words[-1] in NAMES and stat[0] != "Z":
                    found[words[-1] if parent == self.process.pid else "renderer"] = int(entry.name)
        return found

    def ended(self, limit_s: float = ENDED_S) -> int:
        """Its exit status."""
        return self.process.wait(limit_s + SLACK_S)


@pytest.fixture(scope="module")
def configuration(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Small images, and detectors that take little time."""
    text, folder = DEFAULT_CONFIGURATION.read_text(), DEFAULT_CONFIGURATION.parent
    for old, new in (
        ("product: products.yaml", f"product: {folder / 'products.yaml'}"),
        ("simulation: sim.yaml", f"simulation: {folder / 'sim.yaml'}"),
        ("kind: learned", "kind: classical"),
        ("width_px: 480", "width_px: 120"),
        ("height_px: 360", "height_px: 90"),
        ("focal_px: 530.0", "focal_px: 132.5"),
        ("focal_px: 420.0", "focal_px: 105.0"),
    ):
        assert old in text
        text = text.replace(old, new)
    path = tmp_path_factory.mktemp("real") / "cell.yaml"
    path.write_text(text)
    return path


@contextmanager
def cell(configuration: Path, folder: Path) -> Iterator[Cell]:
    """A run, nothing of which is left at the end."""
    said, before = folder / "said.txt", set(Path("/dev/shm").iterdir())
    shell = f'exec "$0" -m bracket_cell run --config "$1" --goal g1 --seed 7 --real-time --log "$2" > "{said}" 2>&1'
    command = ["sh", "-c", shell, sys.executable, str(configuration), str(folder / "log.mcap")]
    said.touch()
    with started(command, environment={"TMPDIR": str(folder), "COLUMNS": "300"}) as process:
        made = Cell(process, said)
        yield made
        until_s = time.monotonic() + SLACK_S
        while process.poll() is not None and made.processes() and time.monotonic() < until_s:
            time.sleep(0.02)
        assert process.poll() is not None
        assert made.processes() == {}
    assert "Traceback" not in made.said
    assert "cell: cell:" not in made.said
    assert set(Path("/dev/shm").iterdir()) <= before
    assert [entry.name for entry in folder.iterdir() if entry.is_dir()] == []


def stop(pid: int, number: signal.Signals = signal.SIGSTOP) -> None:
    os.kill(pid, number)


@pytest.mark.long
def test_whichever_process_does_not_answer_is_named_and_the_cell_holds_or_ends(
    configuration: Path, tmp_path: Path
) -> None:
    """One run for all four of them: three make it hold, the world ends it."""
    with cell(configuration, tmp_path) as one:
        one.until("hand ")  # the first frame was answered
        for name in HELD:
            pid = one.pid(name)
            stop(pid)
            one.until(rf"{name} \(pid {pid}\): does not answer for \d+\.\d s", HELD_S + SLACK_S)
        pid = one.pid("world")
        stop(pid)
        assert one.ended() == 3
        assert f"world (pid {pid}): does not answer for 0.2 s" in one.said
        assert not runs(pid)


@pytest.mark.slow
@pytest.mark.parametrize("name", HELD)
def test_a_process_that_answers_again_lets_the_cell_go_on(configuration: Path, tmp_path: Path, name: str) -> None:
    with cell(configuration, tmp_path) as one:
        one.until("cell all clear")
        pid = one.pid(name)
        stop(pid)
        one.until(rf"hold: .*{name} \(pid {pid}\): does not answer for \d+\.\d s", HELD_S + SLACK_S)
        said = len(one.said)
        stop(pid, signal.SIGCONT)
        one.until(rf"(?s)\A.{{{said}}}.*all clear")
        stop(one.process.pid, signal.SIGINT)
        assert one.ended() == 1


@pytest.mark.long
def test_ctrl_c_ends_a_run_whose_detector_is_stopped_while_it_loads(configuration: Path, tmp_path: Path) -> None:
    with cell(configuration, tmp_path) as one:
        pid = one.pid("part detector")
        stop(pid)
        stop(one.process.pid, signal.SIGINT)
        assert one.ended() in (1, 3)
        assert "interrupted" in one.said or f"part detector (pid {pid}): somebody stopped it" in one.said
        assert not runs(pid)


@pytest.mark.slow
@pytest.mark.parametrize("name", NAMES)
def test_a_process_that_is_killed_while_it_works_is_named(configuration: Path, tmp_path: Path, name: str) -> None:
    with cell(configuration, tmp_path) as one:
        one.until("cell all clear")
        pid = one.pid(name)
        stop(pid, signal.SIGKILL)
        words = rf"{name} \(pid {pid}\): it(s process is gone| died \(exit code -9\))"
        if name == "renderer":  # a camera may come back
            one.until(f"hold: .*{words}", HELD_S + SLACK_S)
            stop(one.process.pid, signal.SIGINT)
            assert one.ended() == 1
        else:
            assert one.ended() == 3
            assert re.search(words, one.said)


@pytest.mark.slow
@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize("number", [signal.SIGSTOP, signal.SIGKILL])
def test_a_process_that_does_not_begin_is_named(
    configuration: Path, tmp_path: Path, name: str, number: signal.Signals
) -> None:
    with cell(configuration, tmp_path) as one:
        pid = one.pid(name)
        stop(pid, number)
        assert one.ended(HELD_S + PATIENCE_S) == 3
        assert f"{name} (pid {pid})" in one.said


@pytest.mark.slow
@pytest.mark.parametrize("name", NAMES)
def test_ctrl_c_ends_a_run_in_whichever_state_a_process_is(configuration: Path, tmp_path: Path, name: str) -> None:
    with cell(configuration, tmp_path) as one:
        one.until("cell all clear")
        stop(one.pid(name))
        stop(one.process.pid, signal.SIGINT)
        assert one.ended() in (1, 3)


@pytest.mark.slow
def test_what_a_killed_controller_started_ends_with_it(configuration: Path, tmp_path: Path) -> None:
    with cell(configuration, tmp_path) as one:
        one.until("cell all clear")
        stop(one.pid("renderer"))
        one.process.kill()
        one.process.wait()


@pytest.mark.slow
def test_whoever_is_there_when_it_begins_ctrl_c_ends_it(configuration: Path, tmp_path: Path) -> None:
    with cell(configuration, tmp_path) as one:
        one.pid("world")
        stop(one.process.pid, signal.SIGTERM)
        assert one.ended() == 1
        assert one.said == "cell: interrupted"
