"""A log says when, where and with what it was made, and a replay names what has changed since."""

from __future__ import annotations

import os
from datetime import UTC, datetime, timedelta
from pathlib import Path

from bracket_cell.recording.identity import PACKAGES, identity, versions, what_changed


def test_a_run_is_told_from_every_other() -> None:
    first, second = identity(), identity()
    assert first["run_id"] != second["run_id"]
    assert abs(datetime.now(UTC) - datetime.fromisoformat(first["started_utc"])) < timedelta(minutes=1)
    assert len(first["commit"]) == 40 or first["commit"] == "unknown"
    assert first["clean"] in ("true", "false", "unknown")
    assert {f"version.{name}" for name in PACKAGES} <= set(first)


def test_there_are_no_secrets_in_it() -> None:
    said = " ".join(identity().values())
    assert os.environ.get("USER", "nobody-at-all") not in said.split()
    assert str(Path.home()) not in said


def test_versions_that_changed_are_named() -> None:
    recorded = {**versions(), "version.pin": "0.0.1", "version.placo": "0.10.2", "seed": "7"}
    assert what_changed(recorded) == [f"pin was 0.0.1, is {versions()['version.pin']}"]
