"""The twin and a run that works by its wires, for benchmarks: both on an address and in a folder of their own."""

from __future__ import annotations

import json
import re
import subprocess
import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from bracket_cell.runs.signing import sign
from bracket_cell.wiring.safety import safety_from
from bracket_ground.files.files import shipped
from bracket_sim.twin.control import ask
from tests.processes import finished, started

Told = dict[str, Any]


class WiredCell:
    """A twin that serves."""

    def __init__(self, folder: Path, config: Path, slower: float) -> None:
        self._folder, self._config, self._slower = folder, config, slower

    def run(self, limit_s: float) -> Told:
        """What `cell run --json` tells of a run by the wires; log and screen stay in the folder."""
        words = ["run", "--config", str(self._config), "--real-time", f"{self._slower:g}", "--json"]
        log = self._folder / "run.mcap"
        log.unlink(missing_ok=True)
        words += ["--log", str(log)]
        try:
            done = finished(
                [sys.executable, "-m", "bracket_cell", *words], self._folder, limit_s=limit_s * self._slower
            )
        except subprocess.TimeoutExpired:
            return {"end": "hung", "reason": f"no end in {limit_s:g} s of the cell"}
        (self._folder / "run.txt").write_text(done.stderr)
        lines = done.stdout.splitlines()
        return json.loads(lines[-1]) if lines else {"end": "refused", "reason": done.stderr.strip()[-300:]}

    def report(self) -> Told:
        """What was built, by the truth."""
        told: Told = ask(self._folder / "twin.sock", {"report": True})
        return told


def by_ros2(text: str, domain: int) -> str:
    """A configuration of the twin with topics of ROS 2 in place of its wires."""
    where = f"kind: ros2, domain: {domain}"
    lines = {
        "arm": f"{{{where}, middleware: cyclonedds}}",
        "gripper": f"{{{where}, middleware: cyclonedds}}",
        **{
            role: f"{{{where}, topic: /{role}/color/image_raw/compressed, info: /{role}/color/camera_info}}"
            for role in ("overhead", "wrist")
        },
        "panel": f"{{{where}}}",
    }
    for role, device in lines.items():
        text = re.sub(rf"(?m)^  {role}: {{kind.*$", f"  {role}: {device}", text)
    return text


def with_robot(text: str, robot: Path) -> str:
    """A configuration with another arm, which finds its own poses."""
    text = re.sub(r"(?m)^robot: .*$", f"robot: {robot.resolve()}", text)
    return re.sub(r"(?m)^  arm_(park|look)_rad: .*\n", "", text)


@contextmanager
def wired_cell(
    folder: Path,
    host: str,
    slower: float,
    more: Sequence[str] = (),
    domain: int | None = None,
    robot: Path | None = None,
) -> Iterator[WiredCell]:
    """A twin with the wires of config/twin_cell.yaml at another address, or behind ROS 2.

    Args:
        more: arguments of `cell twin`.
        domain: of ROS 2.
        robot: file of another arm.
    """
    folder.mkdir(parents=True, exist_ok=True)
    text = shipped("bracket_cell.config", "twin_cell.yaml").read_text().replace("127.0.0.1", host)
    text = text.replace("{kind: page}", "{kind: none}")  # nobody is there who answers
    for beside in ("products.yaml", "sim.yaml"):
        text = text.replace(f": {beside}", f": {shipped('config', beside)}")
    text = text if domain is None else by_ros2(text, domain)
    text = text if robot is None else with_robot(text, robot)
    config = folder / "twin_cell.yaml"
    config.write_text(text.replace("runs/twin_gripper", str(folder / "gripper")))
    sign(config, safety_from(config), "benchmark")
    words = ["twin", "--config", str(config), "--slower", f"{slower:g}", "--socket", str(folder / "twin.sock"), *more]
    with started([sys.executable, "-m", "bracket_cell", *words], folder) as twin:
        assert twin.stderr is not None  # where the console writes
        told = []
        for line in twin.stderr:
            told.append(line)
            if line.startswith("faults:"):
                break
        else:
            raise RuntimeError(f"the twin did not begin: {''.join(told)}")
        yield WiredCell(folder, config, slower)
