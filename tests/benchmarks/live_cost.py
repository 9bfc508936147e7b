"""What `--open live` costs a tick: off, without a viewer, and with one that takes all.

Counted is the processor time of the loop's own thread in recorder and server, as wall times depend on what else runs;
the server's threads work beside it.

python -m tests.benchmarks.live_cost --seed 3 --goal g2
"""

from __future__ import annotations

import argparse
import socket
import subprocess
import sys
import tempfile
import time
from collections import defaultdict
from collections.abc import Callable
from pathlib import Path
from statistics import median
from typing import Any

from rich.console import Console
from websockets.exceptions import ConnectionClosed

from bracket_cell.log.read.reader import read_log
from bracket_cell.recording.recorder import McapRecorder
from bracket_cell.runs.options import RunOptions
from bracket_cell.runs.run import run
from bracket_cell.viewing.live_server import LiveServer
from tests.cell.viewing.viewer import live_viewer

MODES = ("off", "no viewer", "one viewer")
SUBSCRIBED = (
    "/camera/overhead",
    "/camera/overhead/hand",
    "/tick",
    "/observation",
    "/joint_states",
    "/tf/robot",
    "/can",
)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seed", type=int, default=3)
    parser.add_argument("--goal", default="g2")
    parser.add_argument("--viewer", type=int, help="Be the viewer on this port, and say how much came.")
    options = parser.parse_args()
    if options.viewer is not None:
        view(options.viewer)
        return
    spent_us: list[float] = []
    for kind, name in ((McapRecorder, "tick"), (McapRecorder, "frame"), (LiveServer, "tick")):
        setattr(kind, name, timed(getattr(kind, name), spent_us))
    console = Console(soft_wrap=True, highlight=False)
    for mode in MODES:
        spent_us.clear()
        walls_us, told = measured(options.seed, options.goal, mode)
        each = sum(spent_us) / len(walls_us)
        console.print(
            f"{mode}: {each:.0f} us of processor time a tick in recorder and server; "
            f"tick {median(walls_us):.0f} us by the wall{told}"
        )


def measured(seed: int, goal: str, mode: str) -> tuple[list[float], str]:
    """Wall times of the ticks of one run, and what the viewer says."""
    port = free_port()
    with tempfile.TemporaryDirectory() as folder:
        log = Path(folder) / "log.mcap"
        options = RunOptions(goal=goal, seed=seed, log=log, live_port=None if mode == "off" else port)
        viewer = None
        if mode == "one viewer":
            command = [sys.executable, "-m", "tests.benchmarks.live_cost", "--viewer", str(port)]
            viewer = subprocess.Popen(command, stdout=subprocess.PIPE, text=True)
        run(options, Console(quiet=True))
        told = f"; viewer: {viewer.communicate(timeout=30)[0].strip()}" if viewer is not None else ""
        return [tick.wall_s * 1e6 for tick in read_log(log).ticks], told


def view(port: int) -> None:
    """Take all that comes until the run ends."""
    counts: dict[str, int] = defaultdict(int)
    size = 0
    while True:
        try:
            with live_viewer(port) as viewer:
                viewer.learn(*SUBSCRIBED)
                viewer.subscribe(*viewer.channels)
                while True:
                    if (message := viewer.message(5.0)) is None:
                        break
                    counts[message[0]] += 1
                    size += len(message[2])
        except ConnectionRefusedError:
            time.sleep(0.05)
            continue
        except ConnectionClosed:  # the run is over
            sys.stdout.write(f"{sum(counts.values())} messages, {size / 1e6:.1f} MB\n")
            return


def free_port() -> int:
    with socket.socket() as one:
        one.bind(("127.0.0.1", 0))
        port: int = one.getsockname()[1]
        return port


def timed(method: Callable[..., None], spent_us: list[float]) -> Callable[..., None]:
    """The method with a stop watch."""

    def measured(*arguments: Any, **named: Any) -> None:
        began_s = time.thread_time()
        method(*arguments, **named)
        spent_us.append((time.thread_time() - began_s) * 1e6)

    return measured


if __name__ == "__main__":
    main()
