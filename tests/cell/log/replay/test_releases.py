"""Each release keeps a small log, which all later ones read; one of another release names the program that replays it.

A new release keeps one, too: `cell log to-test tests/cases/assembly-g0-seed5.mcap --name 0.13.0 --until 4 -o
tests/cell/log/replay/releases`, and `python -m tests.docs.pictures docs/reference/old-logs.md`.
"""

from __future__ import annotations

import dataclasses
from pathlib import Path

import pytest

from bracket_cell.log.read.reader import read_log
from bracket_cell.log.replay.replay import Replay
from bracket_cell.recording.identity import versions
from tests.docs.old_logs import RELEASES, page

KEPT = sorted(RELEASES.glob("*.mcap"))


def test_this_release_keeps_a_log_and_decides_as_it_says() -> None:
    assert Replay(read_log(RELEASES / f"{versions()['version.cell']}.mcap")).run().agrees


@pytest.mark.parametrize("path", KEPT, ids=lambda path: path.stem)
def test_a_log_of_each_release_is_read_whole(path: Path) -> None:
    log = read_log(path)
    assert log.metadata["version.cell"] == log.path.stem
    assert [tick.number for tick in log.ticks] == list(range(101))
    assert f"| {log.path.stem} | 101 |" in page()


def test_the_program_of_another_release_is_named() -> None:
    log = read_log(KEPT[-1])
    older = dataclasses.replace(log, metadata={**log.metadata, "version.cell": "0.4.0", "commit": "aa821a3f"})
    [way] = [remark for remark in Replay(older).remarks if "of another release" in remark]
    assert "git worktree add ../recorder aa821a3f && make -C ../recorder doctor" in way
    assert way.endswith(f"cell replay {log.path}")
    assert not any("of another release" in remark for remark in Replay(log).remarks)
