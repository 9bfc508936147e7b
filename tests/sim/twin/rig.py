"""A twin of an arm alone in a process of its own, as `ur-rtde` and a server in one process block one another."""

from __future__ import annotations

import os
import subprocess
import sys
import threading
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from bracket_cell.configuration import load_configuration, load_product
from bracket_ground.interfaces.robot import Calibration
from bracket_sim.cell import SimCell
from bracket_sim.scene.settings import SimSettings
from bracket_sim.scene.world import World
from bracket_sim.twin import controller
from bracket_sim.twin.arm import TwinArm
from bracket_sim.twin.cell import TwinCell
from bracket_sim.twin.control import ControlDoor, ask
from bracket_sim.twin.controller import UrWires
from bracket_sim.twin.ur_model import Model
from tests.processes import started

UNLOCK_S = 0.5  # of a protective stop, in place of the 5 s that a controller refuses for


def own_host(number: int) -> str:
    """An address of this machine that no other process of tests has."""
    return f"127.{20 + os.getpid() % 200}.{os.getpid() // 200 % 250}.{number}"


def slower_now() -> float:
    """How many times slower a twin must go to keep its time beside what else this machine does."""
    waiting = os.getloadavg()[0] / (os.cpu_count() or 1)
    return float(min(max(round(waiting), 1), 8))


class Twin:
    """A running twin.

    Attributes:
        host: where its wires are.
        process: it runs there.
        slower: seconds of the wall for each of its own.
    """

    def __init__(self, host: str, door: Path, process: subprocess.Popen[str], slower: float) -> None:
        self.host, self._door, self.process, self.slower = host, door, process, slower

    def fault(self, name: str) -> None:
        """Make something go wrong."""
        ask(self._door, {"fault": name})

    def faults(self) -> Mapping[str, str]:
        """All that can go wrong, in words."""
        told: dict[str, str] = ask(self._door, {"faults": True})
        return told


@contextmanager
def running_twin(folder: Path, number: int, robot: str = "ur10", slower: float | None = None) -> Iterator[Twin]:
    """A twin at 127.0.0.NUMBER: each test has its own."""
    host, door = f"127.0.0.{number}", folder / f"twin{number}.sock"
    slower = slower_now() if slower is None else slower
    words = [sys.executable, "-m", "tests.sim.twin.rig", host, str(door), robot, str(slower)]
    with started(words) as process:
        assert process.stdout is not None
        assert process.stdout.readline() == "ready\n"
        yield Twin(host, door, process, slower)


def light_cell(settings: Mapping[str, Mapping[str, Any]], robot: str, slower: float) -> TwinCell:
    """A cell without person, parts and images."""
    configuration = load_configuration()
    product, arms = load_product(configuration), list[TwinArm]()

    def made(world: World) -> TwinArm:
        arms.append(TwinArm(world))
        return arms[0]

    period_s = 0.002 if robot == "ur10e" else 0.008
    physics = SimSettings().physics.model_copy(update={"control_period_s": period_s})
    simulation = SimSettings(physics=physics)
    bench = configuration.bench.drawn
    sim = SimCell(
        product, bench, simulation, "virtual", "twin", 0, "g0", worker=False, clutter=(), rendered=False, arm=made
    )
    return TwinCell(sim, arms[0], settings, robot, period_s, slower)


@contextmanager
def ur_wires(host: str) -> Iterator[UrWires]:
    """The wires of a UR10 alone, served at a host."""
    cell = light_cell({"arm": {"kind": "ur", "host": host}}, "ur10", 1.0)
    (served,) = cell.serve()
    assert isinstance(served, UrWires)
    yield served
    cell.close()


def corrected(model: Model, seed: int) -> Model:
    """Another arm of the same make."""
    spread = {"theta_rad": 1e-3, "a_m": 4e-4, "d_m": 4e-4, "alpha_rad": 5e-4}
    rng, makers = np.random.default_rng(seed), model.rows.model_dump()
    rows = {name: tuple((np.array(makers[name]) + rng.normal(0, by, 6)).tolist()) for name, by in spread.items()}
    return replace(model, rows=Calibration(**rows))


def main(host: str, door: str, robot: str, slower: str) -> None:
    """Serve until the parent is gone."""
    controller.UNLOCK_S = UNLOCK_S
    cell = light_cell({"arm": {"kind": "ur", "host": host}}, robot, float(slower))
    cell.serve()
    ControlDoor(cell, Path(door))
    sys.stdout.write("ready\n")
    sys.stdout.flush()
    threading.Event().wait()


if __name__ == "__main__":
    main(*sys.argv[1:])
