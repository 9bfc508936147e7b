"""What is no file: a pipe whose writer never comes and a device that has no end are refused at once."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

COMMANDS = {
    "pipe.mcap": [
        *(["replay", "PATH"], ["report", "PATH"], ["show", "PATH"], ["log", "why", "PATH"], ["log", "list", "PATH"]),
        *(["log", "export", "PATH", "--to", "recovered"], ["log", "diff", "PATH", "PATH"], ["run", "--resume", "PATH"]),
        ["log", "to-test", "PATH", "--name", "x"],
    ],
    "pipe.yaml": [
        *(["run", "--config", "PATH"], ["run", "--set", "PATH"], ["doctor", "--config", "PATH"]),
        *(["goals", "--file", "PATH"], ["lab", "sweep", "PATH"], ["run", "--look", "./PATH"]),
        *(["safety", "show", "--config", "PATH"], ["compare", "PATH", "PATH"]),
    ],
    "pipe.urdf": [["check", "PATH"]],
    "pipe.xml": [["check", "PATH"], ["run", "PATH"], ["show", "PATH"]],
    "pipe.json": [["label", ".", "--import", "PATH"]],
    "pipe.jsonl": [["run", "--work-orders", "PATH"]],
}


@pytest.mark.long
@pytest.mark.parametrize("name", COMMANDS)
def test_a_pipe_that_nobody_writes_into_ends_a_command_at_once(name: str, tmp_path: Path) -> None:
    os.mkfifo(tmp_path / name)
    for words in COMMANDS[name]:
        typed = [name if word == "PATH" else word.replace("PATH", name) for word in words]
        ended = subprocess.run(
            [sys.executable, "-m", "bracket_cell", *typed], cwd=tmp_path, capture_output=True, text=True, timeout=60
        )
        assert ended.returncode in (1, 2), (typed, ended)
        assert "Traceback" not in ended.stderr + ended.stdout, (typed, ended)
