"""The controller is killed by SIGKILL at a random moment; the simulated world goes on, and another one takes over.

python -m tests.benchmarks.restarts --bare --kills 100 --first-seed 2000
python -m tests.benchmarks.restarts --kills 6 --first-seed 2000             # rendered, with the trained detectors
Every kill is one assembly in a world of its own. It comes a random time after a random number of parts stands in the
bracket, as soon as the cell is in the state that the seed has drawn, and at the latest with the last part: so every
kill is within the work. The table has the state in which it came. "asks" is tried in a shift of one bracket of a goal
that nobody listed, where somebody is there to answer. The second controller is `cell run --resume LOG` for one half
of the seeds, and begins without a log for the others. With --brackets 3 the work is a shift of so many brackets.
Stopped by Ctrl-C it prints what it has.
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
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Any

from bracket_cell.configuration import Configuration, for_shift
from bracket_cell.wiring.detectors import detectors_of
from bracket_ground.interfaces.command import Display
from bracket_ground.interfaces.operator import Question
from bracket_sim.cell import SimCell
from bracket_sim.process.buses import CarriedBuses
from bracket_sim.process.messages import Drawn
from bracket_sim.process.no_render_host import without_pixels
from bracket_sim.process.opening import identity
from bracket_sim.process.server import WorldServer
from bracket_sim.scene.settings import settings_of
from tests.benchmarks.kill_moment import STATES, Moment, held_part
from tests.integration.cell_rig import BENCH, CAN, CONFIGURATION, PRODUCT


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
    state: str = ""
    _controller: subprocess.Popen[str] | None = field(default=None, init=False)
    _killed: bool = field(default=False, init=False)

    def run(self) -> dict[str, Any]:
        """The row of the table."""
        chance = random.Random(self.seed)
        wanted_state = STATES[self.seed // 2 % len(STATES)]
        self.brackets = self.brackets or int(wanted_state == "asks")
        self._within_s = chance.uniform(0.0, 0.03)
        goal = sorted(PRODUCT.goals)[self.seed % len(PRODUCT.goals)]
        configuration = for_shift(CONFIGURATION, self.brackets) if self.brackets else CONFIGURATION
        simulation = settings_of(configuration.devices.simulation)
        if wanted_state == "asks":  # of a goal that nobody listed it surely asks
            habits = simulation.person.shift.model_copy(update={"new_goals": 1.0})
            person = simulation.person.model_copy(update={"shift": habits})
            simulation = simulation.model_copy(update={"person": person})
        wanted = "random" if self.brackets else goal
        rendered = not self.bare
        detect = partial(detectors_of, configuration.bench, PRODUCT, configuration.perception)
        self._cell = cell = SimCell(
            PRODUCT, BENCH, simulation, *CAN, self.seed, wanted, overlap=rendered, rendered=rendered, detect=detect
        )
        self._moment = Moment(cell, wanted_state, max(self.brackets, 1) * len(PRODUCT.positions), chance)
        address = self.folder / "world.sock"
        show = cell.devices.panel.show

        def shown(display: Display) -> None:
            self._hear(display)
            show(display)

        cell.devices.panel.show = shown  # type: ignore[method-assign]
        server = served(cell, configuration, address, Drawn(self.seed, wanted), self._watch)
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
        command = [*controller(address, log), *more]
        if self.brackets:
            command += ["--shift", str(self.brackets)]
        with (self.folder / f"{log.stem}.err").open("w") as errors:
            self._controller = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=errors, text=True)
            out, _ = self._controller.communicate()
        told: dict[str, Any] = json.loads(out.splitlines()[-1]) if out.strip() else {}
        return told | {"exit": self._controller.returncode}

    def _watch(self, time_s: float) -> None:
        """Kill the first controller when it is time, somewhere in its tick."""
        if self._killed or self._controller is None or not self._moment.come(time_s):
            return
        self._killed, self.died_s, self.doing, self.state = True, time_s, self.message, self._moment.state()
        process = self._controller.pid

        def kill() -> None:
            with suppress(ProcessLookupError):
                os.kill(process, signal.SIGKILL)

        threading.Timer(self._within_s, kill).start()

    def _hear(self, display: Display) -> None:
        self.message, self._moment.asks = display.message, bool(display.questions)
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
            if self._cell.score.goal not in PRODUCT.goals:
                return False  # nobody can know it by what stands there
            fitting = [name for name in PRODUCT.goals if placed.items() <= PRODUCT.goal_placements(name).items()]
            return len(fitting) == 1 and self.seed % 2 == 0
        if question.kind == "mend":
            return not self._cell.score.report()["wrong_placements"]
        if not question.part:  # "take the part out of the gripper"
            return self.seed % 2 == 0 or held_part(self._cell) is None
        return False

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
            "state": self.state,
            "doing": self.doing,
            "reason": told.get("reason"),
            "asked": self.asked,
            "needless": self.needless,
            "robot": told.get("robot_placements"),
            "sim_time_s": told.get("sim_time_s"),
            "exit": told.get("exit"),
        }


def served(
    cell: SimCell, configuration: Configuration, address: Path, drawn: Drawn, watch: Callable[[float], None]
) -> WorldServer:
    """A server of this cell; of one that renders nothing, hands, holes and parts come from the truth."""
    devices = cell.devices if cell.sight is None else without_pixels(cell, configuration, PRODUCT)
    buses = CarriedBuses(configuration.devices.virtual_channels)
    period_s = settings_of(configuration.devices.simulation).physics.control_period_s
    return WorldServer(devices, buses, address, period_s, identity(PRODUCT), drawn, watch=watch)


def controller(address: Path, log: Path) -> list[str]:
    """The command of a controller for the world at an address."""
    return [sys.executable, "-m", "bracket_cell", "lab", "run", "--world", str(address), "--log", str(log), "--json"]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--kills", type=int, default=20)
    parser.add_argument("--first-seed", type=int, default=2000)
    parser.add_argument("--brackets", type=int, default=0, help="a shift of so many brackets instead of one assembly")
    parser.add_argument("--bare", action="store_true", help="nothing is rendered: a third of the processor time")
    parser.add_argument("--keep", type=Path, help="folder for the logs of kills that did not end right")
    options = parser.parse_args()
    verdicts, by_state = Counter[str](), Counter[tuple[str, str]]()
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
            by_state[row["state"], row["verdict"]] += 1
            sys.stdout.write(json.dumps(row) + "\n")
            sys.stdout.flush()
    sys.stdout.write(table(by_state))


def table(by_state: Counter[tuple[str, str]]) -> str:
    """How many kills in each state (rows) ended how (columns); a run that was over before was not killed."""
    killed = Counter({key: count for key, count in by_state.items() if key[0]})
    verdicts = sorted({verdict for _, verdict in killed}, key=lambda verdict: verdict != "right")
    lines = [f"| killed while it | kills | {' | '.join(verdicts)} |", f"|---|---|{'---|' * len(verdicts)}"]
    for name in (*STATES, "all"):
        counts = [
            sum(n for (state, end), n in killed.items() if name in (state, "all") and end == verdict)
            for verdict in verdicts
        ]
        lines.append(f"| {name} | {sum(counts)} | {' | '.join(map(str, counts))} |")
    over = sum(by_state.values()) - sum(killed.values())
    return "\n".join([*lines, f"{over} were over before they were killed", ""])


if __name__ == "__main__":
    main()
