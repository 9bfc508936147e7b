"""Training data that a training makes for itself, in a process of its own: torch and software OpenGL do not mix."""

from __future__ import annotations

import hashlib
import json
import os
import shlex
import signal
import subprocess
import sys
import tempfile
import threading
from collections.abc import Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from typing import IO

from bracket_cell.commands.terminal import BESIDE, console
from bracket_cell.configuration import load_configuration, load_product
from bracket_ground.errors import InputError
from bracket_ground.files.files import MANIFEST, require_free

GRACE_S = 2.0  # a terminal tells them of Ctrl-C by itself: a second one would break off how they end
LONGEST_S = 20.0  # to end; what began in the background of a shell does not hear of SIGINT
HIDDEN = "_data"  # the command of `worlds`; an installed cell has no `cell lab data`
RECIPE = "recipe.json"  # in the folder: what it was made by, and for


class Children:
    """Runs commands, each waited for by a thread of its own, until they are interrupted together."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._running: list[subprocess.Popen[bytes]] = []
        self._ended = False

    def run(self, words: Sequence[str], output: IO[str] | None, complaints: IO[str] | None = None) -> int:
        """Run one to its end; returns its status. Once they were interrupted, nothing begins any more.

        Args:
            told: file for what it says; the terminal by default.
            complaints: file for what it says on standard error; by default the same.
        """
        with self._lock:
            if self._ended:
                return -signal.SIGINT
            beside = {**os.environ, BESIDE: "1"}
            process = subprocess.Popen(words, stdout=output, stderr=complaints or output, env=beside)
            self._running.append(process)
        status = process.wait()
        with self._lock:
            self._running.remove(process)
        return status

    def interrupt(self) -> None:
        """As Ctrl-C does, for those that have not heard of it; those that go on all the same are terminated."""
        with self._lock:
            self._ended, running = True, tuple(self._running)
        for process in running:
            try:
                process.wait(GRACE_S)
            except subprocess.TimeoutExpired:
                with suppress(ProcessLookupError):
                    process.send_signal(signal.SIGINT)
        for process in running:
            try:
                process.wait(LONGEST_S)
            except subprocess.TimeoutExpired:
                process.terminate()


def make_data(what: str, folder: Path, options: Mapping[str, object], *flags: str) -> None:
    """Make a data set in a process of its own, unless it exists already; what was interrupted is made anew.

    Args:
        options: by name, as in {"--look": "varied"}.

    Raises:
        InputError: the data could not be made; what the command said is in the message. Or the folder holds data of
            other options, or of another product or bench, or something else.
    """
    config = options.get("--config")
    given = {name: value for name, value in options.items() if name != "--config"}
    recipe = {"data": what, **given, **dict.fromkeys(flags, True)}
    recipe |= {"made_for": fingerprint(config)} if isinstance(config, Path) else {}
    require_usable(folder)
    if (folder / MANIFEST).exists():
        _require(folder, json.loads(json.dumps(recipe)))
        console().print(f"data: {folder}, made before", highlight=False)
        return
    words = [HIDDEN, what, *flags, *(str(word) for option in options.items() for word in option)]
    console().print(f"data: {shlex.join([*words[1:], '--out', str(folder)])}", highlight=False)
    command = [sys.executable, "-m", "bracket_cell", *words, "--out", str(folder)]
    with tempfile.TemporaryFile("w+") as complaints:
        if status := _run(command, complaints):
            complaints.seek(0)
            said = (complaints.read().strip() or f"status {status}").splitlines()[-1]
            raise InputError(f"training data could not be made: {said}")
    (folder / RECIPE).write_text(json.dumps(recipe, indent=1) + "\n", encoding="utf-8")


def require_usable(*folders: Path) -> None:
    """Check, before any data are made, that folders hold training data or can take them.

    Raises:
        InputError: one holds something else.
    """
    for folder in folders:
        if not (folder / MANIFEST).exists():
            require_free(folder)


def _run(command: Sequence[str], complaints: IO[str]) -> int:
    """Run a command to its end; SIGINT or SIGTERM to this process alone ends it, too."""
    children, before = Children(), signal.signal(signal.SIGTERM, signal.default_int_handler)
    try:
        return children.run(command, None, complaints)
    except KeyboardInterrupt:
        children.interrupt()
        raise
    finally:
        signal.signal(signal.SIGTERM, before)


def fingerprint(config: Path) -> str:
    """Of the product and the bench of a configuration, which training data show."""
    configuration = load_configuration(config)
    product = load_product(configuration, config)
    text = product.model_dump_json() + configuration.bench.model_dump_json()
    return hashlib.sha256(text.encode()).hexdigest()[:16]


def _require(folder: Path, recipe: dict[str, object]) -> None:
    """Check that data which are there are those that are wanted; folders that people made are taken as they are."""
    path = folder / RECIPE
    if not path.exists():
        return
    found = json.loads(path.read_text("utf-8"))
    if found != recipe:
        other = sorted(name for name in {*found, *recipe} if found.get(name) != recipe.get(name))
        words = {"made_for": "product or bench"}
        raise InputError(
            f"{folder}: training data made with other settings ({', '.join(words.get(name, name) for name in other)}); "
            "remove the folder, or name another --out"
        )
