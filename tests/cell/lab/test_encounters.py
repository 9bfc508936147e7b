"""Trials beside a person: contacts are judged by the truth, and assemblies with faults end as promised."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from rich.console import Console

from cell.commands.lab.encounters import _tell_assembly
from cell.configuration import DEFAULT_CONFIGURATION
from cell.faults.injection import NOTICES_S, Attendant
from cell.files.row_store import Row
from cell.interfaces.operator import OperatorOrder
from cell.lab.assembly import ALGORITHM_1, throughput_ratio
from cell.lab.encounters import encounter, summary
from cell.lab.random_faults import counted, troubled_assembly


@pytest.mark.slow
def test_a_careless_person_is_met_in_many_phases_and_no_contact_is_fast_or_avoidable() -> None:
    found = summary([encounter(DEFAULT_CONFIGURATION, ALGORITHM_1, "careless", 109, provoked=True)])
    assert int(str(found["encounters"])) >= 3
    assert len(found["phases"]) >= 3
    assert (found["contacts_fast"], found["contacts_avoidable"], found["moved_while_unknown"]) == (0, 0, 0)
    assert np.isfinite(float(str(found["fastest_m_s"])))


def test_somebody_acknowledges_what_waits_for_that_and_again_while_it_is_still_there() -> None:
    shown: list[str] = []
    now_s = [1.0]
    panel: Any = SimpleNamespace(alarm=shown.append)
    clock = SimpleNamespace(now_s=lambda: now_s[0])
    devices: Any = SimpleNamespace(clock=clock, panel=panel, pressed=lambda: (OperatorOrder("resume"),))
    attendant = Attendant(devices)

    def pressed_after(wait_s: float) -> list[str]:
        now_s[0] += wait_s
        return [order.kind for order in attendant.pressed()]

    assert pressed_after(NOTICES_S) == ["resume"]
    attendant.alarm("the arm does not follow its trajectory; acknowledge it when it may go on")
    assert pressed_after(NOTICES_S / 2) == ["resume"]
    assert pressed_after(NOTICES_S / 2) == ["resume", "acknowledge"]
    assert pressed_after(0.1) == ["resume"]
    assert pressed_after(NOTICES_S) == ["resume", "acknowledge"]
    attendant.alarm("")
    assert pressed_after(NOTICES_S) == ["resume", "resume"], "and lets it go on when it is gone"
    assert pressed_after(NOTICES_S) == ["resume"]
    assert [bool(text) for text in shown] == [True, False]


def test_an_assembly_that_did_not_finish_is_told_with_its_reason(capsys: pytest.CaptureFixture[str]) -> None:
    row: Row = {
        "seed": 7,
        "end": "fault",
        "reason": "the arm stopped",
        "sim_time_s": 3.0,
        "encounters": 1,
        "contacts": [],
    }
    _tell_assembly(Console(), row)
    assert "seed 7: fault after 3.0 s (the arm stopped), 1 encounters" in capsys.readouterr().out


def test_the_ratio_takes_only_pairs_that_were_finished_both_and_only_of_its_tree() -> None:
    pairs = [("assemble.xml", 0, 60.0, 50.0), ("assemble.xml", 1, None, 50.0), ("ahead.xml", 0, 99.0, 33.0)]
    rows: list[Row] = [
        {"kind": "throughput", "tree": tree, "seed": seed, "with_s": one, "without_s": other}
        for tree, seed, one, other in pairs
    ]
    assert throughput_ratio([*rows, {"kind": "assembly"}], ALGORITHM_1) == 1.2
    assert throughput_ratio([], ALGORITHM_1) is None


def test_the_table_of_troubled_assemblies_tells_right_from_stopped_and_from_wrong() -> None:
    row = {"as_promised": True, "unknown": False, "correct": True, "end": "finished"}
    stopped = {**row, "correct": False, "end": "fault"}
    wrong = {"as_promised": False, "unknown": True, "correct": False, "end": "finished"}
    found = counted([row, stopped, stopped, wrong])
    assert {name: found[name] for name in ("as_promised", "finished_right", "ended_as_stated", "unknown")} == {
        "as_promised": 3,
        "finished_right": 1,
        "ended_as_stated": 2,
        "unknown": 1,
    }


@pytest.mark.slow
def test_an_assembly_with_three_faults_ends_as_promised() -> None:
    row = troubled_assembly(DEFAULT_CONFIGURATION, 701, 3)
    assert row["came"]
    assert row["as_promised"]
    assert not row["unknown"]
    assert row == troubled_assembly(DEFAULT_CONFIGURATION, 701, 3), "the same seed, the same faults and end"
