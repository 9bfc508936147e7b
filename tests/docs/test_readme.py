"""What the README shows of a run is what `make run` prints."""

from __future__ import annotations

import re
import subprocess
import sys
from pathlib import Path

import pytest

from tests import ROOT

LINE = re.compile(r"^ *\d+\.\d\d s  (\w+ +.*)$", re.MULTILINE)


@pytest.mark.slow
def test_the_lines_of_the_readme_are_printed_in_this_order(tmp_path: Path) -> None:
    settings = re.search(r"^RUN_ARGS \?= (.*)$", (ROOT / "Makefile").read_text(), re.MULTILINE)
    assert settings is not None
    command = [sys.executable, "-m", "cell", "run", *settings[1].split()]
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=True)
    printed = iter(LINE.findall(done.stderr))
    shown = LINE.findall((ROOT / "README.md").read_text())
    assert len(shown) > 10
    assert [line for line in shown if line not in printed] == []  # `in` goes on behind the line that it found
