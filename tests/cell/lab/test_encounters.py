"""Trials beside a person: contacts are judged by the truth, and assemblies with faults end as promised."""

from __future__ import annotations

import json
from types import SimpleNamespace
from typing import Any

import mujoco
import numpy as np
import pytest
from rich.console import Console

from bracket_cell.configuration import DEFAULT_CONFIGURATION, DEFAULT_TREE
from bracket_cell.skills.motion.contact import ContactMap
from bracket_ground.files.row_store import Row
from bracket_ground.interfaces.operator import OperatorOrder
from bracket_ground.interfaces.perception import HandSample
from bracket_lab.commands.encounters import _tell_assembly
from bracket_lab.evaluations.assembly import ALGORITHM_1, cost_of_separation
from bracket_lab.evaluations.danger import TrueDistance, protective_m
from bracket_lab.evaluations.encounters import Encounters, Tracker, encounter, passed, summary
from bracket_lab.evaluations.random_faults import counted, troubled_assembly
from bracket_sim.faults.injection import NOTICES_S, Attendant
from bracket_sim.truth.contacts import Contact
from tests.integration.cell_rig import BENCH, with_person

TABLE_M = np.array([(x, y, z) for x in (0.0, 1.4) for y in (-0.7, 0.7) for z in (-0.5, 0.0)])
ASSEMBLY: Row = {
    "end": "finished",
    "sim_time_s": 1.0,
    "phases": [],
    "speeds_m_s": [],
    "breached": [0, 0],
    "moved_while_unknown": 0,
}


def test_the_oracle_has_the_distance_of_the_technical_specification() -> None:
    """Stands: S_h alone; at 0.4 m/s: T_s is 0.25 s."""
    assert protective_m(0.0) == pytest.approx([1.6 * 0.25, 2.0 * 0.25])
    assert protective_m(0.4) == pytest.approx([v_h * 0.5 + 0.4 * 0.25 + 0.05 for v_h in (1.6, 2.0)])


def test_the_oracle_sees_an_arm_that_moves_too_near_to_the_true_hand() -> None:
    """The hand rests where it does, and the arm reaches for it; nobody asks what the cell thinks of that."""
    over_p2_rad = (0.131, -1.315, 1.9, -2.155, -1.571, 0.131)
    away_rad = (-2.5, *BENCH.arm_park_rad[1:])
    with with_person("random", seed=3) as cell:
        truth = TrueDistance(cell)
        for joints, near in ((away_rad, False), (over_p2_rad, True)):
            cell.world.set_arm(joints)
            mujoco.mj_forward(cell.world.model, cell.world.data)
            cell.arm.driven_rad_s = np.zeros(6)
            assert truth.breached() == (False, False), "it stands"
            cell.arm.driven_rad_s = np.array([0.4, 0, 0, 0, 0, 0])
            assert truth.breached() == (near, near)


def test_trackers_err_as_they_are_told_to() -> None:
    rng = np.random.default_rng(1)
    hand = HandSample(0.0, (0, 0, 9, 9), (0.7, 0.1), (0.8, 0.1))
    assert Tracker.true.spoil(hand, rng) == hand
    assert Tracker.blind.spoil(hand, rng) is None
    off = Tracker.off.spoil(hand, rng)
    assert off is not None
    assert off.fingertips_m == pytest.approx((0.75, 0.1))
    assert 60 < sum(Tracker.half.spoil(hand, rng) is None for _ in range(200)) < 140
    assert all(tracker.spoil(None, rng) is None for tracker in Tracker)


def test_few_contacts_with_a_moving_arm_pass_and_none_that_is_fast() -> None:
    good: Row = dict.fromkeys(("contacts_fast", "contacts_moving_over", "moved_while_unknown"), 0)
    good |= {"contacts_moving": 5, "encounters": 100}
    assert passed(good)
    for worse in (
        {"contacts_moving": 6},
        {"contacts_fast": 1},
        {"contacts_moving_over": 1},
        {"moved_while_unknown": 1},
    ):
        assert not passed({**good, **worse})
    assert not passed({**good, "contacts_moving": 1}, Tracker.off), "none where the tracker errs"


def test_an_arm_that_stands_for_long_meets_nobody_and_the_run_is_stopped() -> None:
    with with_person("random", seed=3) as cell:
        watch = Encounters(cell, ContactMap([TABLE_M]))
        for time_s, stands in ((1.0, False), (61.0, True), (61.1, True)):
            arm: Any = SimpleNamespace(stands=stands)
            seen: Any = SimpleNamespace(time_s=time_s, bench=None, acknowledged=False, arm=arm)
            record: Any = SimpleNamespace(observation=seen, judgement=None, notes=())
            assert not watch.pressed()
            watch.tick(record)
        assert [order.kind for order in watch.pressed()] == ["stop"]


@pytest.mark.parametrize(
    ("height_m", "force_n", "clamped", "over"),
    [(0.05, 139, True, False), (0.05, 141, True, True), (0.5, 141, False, False), (0.5, 281, False, True)],
)
def test_a_hand_that_may_be_clamped_bears_half_the_force(
    height_m: float, force_n: float, clamped: bool, over: bool
) -> None:
    """Over the table, at the height of a hand or far above."""
    with with_person("random", seed=3) as cell:
        watch = Encounters(cell, ContactMap([TABLE_M]))
    contact = Contact(1.0, 1.2, "tool", "hand", 0.2, 0.2, 0.9, force_n, (0.7, 0.1, height_m))
    row = watch.judge(contact)
    assert (row["clamped"], row["over"]) == (clamped, over)
    found = summary([{**ASSEMBLY, "contacts": [row]}])
    assert found["contacts_moving_over"] == over
    assert found["force_moving_clamped_n"] == (force_n if clamped else 0)
    assert found["force_moving_free_n"] == (0 if clamped else force_n)


@pytest.mark.slow
def test_a_careless_person_is_met_in_many_phases_and_no_contact_is_fast() -> None:
    row = encounter(DEFAULT_CONFIGURATION, ALGORITHM_1, "careless", 109, provoked=True)
    assert json.loads(json.dumps(row))["seed"] == 109
    found = summary([row])
    assert int(str(found["encounters"])) >= 3
    assert len(found["phases"]) >= 3
    assert (found["contacts_fast"], found["moved_while_unknown"]) == (0, 0)
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


def test_the_cost_of_separation_takes_only_pairs_that_were_finished_both() -> None:
    told = {"held_s": 1.0, "interventions": 2, "least_distance_m": 0.3}
    pairs = [(60.0, 50.0, 0.3), (None, 50.0, 0.2), (70.0, None, None)]
    rows: list[Row] = [{**told, "with_s": one, "without_s": two, "least_distance_m": m} for one, two, m in pairs]
    found = cost_of_separation(rows)
    assert {name: found[name] for name in ("ratio", "low", "high", "n", "unfinished")} == {
        **dict.fromkeys(("ratio", "low", "high"), 1.2),
        "n": 1,
        "unfinished": 2,
    }
    assert (found["held_s"], found["interventions"], found["least_distance_m"]) == (1.0, 2.0, 0.25)
    more = cost_of_separation([*rows, {**rows[0], "with_s": 90.0}])
    assert (more["low"], more["ratio"], more["high"]) == (1.2, 1.5, 1.8)
    assert (more["with_low_s"], more["with_s"], more["with_high_s"]) == (60.0, 75.0, 90.0)
    assert cost_of_separation(rows[1:]) == {"ratio": None, "n": 0, "unfinished": 2}


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


@pytest.mark.long
def test_a_hand_that_leans_on_the_arm_is_held_by_no_more_than_it_pushes() -> None:
    """With a sparse Jacobian a step of the physics came to no end: 27,264 N at 47.3 s, and the wrist jumped."""
    row = encounter(DEFAULT_CONFIGURATION, DEFAULT_TREE, "hasty", 1005000, provoked=True)
    assert row["end"] != "fault"
    assert float(str(summary([row])["force_n"])) < 1000.0
