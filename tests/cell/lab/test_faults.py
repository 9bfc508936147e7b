"""Faults that are put in end as the table of faults promises; a sample, `cell lab eval faults` runs them all."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import pytest

from bracket_cell.commands.main import main
from bracket_cell.configuration import DEFAULT_CONFIGURATION
from bracket_cell.watching.work_state import OTHER_STATES, STATES
from bracket_ground.errors import InputError
from bracket_lab.commands import faults
from bracket_lab.evaluations.faults import chosen, fast_rows, fault_try
from bracket_sim.faults.injection import Injection, Injections
from bracket_sim.faults.named_faults import FAULTS

SAMPLE = {
    "carry": ("arm_frozen", "gripper_refuses", "camera_black"),
    "lower": ("arm_velocity_nan", "arm_protective_stop", "arm.positions_rad.5:offset:0.2"),
    "lift": ("status_lost",),
    "above": ("sighup",),
    "waiting_for_help": ("heartbeat_lost",),
}
MISHAPS = [
    ("part_falls", "carry", "finished"),
    ("part_falls", "lower", "finished"),
    ("part_sticks", "lower", "failed"),
    ("part_jams", "carry", "finished"),
    ("tray_pushed", "above", "finished"),
    ("hole_covered", "carry", "failed"),
    ("part_missing", "above", "failed"),
    ("part_broken", "above", "finished"),
    ("part_wrong", "above", "finished"),
]


@pytest.fixture(scope="module")
def rows() -> dict[tuple[str, str], dict[str, Any]]:
    """How the sample ended, by fault and state."""
    told: list[dict[str, Any]] = []
    fast_rows(DEFAULT_CONFIGURATION, SAMPLE, 1, told.append)
    return {(row["fault"], row["state"]): row for row in told}


@pytest.mark.long
@pytest.mark.parametrize(("fault", "state"), [(fault, state) for state, names in SAMPLE.items() for fault in names])
def test_a_fault_ends_as_promised(rows: dict[tuple[str, str], dict[str, Any]], fault: str, state: str) -> None:
    row = rows[fault, state]
    assert row["as_promised"], row
    assert row["held"] is not False
    if row["ticks_to_stop"] >= 0:
        assert row["ticks_to_stop"] <= 3, row


@pytest.mark.slow
def test_a_joint_that_is_told_wrong_ends_as_promised() -> None:
    """It takes as long as all others together: the arm tries other ways until it is off its path."""
    row = fault_try(DEFAULT_CONFIGURATION, "arm_offset", "lower", 1, rendered=False)
    assert row["as_promised"], row
    assert row["held"] is not False


@pytest.fixture(scope="module")
def mishaps() -> dict[tuple[str, str], dict[str, Any]]:
    """How mishaps with a part ended, by fault and state."""
    told: list[dict[str, Any]] = []
    pairs: dict[str, list[str]] = {}
    for fault, state, _ in MISHAPS:
        pairs.setdefault(state, []).append(fault)
    fast_rows(DEFAULT_CONFIGURATION, pairs, 1, told.append)
    return {(row["fault"], row["state"]): row for row in told}


@pytest.mark.slow
@pytest.mark.parametrize(("fault", "state", "end"), MISHAPS)
def test_a_mishap_with_a_part_ends_as_promised(
    mishaps: dict[tuple[str, str], dict[str, Any]], fault: str, state: str, end: str
) -> None:
    row = mishaps[fault, state]
    assert row["as_promised"], row
    assert row["end"] == end
    assert row["held"]  # nothing was let go in the air


def test_a_mishap_needs_a_simulated_bench() -> None:
    real = SimpleNamespace(clock=SimpleNamespace(now_s=lambda: 0.0), upset=None)
    with pytest.raises(InputError, match="fault 'part_falls' needs a simulated bench"):
        Injection("part_falls", "carry").devices(cast(Any, real))


def test_a_run_that_was_split_goes_on_to_its_own_end(rows: dict[tuple[str, str], dict[str, Any]]) -> None:
    assert len(rows) == sum(map(len, SAMPLE.values())) + 1
    assert rows["none", "none"]["as_promised"]
    assert rows["none", "none"]["recovered"]


@pytest.mark.slow
@pytest.mark.parametrize(("fault", "state"), [("camera_black", "carry"), ("arm_frozen", "carry"), ("sighup", "above")])
def test_without_pixels_a_fault_ends_as_it_does_with_them(
    rows: dict[tuple[str, str], dict[str, Any]], fault: str, state: str
) -> None:
    seen = fault_try(DEFAULT_CONFIGURATION, fault, state, 1)
    same = ("end", "exit_status", "held", "recovered", "as_promised", "ticks_to_stop")
    assert {name: seen[name] for name in same} == {name: rows[fault, state][name] for name in same}


def test_all_faults_in_all_states_are_asked_for_by_default() -> None:
    pairs = chosen(None, None)
    assert set(pairs) == {*STATES, *OTHER_STATES}
    assert all(
        set(names) == {name for name, kind in FAULTS.items() if not kind.states or state in kind.states}
        for state, names in pairs.items()
    )


def test_a_fault_of_a_device_ends_in_one_way_alone() -> None:
    """In a state: with a part between the fingers it may be another one."""
    several = {name: kind.ends for name, kind in FAULTS.items() if len(kind.ends) > 1 and not kind.of_world}
    assert several == {}


def test_a_run_that_a_signal_ended_is_not_kept_and_is_the_last(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    seeds: list[int] = []

    def rows_of(_: Path, __: object, seed: int, tell: Callable[[dict[str, Any]], None]) -> None:
        seeds.append(seed)
        row = {"state": "above", "seed": seed, "reason": "", "ticks_to_stop": 1, "stop_s": 0.0, "stop_m": 0.0}
        row |= {"as_promised": True, "end": "interrupted"}
        tell({**row, "fault": "sighup"})  # this fault is a signal
        tell({**row, "fault": "arm_lost"})

    monkeypatch.setattr(faults, "fast_rows", rows_of)
    out = tmp_path / "rows.jsonl"
    words = ["--fault", "sighup", "--fault", "arm_lost", "--state", "above", "--seeds", "7:9", "--out", str(out)]
    assert main(["lab", "eval", "faults", *words]) == 1
    assert seeds == [7]
    assert [json.loads(line).get("fault") for line in out.read_text().splitlines()] == [None, "sighup"]


def test_several_faults_can_be_put_into_one_run() -> None:
    several = Injection.parse("arm_reduced@look,sigint@carry")
    assert isinstance(several, Injections)
    assert [(injection.fault, injection.state) for injection in several.injections] == [
        ("arm_reduced", "look"),
        ("sigint", "carry"),
    ]


def test_a_fault_or_state_that_there_is_not_is_refused() -> None:
    with pytest.raises(InputError, match="unknown fault 'arm_lots'; legal: arm_frozen, "):
        Injection.parse("arm_lots@carry")
    with pytest.raises(InputError, match="unknown fault"):
        Injection.parse("@carry")
    with pytest.raises(InputError, match="unknown state 'look' of fault part_falls; legal: lift, carry, lower"):
        Injection.parse("part_falls@look")
    with pytest.raises(InputError, match="unknown state 'fly'; legal: look, "):
        Injection.parse("arm_lost@fly")
    assert main(["lab", "run", "--inject", "nothing@carry"]) == 2
