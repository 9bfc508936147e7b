"""What a log tells of its tree: statistics by node, and the tree as it stood at a time, as text and picture."""

from __future__ import annotations

import json
import shutil
from dataclasses import replace
from pathlib import Path
from xml.etree import ElementTree

import pytest

from bracket_cell.commands.main import main
from bracket_cell.commands.show import tree_at
from bracket_cell.log.read.frames import Frames
from bracket_cell.log.read.reader import Log, LoggedTick
from bracket_cell.log.replay.logged_tree import logged_tree
from bracket_cell.log.report.node_statistics import node_statistics, statistics_lines
from bracket_ground.errors import InputError, LogError
from bracket_lab.commands.logs import save_snapshots
from btxml.engine.node import StatusChange
from btxml.engine.status import FAILURE, IDLE, RUNNING, SKIPPED, SUCCESS
from tests import ROOT

CASE = ROOT / "tests" / "cases" / "assembly-g0-seed5.mcap"


def with_changes(log: Log, *ticks: list[tuple[str, object, object]]) -> Log:
    """The log, but its first ticks change other nodes; a path is "uid name"."""

    def changed(tick: LoggedTick, changes: list[tuple[str, object, object]]) -> LoggedTick:
        made = [StatusChange(path, int(path.split()[0]), old, new, f"{new.name}") for path, old, new in changes]  # type: ignore[arg-type, attr-defined]
        return replace(tick, changes=tuple(made))

    return replace(log, ticks=tuple(changed(*pair) for pair in zip(log.ticks, ticks, strict=False)))


def test_every_result_of_a_node_is_counted(assembly_log: Log) -> None:
    log = with_changes(
        assembly_log,
        [("1 job", IDLE, RUNNING), ("2 leaf", IDLE, RUNNING), ("3 other", IDLE, SKIPPED)],
        [("2 leaf", RUNNING, FAILURE), ("2 leaf", FAILURE, IDLE)],
        [("2 leaf", IDLE, RUNNING), ("2 leaf", RUNNING, SUCCESS), ("2 leaf", SUCCESS, IDLE)],
        [],
        [("3 other", SKIPPED, RUNNING), ("3 other", RUNNING, IDLE), ("1 job", RUNNING, IDLE)],
    )
    job, leaf, other = node_statistics(log)
    period_s = log.ticks[1].time_s - log.ticks[0].time_s
    assert (job.ticks, job.halted) == (4, 1)
    assert job.running_s == pytest.approx(4 * period_s)
    assert (leaf.ticks, leaf.success, leaf.failure, leaf.reason) == (3, 1, 1, "FAILURE")
    assert leaf.running_s == pytest.approx(period_s)
    assert (other.skipped, other.halted) == (1, 1)
    assert list(statistics_lines([job]))[1].split()[0] == "4"


def test_a_span_counts_only_its_ticks(assembly_log: Log) -> None:
    whole = {node.uid: node for node in node_statistics(assembly_log)}
    middle_s = assembly_log.ticks[len(assembly_log.ticks) // 2].time_s
    halves = [node_statistics(assembly_log, until_s=middle_s), node_statistics(assembly_log, from_s=middle_s + 1e-6)]
    for uid, node in whole.items():
        parts = [statistics for half in halves for statistics in half if statistics.uid == uid]
        assert sum(part.ticks for part in parts) == node.ticks
        assert sum(part.success for part in parts) == node.success


def test_the_tree_stands_as_it_did_at_a_time(assembly_log: Log) -> None:
    shown = tree_at(assembly_log, 4.0)
    assert shown.time_s == pytest.approx(4.0)
    running = {change.uid: change.new for tick in assembly_log.ticks if tick.time_s <= 4.0 for change in tick.changes}
    expected = {uid for uid, status in running.items() if status is RUNNING}
    assert {uid for uid, code in shown.statuses.items() if code == 1} == expected
    with pytest.raises(LogError, match="no tick up to"):
        tree_at(assembly_log, -1.0)


def test_a_log_keeps_folders_of_its_tree(assembly_log: Log) -> None:
    name = assembly_log.metadata["tree"]
    files = {
        "tree/jobs/job.xml": assembly_log.attachments[f"tree/{name}"].replace(b'path="', b'path="../'),
        **{one: text for one, text in assembly_log.attachments.items() if one != f"tree/{name}"},
    }
    log = replace(assembly_log, attachments=files, metadata={**assembly_log.metadata, "tree": "jobs/job.xml"})
    assert len(logged_tree(log).nodes) == len(logged_tree(assembly_log).nodes)
    with pytest.raises(LogError, match="leads out"):
        logged_tree(replace(log, attachments={**files, "tree/../../x.xml": b""}))


def test_a_log_that_ended_before_it_began_holds_no_run(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    log = tmp_path / "run.mcap"
    log.write_bytes(CASE.read_bytes()[:8])
    assert main(["show", str(log)]) == 2
    assert "holds no run" in capsys.readouterr().err


def test_the_command_line_shows_a_log(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    log, svg = tmp_path / "run.mcap", tmp_path / "tree.svg"
    shutil.copy(CASE, log)
    assert main(["show", str(log), "--at", "20"]) == 0
    assert "▶ watch and help" in capsys.readouterr().out
    assert main(["show", str(log), "--at", "20", "--svg", str(svg)]) == 0
    frames = {one.get("stroke-width") for one in ElementTree.parse(svg).iter("{http://www.w3.org/2000/svg}rect")}
    assert {"4", "3"} <= frames  # something runs, something succeeded
    assert main(["log", "info", str(log), "--nodes", "--json"]) == 0
    assert json.loads(capsys.readouterr().out.splitlines()[0])["ticks"] > 500
    assert main(["show", str(log), "--at", "20", "--svg", str(svg)]) == 2
    assert "exists already" in capsys.readouterr().err
    assert main(["show", str(log), "--at", "20", "--svg", str(svg), "--overwrite"]) == 0
    assert main(["show", str(log), "--at", "999"]) == 0
    assert "this is its last tick" in capsys.readouterr().err
    assert main(["show"]) == 2
    assert "name a tree file or a log" in capsys.readouterr().err
    assert main(["show", "trees/assemble.xml", "--at", "3"]) == 2
    assert main(["show", str(log), "--at", "nan"]) == 2
    assert main(["show", "--running", "--at", "3"]) == 2
    assert "--at goes with a log" in capsys.readouterr().err


def test_pictures_that_a_tree_marked_become_files(assembly_log: Log, tmp_path: Path) -> None:
    [frame, *_] = Frames(assembly_log).newest(3.0)
    mark = {"camera": frame.camera, "sequence": 1, "taken_s": frame.time_s, "label": "the part / before"}
    tick = replace(assembly_log.ticks[0], notes=(("snapshot", mark), ("snapshot", {**mark, "taken_s": 999.0})))
    log = replace(assembly_log, ticks=(tick,))
    files = save_snapshots(log, tmp_path / "pictures")
    assert [file.name for file in files] == [f"01-{frame.camera}-the-part-before.jpg"]
    assert files[0].read_bytes() == frame.jpeg
    with pytest.raises(InputError, match="exists already"):
        save_snapshots(log, tmp_path / "pictures")
