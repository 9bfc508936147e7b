"""An arm of Universal Robots behind its twin's wires: distances from its path, and how soon a loss is known.

    python -m tests.benchmarks.arm_wires [--robot ur10] [--slower 1]

Times are the cell's. Bars: 5 mrad off the path at 3 rad/s, 0.1 mrad after a stop, 0.1 s until a loss is known, 0.5 s
until the arm rests on its path where the controller's process was killed.
"""

from __future__ import annotations

import argparse
import json
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np

from bracket_cell.configuration import load_configuration, load_product
from bracket_cell.skills.drivers.samples import SampleReceiver
from bracket_cell.skills.drivers.settings import UrSettings
from bracket_cell.skills.drivers.ur import UrArm, UrSamples
from bracket_cell.skills.motion.settings import MotionSettings
from bracket_cell.skills.motion.trajectory import joint_move
from bracket_ground.errors import DeviceFault
from bracket_ground.interfaces.clock import WallClock
from bracket_ground.interfaces.command import JointTrajectory
from bracket_ground.interfaces.observation import ArmState
from bracket_ground.interfaces.pose import Array
from tests.processes import started
from tests.sim.twin.rig import Twin, running_twin

WAY_RAD = np.array([0.8, -0.3, 0.4, 1.5, -0.4, 2.5])  # its fastest joint comes to 3.14 rad/s
LOOK_S, LONGEST_S = 0.002, 10.0
KILLED_AT_S = 0.7  # on the path


class Bench:
    """An open arm and its clock."""

    def __init__(self, host: str, slower: float) -> None:
        configuration = load_configuration()
        self.clock = WallClock(slower)
        product, settings = load_product(configuration), UrSettings(host=host)
        self.arm = UrArm(settings, self.clock, product, configuration.robot)

    def begin(self) -> JointTrajectory:
        """Follow the way there or back."""
        here = np.array(self.arm.state().positions_rad)
        sign = 1.0 if here[5] < 0 else -1.0
        return self.arm.follow(joint_move(here, here + sign * WAY_RAD, MotionSettings()))

    def until(self, done: Callable[[ArmState], bool], share: float = 1.0) -> list[ArmState]:
        """Look often until a state is as wanted."""
        states, until_s = [self.arm.state()], self.clock.now_s() + LONGEST_S
        while not done(states[-1]) and self.clock.now_s() < until_s:
            self.arm.pace(share)
            self.clock.sleep_until(self.clock.now_s() + LOOK_S)
            states.append(self.arm.state())
        return states


def off_path(bench: Bench) -> dict[str, float]:
    """Distance from where `path_s` has the arm, along a whole motion."""
    path = bench.begin()
    states = [arm_state for arm_state in bench.until(lambda state: not state.moving) if arm_state.path_s is not None]
    off = [np.abs(path.at(arm_state.path_s or 0.0) - arm_state.positions_rad).max() * 1e3 for arm_state in states]
    fastest = max(np.abs(arm_state.velocities_rad_s).max() for arm_state in states)
    return {"fastest_rad_s": fastest, "off_path_mrad": max(off), "median_mrad": float(np.median(off))}


def stopped(bench: Bench) -> dict[str, float]:
    """Distance of a stopped arm from its path, and how long it took."""
    path = bench.begin()
    bench.until(lambda state: state.path_s is not None and state.path_s > path.duration_s / 2)
    bench.arm.stop()
    began_s = bench.clock.now_s()
    bench.until(lambda state: not state.moving)
    took_s = bench.clock.now_s() - began_s
    bench.clock.sleep_until(bench.clock.now_s() + 0.5)
    return {"stop_off_path_mrad": nearest_mrad(path, np.array(bench.arm.state().positions_rad)), "stop_s": took_s}


def noticed(bench: Bench, spoil: Callable[[], None]) -> float:
    """Seconds from a loss until the state is 0.1 s old, its mode is not normal, or reading it raises."""
    bench.until(lambda state: state.mode == "normal" and not state.moving)
    bench.begin()
    bench.until(lambda state: state.path_s is not None and state.path_s > 0.3)
    spoil()
    began_s = bench.clock.now_s()
    while True:
        try:
            state = bench.arm.state()
        except DeviceFault:
            break
        if state.mode != "normal" or bench.clock.now_s() - state.time_s > 0.06 or state.path_s is None:
            break
        bench.arm.pace(1.0)
        bench.clock.sleep_until(bench.clock.now_s() + LOOK_S)
    return bench.clock.now_s() - began_s


def killed(host: str, slower: float) -> dict[str, float]:
    """A process with the arm is killed in motion: when and where the arm rests, and how soon another has it."""
    clock = WallClock(slower)
    receiver = SampleReceiver(lambda: UrSamples(host, 2.0 * slower, np.eye(3)), clock, host, slower)
    with started(
        [sys.executable, "-m", "tests.benchmarks.arm_wires", "--follow", host, "--slower", str(slower)]
    ) as one:
        assert one.stdout is not None
        here, goal = (np.array(row) for row in json.loads(one.stdout.readline()))
        path = joint_move(here, goal, MotionSettings())
        one.stdout.readline()
        one.kill()
        began_s = last_s = clock.now_s()
        while clock.now_s() < began_s + 2.0:
            if np.abs(receiver.newest.velocities_rad_s).max() > 0.02:
                last_s = clock.now_s()
            clock.sleep_until(clock.now_s() + LOOK_S)
    off = nearest_mrad(path, receiver.newest.positions_rad)
    receiver.close()
    opened_s = time.monotonic()
    Bench(host, slower).arm.close()
    return {
        "killed_rest_s": last_s - began_s,
        "killed_off_path_mrad": off,
        "opened_again_s": time.monotonic() - opened_s,
    }


def follow(host: str, slower: float) -> None:
    """What is killed: begins a motion, and says when it is in the middle."""
    bench = Bench(host, slower)
    here = np.array(bench.arm.state().positions_rad)
    path = bench.begin()
    sys.stdout.write(json.dumps([here.tolist(), path.at(path.duration_s).tolist()]) + "\n")
    sys.stdout.flush()
    bench.until(lambda state: state.path_s is not None and state.path_s > KILLED_AT_S)
    sys.stdout.write("now\n")
    sys.stdout.flush()
    bench.until(lambda _: False)


def nearest_mrad(path: JointTrajectory, at_rad: Array) -> float:
    """Distance from the nearest place of a path."""
    first_s, last_s = 0.0, path.duration_s
    for _ in range(4):
        times_s = np.linspace(first_s, last_s, 400)
        off = np.abs(path.along(times_s) - at_rad).max(axis=1)
        best = int(off.argmin())
        first_s, last_s = float(times_s[max(best - 1, 0)]), float(times_s[min(best + 1, 399)])
    return float(off.min() * 1e3)


def figures(twin: Twin, slower: float) -> dict[str, float]:
    """All of them."""
    bench = Bench(twin.host, slower)
    told = off_path(bench) | stopped(bench)
    stream: Callable[[], int] = lambda: bench.arm._stream.child.process_id  # type: ignore[union-attr]  # noqa: E731
    told["stream_killed_s"] = noticed(bench, lambda: send(stream(), signal.SIGKILL))
    bring_back(bench)
    told["stream_frozen_s"] = noticed(bench, lambda: send(stream(), signal.SIGSTOP))
    bring_back(bench)
    told["controller_restarted_s"] = noticed(bench, lambda: twin.fault("controller_restarted"))
    bring_back(bench)
    bench.arm.close()
    told |= killed(twin.host, slower)
    bench = Bench(twin.host, slower)
    told["controller_frozen_s"] = noticed(bench, lambda: twin.process.send_signal(signal.SIGSTOP))
    twin.process.send_signal(signal.SIGCONT)
    bench.arm.close()
    twin.fault("mended")
    bench = Bench(twin.host, slower)
    told["controller_dead_s"] = noticed(bench, twin.process.kill)
    bench.arm.close()
    return told


def bring_back(bench: Bench) -> None:
    """A person acknowledges."""
    bench.arm.acknowledge()
    bench.until(lambda state: state.mode == "normal")


def send(process: int, number: int) -> None:
    """Send a signal."""
    subprocess.run(["kill", f"-{number}", str(process)], check=True)


def main() -> None:
    """Measure, and print a line of JSON."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--robot", default="ur10")
    parser.add_argument("--slower", type=float, default=1.0)
    parser.add_argument("--follow", metavar="HOST", help="what is killed")
    asked = parser.parse_args()
    if asked.follow:
        follow(asked.follow, asked.slower)
        return
    with (
        tempfile.TemporaryDirectory() as folder,
        running_twin(Path(folder), 81, asked.robot, asked.slower) as twin,
    ):
        told = figures(twin, asked.slower)
    sys.stdout.write(json.dumps({name: round(value, 4) for name, value in told.items()}) + "\n")


if __name__ == "__main__":
    main()
