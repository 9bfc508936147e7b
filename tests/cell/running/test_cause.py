"""Why a tree failed is told by its deepest failure."""

from __future__ import annotations

from cell.watching.statistics import FailureCause
from trees.engine.node import FAILURE, IDLE, RUNNING, SUCCESS, StatusChange


def change(path: str, uid: int, new: object, feedback: str) -> StatusChange:
    return StatusChange(path, uid, RUNNING, new, feedback)  # type: ignore[arg-type]


def test_the_last_failure_with_a_reason_is_told_with_its_count() -> None:
    cause = FailureCause()
    for _ in range(16):
        cause.add([change("Fetch/FindPart::7", 7, FAILURE, "no o9 in the tray"), change("Fetch::2", 2, FAILURE, "")])
        cause.add([StatusChange("Fetch/FindPart::7", 7, FAILURE, IDLE, "")])
    cause.add([change("Fetch/AskForHelp::9", 9, SUCCESS, "help is asked for"), change("Fetch::2", 2, FAILURE, "")])
    assert str(cause) == "FindPart: no o9 in the tray (16 times)"


def test_without_a_failure_there_is_no_cause() -> None:
    cause = FailureCause()
    cause.add([change("A::1", 1, SUCCESS, "done")])
    assert str(cause) == ""
