"""Cases kept from logs: those of the repository still hold, and new ones keep what a replay needs."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest

from bracket_cell.commands.main import main
from bracket_cell.log.read.reader import Log, read_log
from bracket_cell.log.replay import case
from bracket_cell.log.replay.case import check_case, write_case
from bracket_cell.log.replay.compare import close, logged
from bracket_ground.errors import InputError, LogError
from tests import ROOT

CASES = sorted((ROOT / "tests" / "cases").glob("*.mcap"))


@pytest.mark.parametrize("path", CASES, ids=lambda path: path.stem)
def test_the_decisions_are_those_of_the_case(path: Path) -> None:
    """After a wanted change: `cell run --log LOG`, then `cell log to-test LOG --name NAME`."""
    assert path.stat().st_size < case.LARGEST_BYTES
    differences = check_case(path)
    assert not differences, f"{len(differences)} differences, first: {differences[0]}"


def test_there_are_cases() -> None:
    assert CASES


def test_a_case_holds_all_decisions_and_no_image(assembly_log: Log, tmp_path: Path) -> None:
    assert write_case(assembly_log, tmp_path / "case.mcap") < case.LARGEST_BYTES
    kept = read_log(tmp_path / "case.mcap")
    assert [logged(tick) for tick in kept.ticks] == [logged(tick) for tick in assembly_log.ticks]
    assert [tick.observation for tick in kept.ticks] == [tick.observation for tick in assembly_log.ticks]
    assert not any(message.topic.startswith("/camera") for message in kept.messages)
    assert check_case(tmp_path / "case.mcap") == []


def test_a_trimmed_case_ends_where_it_was_cut(assembly_log: Log, tmp_path: Path) -> None:
    write_case(assembly_log, tmp_path / "case.mcap", until_s=2.0)
    assert read_log(tmp_path / "case.mcap").ticks[-1].time_s == pytest.approx(2.0)
    assert check_case(tmp_path / "case.mcap") == []


def test_a_case_with_another_decision_differs(assembly_log: Log, tmp_path: Path) -> None:
    changed = [
        replace(message, data=message.data.replace(b'"source":"action"', b'"source":"rumour"'))
        for message in assembly_log.messages
    ]
    assert changed != list(assembly_log.messages)
    write_case(replace(assembly_log, messages=tuple(changed)), tmp_path / "case.mcap")
    assert [difference.aspect for difference in check_case(tmp_path / "case.mcap")] == ["belief"]


def test_rounding_is_no_difference_and_words_are() -> None:
    assert close({"a": [0.5, "x", None]}, {"a": (0.5 + 1e-9, "x", None)})
    assert not close({"a": 0.5}, {"a": 0.501})
    assert not close([1.0], [1.0, 1.0])
    assert not close("act", "wait")


def test_too_large_a_case_is_not_left_behind(
    assembly_log: Log, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(case, "LARGEST_BYTES", 10_000)
    with pytest.raises(InputError, match="legal: less than 10000"):
        write_case(assembly_log, tmp_path / "case.mcap")
    assert not (tmp_path / "case.mcap").exists()
    with pytest.raises(LogError, match="no tick"):
        write_case(assembly_log, tmp_path / "case.mcap", until_s=-1.0)


def test_command_writes_and_checks(assembly_log: Log, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["log", "to-test", str(assembly_log.path), "-o", str(tmp_path), "--name", "begin", "--json"]) == 0
    assert '"differences": 0' in capsys.readouterr().out
    assert (tmp_path / "begin.mcap").exists()
