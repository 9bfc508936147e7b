"""The controller is killed by SIGKILL at a random moment; the simulated world goes on, and another one takes over.

python -m tests.benchmarks.restarts --kills 100 --first-seed 2000
Every kill is one assembly in a world of its own. The second controller is `cell run --resume LOG` for even seeds, and
begins without a log for odd ones. With --brackets 3 the work is a shift of so many brackets. Stopped by Ctrl-C it
prints what it has.
"""

from __future__ import annotations

import argparse
import json
import os
import random
import signal
import subprocess
import sys
import tempfile
import threading
from collections import Counter
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from cell.configuration import for_shift
from cell.evaluating.bare_host import without_pixels
from cell.interfaces.command import Display
from cell.interfaces.operator import Question
from cell.world.buses import CarriedBuses
from cell.world.messages import Drawn
from cell.world.opening import identity
from cell.world.server import WorldServer
from sim.cell import SimCell
from tests.integration.cell_rig import BENCH, CAN, CONFIGURATION, PRODUCT

EARLIEST_S, LATEST_S, LATEST_BRACKET_S = 1.0, 50.0, 70.0


@dataclass
class Trial:
    """One world, and its two controllers.

    Attributes:
        asked: what the second controller asked, and whether the cameras could have told.
    """

    seed: int
    brackets: int
    folder: Path
    bare: bool = False
    died_s: float = 0.0
    asked: list[str] = field(default_factory=list)
    needless: list[str] = field(default_factory=list)
    message: str = ""
    doing: str = ""

    def run(self) -> dict[str, Any]:
        """The row of the table."""
        chance = random.Random(self.seed)
        latest_s = LATEST_S if not self.brackets else self.brackets * LATEST_BRACKET_S
        self._kill_s = chance.uniform(EARLIEST_S, latest_s)
        self._within_s = chance.uniform(0.0, 0.03)
        goal = sorted(PRODUCT.goals)[self.seed % len(PRODUCT.goals)]
        configuration = for_shift(CONFIGURATION, self.brackets) if self.brackets else CONFIGURATION
        simulation = configuration.devices.simulation
        wanted = "random" if self.brackets else goal
        rendered = not self.bare
        self._cell = cell = SimCell(
            PRODUCT, BENCH, simulation, *CAN, self.seed, wanted, overlap=rendered, rendered=rendered
        )
        devices = without_pixels(cell) if self.bare else cell.devices
        show = cell.devices.panel.show

        def shown(display: Display) -> None:
            self._hear(display)
            show(display)

        cell.devices.panel.show = shown  # type: ignore[method-assign]
        self._controller: subprocess.Popen[str] | None = None
        self._killed = False
        address = self.folder / "world.sock"
        period_s = simulation.physics.control_period_s
        server = WorldServer(
            devices,
            CarriedBuses(configuration),
            address,
            period_s,
            identity(PRODUCT),
            Drawn(self.seed, wanted),
            watch=self._watch,
        )
        lines: list[dict[str, Any]] = []
        controllers = threading.Thread(target=self._controllers, args=(address, lines, server), daemon=True)
        controllers.start()
        try:
            server.serve()
            controllers.join()
            return self._row(lines)
        finally:
            if self._controller is not None:
                self._controller.kill()
            cell.close()

    def _controllers(self, address: Path, lines: list[dict[str, Any]], server: WorldServer) -> None:
        try:
            first, second = self.folder / "first.mcap", self.folder / "second.mcap"
            lines.append(self._control(address, first, ()))
            if not self._killed:
                return
            begun = next((path for path in (first, self.folder / "first.0001.mcap") if path.exists()), None)
            resume = ("--resume", str(begun)) if self.seed % 2 == 0 and begun is not None else ()
            lines.append(self._control(address, second, resume))
        finally:
            server.end()

    def _control(self, address: Path, log: Path, more: tuple[str, ...]) -> dict[str, Any]:
        command = [sys.executable, "-m", "cell", "run", "--world", str(address), "--log", str(log), "--json", *more]
        if self.brackets:
            command += ["--brackets", str(self.brackets)]
        with (self.folder / f"{log.stem}.err").open("w") as errors:
            self._controller = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=errors, text=True)
            out, _ = self._controller.communicate()
        told: dict[str, Any] = json.loads(out.splitlines()[-1]) if out.strip() else {}
        return told | {"exit": self._controller.returncode}

    def _watch(self, time_s: float) -> None:
        """Kill the first controller when it is time, somewhere in its tick."""
        if self._killed or time_s < self._kill_s or self._controller is None:
            return
        self._killed, self.died_s, self.doing = True, time_s, self.message
        process = self._controller.pid

        def kill() -> None:
            with suppress(ProcessLookupError):
                os.kill(process, signal.SIGKILL)

        threading.Timer(self._within_s, kill).start()

    def _hear(self, display: Display) -> None:
        self.message = display.message
        for question in display.questions if self._killed else ():
            if question.reason not in self.asked:
                self.asked.append(question.reason)
                if self._needless(question):
                    self.needless.append(question.reason)

    def _needless(self, question: Question) -> bool:
        """Whether somebody who sees the bench, and knows what the log says, would not ask this."""
        placed = self._cell.score.report()["placements"]
        assert isinstance(placed, dict)
        if question.kind == "bracket":
            return len(placed) < len(PRODUCT.positions)
        if question.kind == "goal":
            fitting = [name for name in PRODUCT.goals if placed.items() <= PRODUCT.goal_placements(name).items()]
            return len(fitting) == 1 and self.seed % 2 == 0
        if question.kind == "mend":
            return not self._cell.score.report()["wrong_placements"]
        if not question.part:  # "take the part out of the gripper"
            return self.seed % 2 == 0 or self._held() is None
        return False

    def _held(self) -> str | None:
        """Type of the part between the fingers, in truth."""
        tool_m = np.array(self._cell.world.tool_pose().position_m)
        near = [
            body.part
            for body in self._cell.world.bodies
            if float(np.linalg.norm(self._cell.world.data.xpos[body.body] - tool_m)) < 0.04
        ]
        return near[0] if near else None

    def _row(self, lines: list[dict[str, Any]]) -> dict[str, Any]:
        told = lines[-1] if lines else {}
        lost = sum(bool(self._cell.world.data.xpos[body.body][2] < -0.01) for body in self._cell.world.bodies)
        right = told.get("finished") and told.get("correct") is True and not told.get("wrong")
        if self.brackets:
            right = told.get("finished") and told.get("right") == self.brackets
        verdict = "over before" if not self._killed else "right" if right else f"{told.get('end', 'no summary')}"
        if self._killed and lost:
            verdict = "part lost"
        elif verdict == "right" and self.needless:
            verdict = "right, asked needlessly"
        elif verdict == "finished":
            verdict = "not right"
        return {
            "seed": self.seed,
            "log": self.seed % 2 == 0,
            "verdict": verdict,
            "killed_s": round(self.died_s, 2),
            "doing": self.doing,
            "reason": told.get("reason"),
            "asked": self.asked,
            "needless": self.needless,
            "robot": told.get("robot_placements"),
            "sim_time_s": told.get("sim_time_s"),
            "exit": told.get("exit"),
        }


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--kills", type=int, default=20)
    parser.add_argument("--first-seed", type=int, default=2000)
    parser.add_argument("--brackets", type=int, default=0, help="a shift of so many brackets instead of one assembly")
    parser.add_argument("--bare", action="store_true", help="nothing is rendered: a third of the processor time")
    parser.add_argument("--keep", type=Path, help="folder for the logs of kills that did not end right")
    options = parser.parse_args()
    verdicts = Counter[str]()
    signal.signal(signal.SIGTERM, lambda *_: signal.raise_signal(signal.SIGINT))
    with suppress(KeyboardInterrupt):
        for seed in range(options.first_seed, options.first_seed + options.kills):
            with tempfile.TemporaryDirectory() as folder:
                row = Trial(seed, options.brackets, Path(folder), options.bare).run()
                if options.keep is not None and not row["verdict"].startswith("right"):
                    options.keep.mkdir(parents=True, exist_ok=True)
                    for file in Path(folder).glob("*.[em]*"):
                        (options.keep / f"{seed}-{file.name}").write_bytes(file.read_bytes())
            verdicts[row["verdict"]] += 1
            sys.stdout.write(json.dumps(row) + "\n")
            sys.stdout.flush()
    killed = sum(count for verdict, count in verdicts.items() if verdict != "over before")
    sys.stdout.write(f"| verdict | of {killed} kills |\n|---|---|\n")
    sys.stdout.writelines(f"| {verdict} | {count} |\n" for verdict, count in verdicts.most_common())


if __name__ == "__main__":
    main()
