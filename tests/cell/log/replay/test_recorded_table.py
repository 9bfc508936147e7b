"""A log keeps its table of faults; signs that came later do nothing in it."""

from __future__ import annotations

from bracket_cell.log.replay.logged_tree import recorded_table
from bracket_ground.files.files import shipped
from bracket_ground.interfaces.faults import SIGNALS


def test_a_table_of_before_a_sign_was_known_is_read() -> None:
    lines = shipped("bracket_cell.config", "faults.yaml").read_text("utf-8").splitlines()
    older = "\n".join(line for line in lines if "camera_moved" not in line)
    rows = {row.signal: row.action for row in recorded_table(older).faults}
    assert set(rows) == set(SIGNALS)
    assert rows["camera_moved"] == "run"
    assert rows["arm_lost_long"] == "stop"


def test_a_table_whose_row_asked_for_a_person_by_itself_has_a_row_for_that() -> None:
    older = (
        "faults:\n- {signal: arm_off_path, action: hold, clear: standstill, clear_s: 0.5, delay_s: 0.03, "
        "acknowledged_s: 4, person_after_s: 8, stop_after_s: 120}\n"
    )
    rows = {row.signal: row for row in recorded_table(older).faults}
    assert (rows["arm_off_path_long"].clear, rows["arm_off_path_long"].delay_s) == ("person", 8)
    assert rows["arm_off_path"].delay_s == 0.03
