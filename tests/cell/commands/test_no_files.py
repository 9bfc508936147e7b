"""What is no file: a pipe whose writer never comes and a device that has no end are refused at once."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

from bracket_cell.commands.main import main

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


def test_a_text_of_gigabytes_is_refused_unread(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    for name in ("cell.yaml", "arm.urdf"):
        with (tmp_path / name).open("wb") as file:
            file.truncate(8_000_000_000)  # a file of zeros that takes no room
    assert main(["run", "--look", "none", "--config", str(tmp_path / "cell.yaml")]) == 2
    assert main(["check", str(tmp_path / "arm.urdf")]) == 2
    assert capsys.readouterr().err.count("8000000000 bytes are too many") == 2
