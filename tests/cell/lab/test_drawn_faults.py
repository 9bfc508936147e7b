"""Faults at random are judged from the truth: what a fault does unnoticed, and whether a signal shows it."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from bracket_cell.configuration import DEFAULT_CONFIGURATION
from bracket_ground.files.row_store import Row
from bracket_lab.evaluations.drawn_faults import EACH, NONE, Drawn, coverage, drawn_rows, judged, missing
from bracket_sim.faults.signal_faults import DETECTED, SIGNALS, SignalFault, Spread, drawn_fault

TICK = 140  # the arm is under way, and will be for a while
HELD_TICK = 120  # it was told to stand, as somebody paused it
TRIED = {
    "arm.pace:foreign:1": "dangerous detected",
    "arm.state:stuck": "dangerous detected",
    "arm.positions_rad.1:offset:0.3": "dangerous detected",
    "bus.gFLT:foreign:14": "safe detected",
    "panel.orders:lost": "dangerous undetected, shown by nothing",
    NONE: "safe undetected",
}
ANSWERS = {  # beside a person, whose hand comes into the arm's way
    "bench.answer:lost": "dangerous detected",
    "bench.time_s:nan": "bench_",
    NONE: "safe undetected",
}


@pytest.fixture(scope="module")
def rows() -> dict[str, Row]:
    """What came of some faults at one moment, by fault."""
    told: list[Row] = []
    trials = [
        Drawn(number, fault, HELD_TICK if fault.startswith("arm.pace") else TICK, 0.6)
        for number, fault in enumerate(TRIED)
    ]
    drawn_rows(DEFAULT_CONFIGURATION, trials, 41, told.append)
    return {str(row["fault"]): row for row in told}


@pytest.mark.long
@pytest.mark.parametrize("fault", TRIED)
def test_a_fault_is_judged_from_the_truth(rows: dict[str, Row], fault: str) -> None:
    name = fault if fault == NONE else SignalFault.parse(fault).name
    row = {**next(row for key, row in rows.items() if key.startswith(fault) or key == name)}
    assert row["judged"] == TRIED[fault], row


def test_a_cell_without_a_fault_shows_nothing_and_is_left_alone(rows: dict[str, Row]) -> None:
    assert not any(rows[NONE][what] for what in ("shown_by", "danger", "noticed_by")), rows[NONE]


@pytest.fixture(scope="module")
def beside() -> dict[str, Row]:
    """What came of faults in answers, by fault."""
    told: list[Row] = []
    trials = [Drawn(EACH + 1 + number, fault, TICK, 0.6) for number, fault in enumerate(ANSWERS)]
    assert all(trial.beside for trial in trials)
    drawn_rows(DEFAULT_CONFIGURATION, trials, 71, told.append)
    return {str(row["fault"]): row for row in told}


@pytest.mark.long
@pytest.mark.parametrize("fault", ANSWERS)
def test_a_fault_in_an_answer_is_judged_beside_a_person(beside: dict[str, Row], fault: str) -> None:
    row = next(row for name, row in beside.items() if name.startswith(fault))
    assert row["judged"] == ANSWERS[fault] or row["noticed_by"].startswith(ANSWERS[fault]), row


def test_a_hand_that_comes_into_the_way_of_a_sound_cell_shows_no_fault(beside: dict[str, Row]) -> None:
    assert not any(beside[NONE][what] for what in ("shown_by", "danger", "noticed_by")), beside[NONE]


def row(**changes: Any) -> Row:
    plain = {"number": 0, "reached": True, "fault": "x", "danger": "d", "danger_s": 1.0, "shown_by": "s"}
    return {**plain, "noticed_by": "n", "noticed_s": 0.4, "ticks": 3, "further_m": 0.01, **changes}


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({}, "dangerous detected"),
        ({"ticks": 9, "further_m": 0.5}, "dangerous detected"),  # before it did harm
        ({"noticed_s": 1.2}, "dangerous detected"),  # as soon as the signals show it
        ({"noticed_s": 1.2, "ticks": 6}, "dangerous detected late"),
        ({"noticed_s": 1.2, "further_m": 0.2}, "dangerous detected late"),
        ({"noticed_by": ""}, "dangerous undetected"),
        ({"noticed_by": "", "shown_by": ""}, "dangerous undetected, shown by nothing"),
        ({"danger": ""}, "safe detected"),
        ({"danger": "", "noticed_by": ""}, "safe undetected"),
    ],
)
def test_detected_is_what_was_noticed_in_time(changes: Row, words: str) -> None:
    assert judged(row(**changes)) == words


def test_coverage_is_the_share_of_dangerous_faults_that_is_detected() -> None:
    late, blind = row(judged="dangerous detected late", ticks=7), "dangerous undetected, shown by nothing"
    found = [row(judged="dangerous detected")] * 8 + [late, row(judged=blind, noticed_by="", shown_by="")]
    told = coverage([*found, row(judged="safe undetected", danger="", noticed_by="")])
    assert told["coverage"].startswith("8 of 10")
    assert told["coverage_of_shown"].startswith("8 of 9")
    assert (told["dangerous_most_ticks"], told["kept"]) == (7, False)
    assert coverage(found[:8])["kept"]
    alarm = row(fault=NONE, judged="safe detected", danger="")
    assert not coverage([*found[:8], alarm])["kept"], "a sound cell is to be left alone"


def test_trials_follow_from_number_and_seed_and_are_gone_on_with() -> None:
    whole = [trial for trials, _ in missing(2 * EACH, 7, ()) for trial in trials]
    assert len(whole) == 2 * EACH + 2
    assert [drawn.fault for drawn in whole].count(NONE) == 2
    rest = missing(2 * EACH, 7, range(EACH + 2))
    assert next((trial.number, seed) for trials, seed in rest for trial in trials) == (EACH + 2, 8)
    assert rest[0][0][0] == whole[EACH + 2]


@pytest.mark.parametrize("signals", [SIGNALS, DETECTED], ids=["devices", "answers"])
def test_every_kind_of_every_signal_is_drawn_and_can_be_read_again(signals: dict[str, Spread]) -> None:
    drawn = [drawn_fault(np.random.default_rng([3, number]), signals) for number in range(6000)]
    pairs = {(f"{fault.device}.{fault.signal}", fault.kind) for fault in drawn}
    assert pairs == {(name, kind) for name, spread in signals.items() for kind in spread.kinds}
    for fault in drawn[:200]:
        assert SignalFault.parse(fault.name).name == fault.name


@pytest.mark.parametrize("joints", [6, 7])
def test_a_fault_is_drawn_in_every_joint_of_the_arm(joints: int) -> None:
    trials = [trial for trials, _ in missing(4000, 7, (), joints) for trial in trials]
    faults = [SignalFault.parse(trial.fault) for trial in trials if trial.fault != NONE]
    assert {fault.joint for fault in faults} == {None, *range(joints)}
