"""What a thread that keeps pace with the wall asks of the system and of the interpreter."""

from __future__ import annotations

import sys

import pytest

from bracket_cell.remote import priority


@pytest.mark.parametrize("permitted", [True, False])
def test_other_threads_hand_on_sooner_while_one_keeps_pace(monkeypatch: pytest.MonkeyPatch, permitted: bool) -> None:
    def refuse(*_: object) -> None:
        raise PermissionError

    monkeypatch.setattr("os.sched_setscheduler", (lambda *_: None) if permitted else refuse)
    before_s = sys.getswitchinterval()
    with priority.preferred() as granted:
        assert granted == permitted
        assert sys.getswitchinterval() < before_s / 5
    assert sys.getswitchinterval() == before_s


def test_nothing_is_asked_for_a_run_that_waits_for_nobody() -> None:
    before_s = sys.getswitchinterval()
    with priority.preferred(wanted=False) as granted:
        assert (granted, sys.getswitchinterval()) == (False, before_s)
