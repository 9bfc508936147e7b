"""docs/reference/old-logs.md: what becomes of the logs of each release, found by reading and replaying one of each."""

from __future__ import annotations

from collections.abc import Iterator
from functools import cache
from pathlib import Path

from bracket_cell.log.read.reader import read_log
from bracket_cell.log.replay.replay import Replay
from bracket_cell.recording.identity import versions
from bracket_ground.errors import InputError, LogError
from tests import ROOT
from tests.docs.reference_pages import MADE

RELEASES = ROOT / "tests" / "cell" / "log" / "replay" / "releases"
PAGE = f"""# Logs of older releases

{MADE} Each release keeps a small log of its own, which every later one reads and replays.

| release | ticks read | same decisions until | first difference |
|---|---|---|---|
"""
REST = """
Logs of releases before the first row are read where this program knows their records; none is kept.

A log names the commit that recorded it (`cell log info LOG`). In a clone, this runs that program beside today's:

    git worktree add ../recorder COMMIT
    make -C ../recorder doctor
    ../recorder/.venv/bin/cell replay LOG
"""


@cache
def page() -> str:
    """The page."""
    return PAGE + "".join(f"{row}\n" for row in _rows()) + REST


def _rows() -> Iterator[str]:
    for path in sorted(RELEASES.glob("*.mcap"), key=lambda path: tuple(map(int, path.stem.split(".")))):
        log = read_log(path)
        yield f"| {path.stem} | {len(log.ticks)} | {' | '.join(_replayed(path))} |"


def _replayed(path: Path) -> tuple[str, str]:
    if path.stem == versions()["version.cell"]:
        return "the end", "none: it is this release"
    try:
        found = Replay(read_log(path)).run()
    except (LogError, InputError) as error:
        return "no replay", str(error).partition(": ")[2]
    if found.agrees:
        return "the end", "none"
    first = found.first
    assert first is not None
    return f"tick {first.tick}", str(first.aspect)
