"""A log keeps its table of faults; signs that came later do nothing in it."""

from __future__ import annotations

from cell.files.files import shipped
from cell.interfaces.faults import SIGNALS
from cell.log.replay.replay import recorded_table


def test_a_table_of_before_a_sign_was_known_is_read() -> None:
    lines = shipped("config", "faults.yaml").read_text("utf-8").splitlines()
    older = "\n".join(line for line in lines if "camera_moved" not in line)
    rows = {row.signal: row.action for row in recorded_table(older).faults}
    assert set(rows) == set(SIGNALS)
    assert rows["camera_moved"] == "run"
    assert rows["arm_lost"] == "stop"
