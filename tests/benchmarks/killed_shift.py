"""A long shift whose controller is killed by SIGKILL at drawn moments; each next one is `cell run --resume LOG`.

python -m tests.benchmarks.killed_shift --hours 4 --kills 10 --within 1.5 --seed 91000 --folder killed_shift
Nothing is rendered: hands, holes and parts come from the truth. The folder keeps the logs, a line each minute of the
cell's time (minutes.jsonl) and a line each kill (kills.jsonl). The table says how memory and handles of controller and
world went, how many ticks took longer than their period, and what the bracket has from the truth: holes with two
parts, holes that the robot filled again, brackets that were right. Ctrl-C or SIGTERM ends the shift as always, and
the table has what was done so far.
"""

from __future__ import annotations

import argparse
import json
import os
import random
import signal
import subprocess
import sys
import threading
import time
from collections import Counter
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np

from bracket_cell.configuration import for_shift
from bracket_sim.cell import SimCell
from bracket_sim.process.messages import Drawn
from bracket_sim.scene.settings import settings_of
from tests.benchmarks.kill_moment import Moment
from tests.benchmarks.restarts import controller, served
from tests.integration.cell_rig import BENCH, CAN, CONFIGURATION, PRODUCT

HOUR_S, MINUTE_S, LOOKS_S = 3600.0, 60.0, 0.2
NEAR_M, ABOVE_M, STAYS_LOOKS = 0.03, 0.06, 10  # two parts at a hole for 2 s; a hand that passes does not count
WITHIN_S = 0.03  # the wall's, after a tick
EARLIEST_S = 30.0  # between kills, so that each next controller has begun its work


class Bracket:
    """Watches the holes in truth.

    Attributes:
        doubles: where two parts stood in or on a hole, (time in s, hole).
        again: where the robot filled a hole a second time in one bracket.
    """

    def __init__(self, cell: SimCell) -> None:
        self._cell = cell
        pose, holes = BENCH.bracket.pose, PRODUCT.bracket.holes_m.items()
        self._holes = {name: pose.transform(np.array([*xy, 0.0])) for name, xy in holes}
        self._crowded, self._by_robot = Counter[str](), Counter[str]()
        self._filled: set[str] = set()
        self._number = 0
        self.doubles: list[tuple[float, str]] = []
        self.again: list[tuple[float, str]] = []

    def look(self, time_s: float) -> None:
        """Compare with the look before."""
        number = len(self._cell.devices.finished())
        if number != self._number:
            self._number, self._filled = number, set()
            self._by_robot.clear()
        for name, hole in self._holes.items():
            off = np.array([self._cell.world.data.xpos[part.body] for part in self._cell.world.bodies]) - hole
            near = (np.hypot(off[:, 0], off[:, 1]) < NEAR_M) & (np.abs(off[:, 2]) < ABOVE_M)
            self._crowded[name] = self._crowded[name] + 1 if near.sum() > 1 else 0
            if self._crowded[name] == STAYS_LOOKS:
                self.doubles.append((time_s, name))
        filled = {
            name
            for name, placement in self._cell.score.placements().items()
            if placement.seated and placement.by == "robot"
        }
        for name in filled - self._filled:
            self._by_robot[name] += 1
            if self._by_robot[name] > 1:
                self.again.append((time_s, name))
        self._filled = filled


class KilledShift:
    """One world, and its controllers one after the other.

    Args:
        within_hours: in which the kills come; after them one controller goes on to the end, so that growth shows.
    """

    def __init__(self, seed: int, hours: float, kills: int, within_hours: float, folder: Path) -> None:
        self._seed, self._until_s, self._folder = seed, hours * HOUR_S, folder
        chance = random.Random(seed)
        self._due = sorted(chance.uniform(MINUTE_S, within_hours * HOUR_S) for _ in range(kills))
        self._chance, self._over, self._waits = chance, False, True
        self._process: subprocess.Popen[str] | None = None
        self._next_s, self._looked_s, self._began_s = 0.0, 0.0, time.monotonic()
        self.minutes: list[dict[str, Any]] = []
        self.kills: list[dict[str, Any]] = []
        self.runs: list[dict[str, Any]] = []

    def run(self) -> dict[str, Any]:
        """What came of it."""
        configuration = for_shift(CONFIGURATION, 0)
        simulation = settings_of(configuration.devices.simulation)
        self._cell = cell = SimCell(PRODUCT, BENCH, simulation, *CAN, self._seed, "random", rendered=False)
        self._moment = Moment(cell, "stands", len(PRODUCT.positions), random.Random(0))
        self._bracket = Bracket(cell)
        address, drawn = self._folder / "world.sock", Drawn(self._seed, "random")
        server = served(cell, configuration, address, drawn, self._watch)
        controllers = threading.Thread(target=self._controllers, args=(address, server.end), daemon=True)
        controllers.start()
        try:
            server.serve()
            controllers.join()
            return self._sums()
        finally:
            if self._process is not None:
                self._process.kill()
            cell.close()

    def end(self, *_: object) -> None:
        """The shift is over: a safe stop, as by Ctrl-C."""
        if not self._over and self._process is not None:
            self._over = True
            self._process.send_signal(signal.SIGINT)

    def _controllers(self, address: Path, end: Any) -> None:
        try:
            begun: Path | None = None
            while not self._over:
                log = self._folder / f"part{len(self.runs):02d}.mcap"
                command = [*controller(address, log), "--shift", "0"]
                if begun is not None:
                    command += ["--resume", str(begun)]
                self._control(command, log)
                begun = next((path for path in (log, log.with_suffix(".0001.mcap")) if path.exists()), begun)
        finally:
            end()

    def _control(self, command: list[str], log: Path) -> None:
        """One controller to its end; who ends otherwise than by a kill ends the shift."""
        began_s = time.monotonic()
        with log.with_suffix(".err").open("w") as errors:
            self._waits = True
            self._process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=errors, text=True)
            out, _ = self._process.communicate()
        status = self._process.returncode
        told = json.loads(out.splitlines()[-1]) if out.strip() else {}
        names = ("end", "reason", "condition", "right", "wrong", "asked", "overruns", "log_shortfall")
        wall_s = round(time.monotonic() - began_s, 1)
        self.runs.append({"exit": status, "wall_s": wall_s, **{name: told.get(name) for name in names}})
        self._over |= status != -signal.SIGKILL

    def _watch(self, time_s: float) -> None:
        """After each advance of the world."""
        if self._waits:
            self._waits = False
            if self.kills:
                self.kills[-1]["resumed_after_s"] = round(time.monotonic() - self._killed_s, 1)
                self._note("kills", self.kills[-1])
        if time_s >= self._looked_s:
            self._looked_s = time_s + LOOKS_S
            self._bracket.look(time_s)
        if time_s >= self._next_s:
            self._next_s = time_s + MINUTE_S
            self._minute(time_s)
        if time_s >= self._until_s:
            self.end()
        elif self._due and time_s >= self._due[0]:
            self._kill(time_s)

    def _minute(self, time_s: float) -> None:
        row = {
            "time_s": round(time_s, 2),
            "wall_s": round(time.monotonic() - self._began_s, 1),
            "controller": len(self.runs),
            "brackets": len(self._cell.devices.finished()),
            "right": sum(one["correct"] is True for one in self._cell.devices.finished()),
            "load": round(os.getloadavg()[0], 1),
        }
        if self._process is not None:
            row |= {f"controller_{name}": value for name, value in held(self._process.pid).items()}
        row |= {f"world_{name}": value for name, value in held(os.getpid()).items()}
        self.minutes.append(row)
        self._note("minutes", row)

    def _kill(self, time_s: float) -> None:
        """Somewhere in the tick that follows."""
        assert self._process is not None
        self._due = [when_s for when_s in self._due[1:] if when_s > time_s + EARLIEST_S]
        placed = self._cell.score.report()["placements"]
        self.kills.append({"time_s": round(time_s, 2), "state": self._moment.state(), "placements": placed})
        self._killed_s, process = time.monotonic(), self._process.pid

        def kill() -> None:
            with suppress(ProcessLookupError):
                os.kill(process, signal.SIGKILL)

        threading.Timer(self._chance.uniform(0.0, WITHIN_S), kill).start()

    def _note(self, name: str, row: dict[str, Any]) -> None:
        with (self._folder / f"{name}.jsonl").open("a") as file:
            file.write(json.dumps(row) + "\n")

    def _sums(self) -> dict[str, Any]:
        judged = self._cell.devices.finished()
        lost = sum(bool(self._cell.world.data.xpos[body.body][2] < -0.01) for body in self._cell.world.bodies)
        return {
            "hours": round(self._cell.devices.clock.now_s() / HOUR_S, 3),
            "kills": len(self.kills),
            "brackets": len(judged),
            "right": sum(one["correct"] is True for one in judged),
            "not_right": [(place + 1, one) for place, one in enumerate(judged) if one["correct"] is not True],
            "holes_with_two_parts": self._bracket.doubles,
            "holes_filled_again_by_the_robot": self._bracket.again,
            "parts_on_the_floor": lost,
        }


def held(process: int) -> dict[str, float]:
    """Memory in MB, open handles and threads of a process; empty for one that is gone."""
    folder = Path("/proc") / str(process)
    try:
        lines = dict(line.split(":", 1) for line in (folder / "status").read_text().splitlines())
        return {
            "rss_mb": round(int(lines["VmRSS"].split()[0]) / 1024, 1),
            "handles": len(list((folder / "fd").iterdir())),
            "threads": int(lines["Threads"]),
        }
    except (OSError, KeyError):
        return {}


def table(folder: Path, shift: KilledShift, sums: dict[str, Any]) -> str:
    """A row for each controller: ticks from its log, memory and handles from the minutes."""
    heads = "controller", "killed while it", "ticks", "late", "median ms", "longest ms", "MB", "handles", "threads"
    lines = [f"| {' | '.join((*heads, 'resumed in s'))} |", "|---" * (len(heads) + 1) + "|"]
    for number in range(len(shift.runs)):
        told, rows = of_log(folder / f"part{number:02d}.mcap"), [r for r in shift.minutes if r["controller"] == number]
        spans = [span(rows, f"controller_{name}") for name in ("rss_mb", "handles", "threads")]
        kill = shift.kills[number] if number < len(shift.kills) else {"state": shift.runs[number]["end"]}
        ticks = [told.get(name) for name in ("ticks", "overruns", "tick_wall_p50_ms", "tick_wall_max_ms")]
        cells = [number, kill["state"], *ticks, *spans, kill.get("resumed_after_s", "")]
        lines.append("| " + " | ".join(map(str, cells)) + " |")
    world = [f"{name} {span(shift.minutes, f'world_{name}')}" for name in ("rss_mb", "handles", "threads")]
    return "\n".join([*lines, f"world: {', '.join(world)}", json.dumps(sums), ""])


def of_log(log: Path) -> dict[str, Any]:
    """What `cell log info` tells of a log, or of all its parts."""
    first = log if log.exists() else log.with_suffix(".0001.mcap")
    command = [sys.executable, "-m", "bracket_cell", "log", "info", str(first), "--json"]
    answer = subprocess.run(command, capture_output=True, text=True, check=False)
    told: dict[str, Any] = json.loads(answer.stdout) if not answer.returncode else {}
    return told


def span(rows: list[dict[str, Any]], name: str) -> str:
    """First, last and largest value."""
    values = [row[name] for row in rows if name in row]
    return f"{values[0]} to {values[-1]}, at most {max(values)}" if values else ""


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--hours", type=float, default=4.0, help="of the cell's time")
    parser.add_argument("--kills", type=int, default=10)
    parser.add_argument("--within", type=float, help="hours in which the kills come; by default all")
    parser.add_argument("--seed", type=int, default=91000)
    parser.add_argument("--folder", type=Path, required=True, help="a new one, for logs and rows")
    asked = parser.parse_args()
    asked.folder.mkdir(parents=True)
    shift = KilledShift(asked.seed, asked.hours, asked.kills, asked.within or asked.hours, asked.folder)
    for name in (signal.SIGINT, signal.SIGTERM):
        signal.signal(name, shift.end)
    sums = shift.run()
    sys.stdout.write(table(asked.folder, shift, sums))
    bad = sums["holes_with_two_parts"] or sums["holes_filled_again_by_the_robot"] or sums["not_right"]
    sys.exit(bool(bad))


if __name__ == "__main__":
    main()
