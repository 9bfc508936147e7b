"""The twin and a run that works by its wires, for benchmarks: both on an address and in a folder of their own."""

from __future__ import annotations

import json
import subprocess
import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from cell.files.files import shipped
from sim.twin.control import ask
from tests.processes import started

Told = dict[str, Any]


class WiredCell:
    """A twin that serves.

    Attributes:
        config: names the twin's wires.
        log: of the run.
    """

    def __init__(self, folder: Path, config: Path, slower: float) -> None:
        self._folder, self._door, self._slower = folder, folder / "twin.sock", slower
        self.config, self.log = config, folder / "run.mcap"

    def run(self, *more: str) -> subprocess.Popen[str]:
        """`cell run` by the wires; its answer is the last line that it prints."""
        words = ["run", "--config", str(self.config), "--slower", f"{self._slower:g}", "--log", str(self.log)]
        with (self._folder / "run.txt").open("w") as screen:
            command = [sys.executable, "-m", "cell", *words, "--json", *more]
            return subprocess.Popen(command, cwd=self._folder, stdout=subprocess.PIPE, stderr=screen, text=True)

    def fault(self, name: str) -> None:
        """Make something go wrong."""
        ask(self._door, {"fault": name})

    def report(self) -> Told:
        """What was built, by the truth."""
        told: Told = ask(self._door, {"report": True})
        return told


@contextmanager
def wired_cell(folder: Path, host: str, slower: float, more: Sequence[str] = ()) -> Iterator[WiredCell]:
    """A twin with the wires of config/twin_cell.yaml at another address.

    Args:
        more: arguments of `cell twin`.
    """
    folder.mkdir(parents=True, exist_ok=True)
    text = shipped("config", "twin_cell.yaml").read_text().replace("127.0.0.1", host)
    text = text.replace("{kind: page}", "{kind: none}")  # nobody is there who answers
    for beside in ("products.yaml", "sim.yaml"):
        text = text.replace(f": {beside}", f": {shipped('config', beside)}")
    config = folder / "twin_cell.yaml"
    config.write_text(text.replace("runs/twin_gripper", str(folder / "gripper")))
    cell = WiredCell(folder, config, slower)
    words = ["twin", "--config", str(config), "--slower", f"{slower:g}", "--at", str(folder / "twin.sock"), *more]
    with started([sys.executable, "-m", "cell", *words], folder) as twin:
        assert twin.stdout is not None
        for line in twin.stdout:
            if line.startswith("faults:"):
                break
        else:
            assert twin.stderr is not None
            raise RuntimeError(f"the twin did not begin: {twin.stderr.read()}")
        yield cell


def answer_of(run: subprocess.Popen[str], limit_s: float) -> Told:
    """What a run printed as JSON; why it printed none, where it did not."""
    try:
        out, _ = run.communicate(timeout=limit_s)
    except subprocess.TimeoutExpired:
        run.kill()
        run.communicate()
        return {"end": "hung", "reason": f"no end in {limit_s:g} s of the wall"}
    lines = out.splitlines()
    return json.loads(lines[-1]) if lines else {"end": "refused", "reason": f"exit {run.returncode}"}
