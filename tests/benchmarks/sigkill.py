"""`cell run` killed at random moments: how many ticks its log lacks.

python -m tests.benchmarks.sigkill --times 50
"""

from __future__ import annotations

import argparse
import os
import random
import signal
import subprocess
import sys
import tempfile
import time
from pathlib import Path

from rich.console import Console

from bracket_cell.commands.main import main as cell_main
from bracket_cell.log.read.reader import read_log
from bracket_cell.recording.recorder import McapRecorder
from bracket_cell.watching.observer import TickRecord
from bracket_ground.errors import LogError


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--times", type=int, default=50)
    parser.add_argument("--longest-s", type=float, default=5.0, help="killed at most so long after the first tick")
    options = parser.parse_args()
    chance, console = random.Random(0), Console(soft_wrap=True)
    lost = [kill_once(seed, chance.uniform(0.0, options.longest_s), console) for seed in range(options.times)]
    console.print(
        f"killed {len(lost)} times: at most {max(lost)} ticks lost, {sum(count > 0 for count in lost)} times any"
    )
    sys.exit(max(lost) > 1)


def kill_once(seed: int, after_s: float, console: Console) -> int:
    """Ticks that were done when the process died and are not in its log."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "log.mcap"
        reading, writing = os.pipe()
        child = (
            "import sys; from tests.benchmarks.sigkill import run_telling; run_telling(int(sys.argv[1]), sys.argv[2:])"
        )
        arguments = [sys.executable, "-c", child, str(writing), "run", "--seed", str(seed), "--log", str(path)]
        process = subprocess.Popen(arguments, pass_fds=[writing], stderr=subprocess.DEVNULL, stdout=subprocess.DEVNULL)
        os.close(writing)
        told = os.read(reading, 64)  # the first tick is done
        time.sleep(after_s)
        process.send_signal(signal.SIGKILL)
        process.wait()
        while piece := os.read(reading, 65536):
            told += piece
        os.close(reading)
        done = int(told.split()[-1]) + 1 if told else 0
        try:
            kept = len(read_log(path).ticks)
        except LogError as error:
            console.print(f"seed {seed}: {error}")
            kept = 0
        console.print(
            f"seed {seed}: killed after {after_s:.2f} s, {done} ticks done, {kept} in the log", highlight=False
        )
        return max(0, done - kept)


def run_telling(descriptor: int, arguments: list[str]) -> None:
    """The child: a command of `cell` that writes the number of every recorded tick to a pipe before the tick begins.

    The number is told before the recorder is called, so a tick whose recording was cut short counts as done.
    """
    recorded = McapRecorder.tick

    def tick(self: McapRecorder, record: TickRecord) -> None:
        os.write(descriptor, f"{record.observation.tick}\n".encode())
        recorded(self, record)

    McapRecorder.tick = tick  # type: ignore[method-assign]
    sys.exit(cell_main(arguments))


if __name__ == "__main__":
    main()
