"""Training data that a training makes for itself, in a process of its own: torch and software OpenGL do not mix."""

from __future__ import annotations

import shlex
import shutil
import subprocess
import sys
from collections.abc import Mapping
from pathlib import Path

from cell.commands.terminal import console
from cell.interfaces.errors import InputError


def make_data(what: str, folder: Path, options: Mapping[str, object], *flags: str) -> None:
    """Run `cell data WHAT` into a folder, unless it is there already; what was interrupted is made anew.

    Args:
        options: by name, as in {"--look": "varied"}.

    Raises:
        InputError: the data could not be made; what the command said is in the message.
    """
    if (folder / "manifest.json").exists():
        console().print(f"data: {folder}, made before", highlight=False)
        return
    words = ["data", what, *flags, *(str(word) for option in options.items() for word in option)]
    console().print(f"cell {shlex.join([*words, '--out', str(folder)])}", highlight=False)
    unfinished = folder.with_name(f"{folder.name}.unfinished")
    shutil.rmtree(unfinished, ignore_errors=True)
    command = [sys.executable, "-m", "cell", *words, "--out", str(unfinished)]
    done = subprocess.run(command, stderr=subprocess.PIPE, text=True, check=False)
    if done.returncode:
        said = (done.stderr.strip() or f"status {done.returncode}").splitlines()[-1]
        raise InputError(f"training data could not be made: {said}")
    unfinished.rename(folder)
