"""The shipped rules hold on the shipped trees; a tree broken on purpose is found by check, Bench, run and log alike."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import pytest
from rich.console import Console

from bracket_cell.commands.main import main
from bracket_cell.log.read.reader import read_log
from bracket_cell.log.report.rules import judge
from bracket_cell.runs.options import RunOptions
from bracket_cell.runs.run import run
from bracket_cell.trees import Bench
from tests import ROOT

RULES = ROOT / "trees" / "assembly.rules.yaml"
GUARD = "the guard agreed within a second of every placement, until the part is let go"
GUARDED = '<CheckPlacement plan="{plan}" state="{state}" part="{part}" position="{position}"/>'


def with_rules(folder: Path, name: str, broken: bool = False) -> Path:
    """A shipped tree with the rules beside it; broken, the guard is asked once and not while the arm places."""
    for file in (ROOT / "trees").glob("*.xml"):
        shutil.copy(file, folder)
    shutil.copy(RULES, folder / f"{name}.rules.yaml")
    tree = folder / f"{name}.xml"
    if broken:
        text = tree.read_text().replace(GUARDED, '<WithoutGuard reason="broken on purpose"/>')
        begin = '<Sequence name="place the part">'
        assert begin in text
        tree.write_text(text.replace(begin, f"{begin}{GUARDED}"))
    return tree


@pytest.mark.long
@pytest.mark.parametrize("name", ["assemble", "ahead"])
def test_check_finds_no_way_to_break_them(name: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["check", str(with_rules(tmp_path, name)), "--config", "config/cell.yaml"]) == 0, (
        capsys.readouterr().err
    )


def test_check_and_bench_find_the_tree_that_is_broken(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    tree = with_rules(tmp_path, "assemble", broken=True)
    assert main(["check", str(tree), "--config", "config/cell.yaml"]) == 0
    assert f"note: rule '{GUARD}' can be broken" in capsys.readouterr().err
    answers = {"PlacePart": "R", "GripperIsEmpty": "F"}
    bench = Bench(tree, answers, main="PickAndPlace", part=True, rules=[RULES])
    for _ in range(40):
        bench.tick(0.1)
    assert [violation.rule for violation in bench.violations] == [GUARD]
    assert "the tool stays above the bench" in bench.unknown, "a bench knows nothing of devices"


def test_recorded_runs_keep_them(capsys: pytest.CaptureFixture[str]) -> None:
    logs = [str(path) for path in sorted((ROOT / "tests" / "cases").glob("assembly-*.mcap"))]
    assert main(["log", "rules", *logs, "--rules", str(RULES), "--json"]) == 0
    for line in capsys.readouterr().out.splitlines():
        told = json.loads(line)
        for name, ticks in told["rules"].items():
            assert ticks == {"kept": told["ticks"], "broken": 0, "unknown": 0}, name


@pytest.mark.slow
def test_a_run_and_its_log_find_it_in_the_same_tick(tmp_path: Path) -> None:
    tree, log = with_rules(tmp_path, "assemble", broken=True), tmp_path / "log.mcap"
    run(RunOptions(tree, ROOT / "config" / "cell.yaml", "g0", 1, "fast", log, max_duration_s=90.0), Console(quiet=True))
    first = next(violation for violation in judge(log, [RULES]).violations if violation.rule == GUARD)
    held = [
        tick.number
        for tick in read_log(log).ticks
        for reason in (tick.judgement or {}).get("reasons", ())
        if reason["signal"] == "rule_holds" and GUARD in reason["words"]
    ]
    assert held[0] == first.tick
