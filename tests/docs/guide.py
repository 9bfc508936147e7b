"""Does what a guide says: its blocks are files to write, edits, settings to change and commands to type, in order."""

from __future__ import annotations

import json
import os
import re
import shlex
import subprocess
import sys
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import yaml

from tests import ROOT

_BLOCK = re.compile(r"```(yaml|python|xml|diff|console)\n(.*?)```", re.DOTALL)
_FILE = re.compile(r"^(?:# |<!-- |--- )| -->$")
PROGRAMS = {
    "cell": [sys.executable, "-m", "bracket_cell"],
    "python": [sys.executable],
    # as the program, which does not look for modules in the working folder
    "pytest": [sys.executable, "-P", "-m", "pytest", "-p", "no:cacheprovider"],
}
LONG = ("cell run", "cell train", "cell setup calibrate")


@dataclass(frozen=True)
class Step:
    """One block of a file, or one command.

    Attributes:
        kind: yaml, python, xml, diff or console.
    """

    kind: str
    text: str

    @property
    def long(self) -> bool:
        """It takes more than seconds."""
        return self.kind == "console" and any(command in self.text for command in LONG)


def steps(page: str) -> list[Step]:
    """What a page in docs/ tells its reader to do."""
    blocks = _BLOCK.findall((ROOT / "docs" / page).read_text())
    return [
        Step(kind, text) for kind, block in blocks for text in (block.splitlines() if kind == "console" else [block])
    ]


class Reader:
    """Somebody who does what the guide says.

    A command has `  # status N` behind it if that is not 0.

    Attributes:
        folder: where they are; `cd` changes it.
        printed: what the last command printed.
    """

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.printed = ""

    def do(self, step: Step) -> None:
        """One step.

        Raises:
            AssertionError: the command failed, or the assembly was wrong.
        """
        if step.kind == "console":
            self._type(step.text)
            return
        head, _, body = step.text.partition("\n")
        file = self.folder / _FILE.sub("", head).strip()
        if step.kind == "diff":
            old, new = (_side(body, sign) for sign in "-+")
            text = file.read_text()
            assert text.count(old) == 1, f"{file.name} does not have these lines once:\n{old}"
            file.write_text(text.replace(old, new))
            return
        if step.kind == "yaml" and file.name == "cell.yaml":
            body = yaml.safe_dump(_changed(yaml.safe_load(file.read_text()), yaml.safe_load(body)), sort_keys=False)
        file.parent.mkdir(exist_ok=True)
        file.write_text(body)

    def begun(self, line: str) -> subprocess.Popen[str]:
        """A command that goes on while they do something else; what it prints comes line by line."""
        words = shlex.split(line, comments=True)
        return subprocess.Popen(
            [*PROGRAMS[words[0]], *words[1:]],
            cwd=self.folder,
            env={**self._environment(str(self.folder)), "PYTHONUNBUFFERED": "1"},
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
        )

    def _environment(self, own: str) -> dict[str, str]:
        path = os.pathsep.join([str(ROOT), own, *filter(None, [os.environ.get("PYTHONPATH")])])
        return {**os.environ, "PYTHONPATH": path}

    def _type(self, line: str) -> None:
        line, _, status = line.partition("  # status ")
        words = shlex.split(line)
        if words[0] == "cd":
            self.folder = self.folder / words[1]
            return
        settings = dict(word.split("=", 1) for word in _settings(words))
        command = words[len(settings) :]
        assembles = command[:2] == ["cell", "run"] and not any(word.startswith("trees/") for word in command)
        extra = ["--json"] if assembles else []
        own = str(self.folder / settings.pop("PYTHONPATH", "."))
        done = subprocess.run(
            [*PROGRAMS[command[0]], *command[1:], *extra],
            cwd=self.folder,
            env={**self._environment(own), **settings},
            capture_output=True,
            text=True,
            check=False,
        )
        assert done.returncode == int(status or 0), f"{line}\n{done.stdout}{done.stderr}"
        self.printed = done.stdout + done.stderr
        if extra:
            assert json.loads(done.stdout.splitlines()[-1])["correct"] is True, done.stderr


def _side(body: str, sign: str) -> str:
    """The lines of an edit as they are on one side."""
    return "".join(f"{line[1:]}\n" for line in body.splitlines() if line[0] in (" ", sign))


def _settings(words: list[str]) -> Iterator[str]:
    for word in words:
        if "=" not in word or word.startswith("-"):
            return
        yield word


def _changed(old: Mapping[str, Any], new: Mapping[str, Any]) -> dict[str, Any]:
    """The old settings with the keys of the new sections in the place of theirs."""
    merged = {
        section: {**old.get(section, {}), **keys} if isinstance(keys, Mapping) else keys
        for section, keys in new.items()
    }
    return {**old, **merged}
