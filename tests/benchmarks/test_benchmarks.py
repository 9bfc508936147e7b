"""Benchmarks cannot rot: each is imported and says how it is run, and those of `make bench` are there."""

from __future__ import annotations

import importlib
import re
import sys
from pathlib import Path

import numpy as np
import pytest

from tests import ROOT
from tests.benchmarks.ros_delays import commands_to_motion

SHARED = {
    "asking",
    "clearing",
    "clearing_stacks",
    "kill_moment",
    "ros_delays",
    "wired_cell",
}  # what several use, or a long one leaves out
FOLDER = Path(__file__).parent
NAMES = sorted(path.stem for path in FOLDER.glob("[!_]*.py") if not path.stem.startswith("test_"))
TORCH = {"track_probe"}
NAMED = [*(ROOT / "docs" / "figures").glob("*.json"), ROOT / "Makefile"]
COMMANDS = {line for file in NAMED for line in re.findall(r"-m (tests\.benchmarks\.[^\n\"]*)", file.read_text())}


@pytest.mark.parametrize(
    "name", [pytest.param(name, marks=[pytest.mark.torch] if name in TORCH else []) for name in NAMES]
)
def test_a_benchmark_says_how_it_is_run(
    name: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    module = importlib.import_module(f"tests.benchmarks.{name}")
    if name in SHARED:
        return
    monkeypatch.setattr(sys, "argv", [name, "--help"])
    with pytest.raises(SystemExit) as ended:
        module.main()
    assert ended.value.code == 0
    told = capsys.readouterr().out
    assert "usage: " in told
    lines = [line for line in COMMANDS if f"tests.benchmarks.{name} " in f"{line} "]
    used = {option for line in lines for option in re.findall(r" (--[\w-]+)", line)}
    assert used <= set(re.findall(r"--[\w-]+", told)), lines


def test_make_bench_runs_benchmarks_that_are_there() -> None:
    named = set(re.findall(r"-m tests\.benchmarks\.(\w+)", (ROOT / "Makefile").read_text()))
    assert named
    assert named <= set(NAMES) - SHARED


def test_a_page_names_every_benchmark() -> None:
    pages = [*(ROOT / "docs").rglob("*.md"), ROOT / "README.md", ROOT / "Makefile"]
    named = set(re.findall(r"tests[./]benchmarks[./](\w+)", "\n".join(page.read_text() for page in pages)))
    assert set(NAMES) - SHARED <= named, "delete it, or say in docs/ what it is for"


def test_a_command_is_late_until_the_first_sample_that_moves() -> None:
    speeds = np.array([[at / 10, 0.0 if at < 13 else 1.0 if at < 30 else 0.0] for at in range(60)])
    assert commands_to_motion([1.05, 1.15, 2.0], speeds) == pytest.approx([0.25]), "a moving arm has begun already"
    assert commands_to_motion([4.0], speeds) == [], "it never moved"
    assert commands_to_motion([1.0], np.zeros((0, 2))) == []
