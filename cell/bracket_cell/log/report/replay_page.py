"""A replay on one HTML page: what was changed, the first other command with its picture, and the rest."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from bracket_cell.log.read.frames import Frames
from bracket_cell.log.read.reader import Log
from bracket_cell.log.replay.compare import Comparison, Difference
from bracket_cell.log.report.html_page import rendered, write_page
from bracket_cell.log.report.text import difference_lines

TEMPLATE = Path(__file__).with_name("replay.html.j2")
MOST = 200  # differences that follow; the others are counted


def write_replay(
    log: Log,
    comparison: Comparison,
    told: tuple[Sequence[str], Sequence[str], Sequence[str]],
    following: Sequence[Difference],
    path: Path,
) -> int:
    """Write the page; returns its size in bytes.

    Args:
        told: what differs in the program, keys that were changed, and causes.
        following: differences in their order.

    Raises:
        InputError: it cannot be written.
    """
    leading = comparison.leading
    frames = Frames(log).newest(leading.time_s) if leading is not None else []
    before = [
        difference
        for difference in following
        if leading is not None and difference.tick <= leading.tick and difference is not leading
    ]
    after = [difference for difference in following if leading is not None and difference.tick > leading.tick]
    page = rendered(
        TEMPLATE,
        log=log.path.name,
        comparison=comparison,
        program=told[0],
        changed=told[1],
        causes=told[2],
        leading=leading,
        words=[] if leading is None else difference_lines(leading)[1:],
        frames=frames,
        before=[line for difference in before for line in difference_lines(difference)],
        after=[line for difference in after[:MOST] for line in difference_lines(difference)],
        left_out=max(0, len(after) - MOST),
    )
    return write_page(page, path)
