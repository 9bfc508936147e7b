"""The controller dies at a random moment of an assembly, the simulated world goes on, and another one takes over.

python -m tests.benchmarks.restart --times 20
Nothing is sent to arm and gripper after the death, as after SIGKILL; the world lives in this process.
"""

from __future__ import annotations

import argparse
import json
import random
from collections import Counter
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any, NoReturn

from cell.configuration import load_faults
from cell.observer import Level, Outcome, TickRecord
from cell.run import drive
from cell.run_options import Files
from cell.running.controller import Controller
from cell.running.node_library import node_registry
from cell.running.operator import OperatorChannel
from cell.running.services import load_planners
from sim.cell import SimCell
from tests.integration.cell_rig import ASSEMBLE, CONFIGURATION, PRODUCT, Diary, motion_planner, with_person
from trees.files.loader import load_tree


class KilledError(BaseException):
    """The controller is gone."""


class Killer(Diary):
    """Lets the controller die after a tick.

    Args:
        state: only when the robot says that it does something that begins so; empty for whatever it does.
    """

    def __init__(self, after_s: float, state: str = "") -> None:
        super().__init__()
        self.after_s, self._state = after_s, state
        self.doing, self.died_s = "", 0.0
        self.holding = False

    def tick(self, record: TickRecord) -> None:
        super().tick(record)
        self.holding = record.observation.gripper.holding
        if record.command.display is not None:
            self.doing = record.command.display.message
        self.died_s = record.observation.time_s
        if self.died_s >= self.after_s and self.doing.startswith(self._state):
            raise KilledError

    def message(self, time_s: float, level: Level, text: str) -> None:
        """Nothing to do."""


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--times", type=int, default=20)
    parser.add_argument("--first-seed", type=int, default=0)
    parser.add_argument("--state", default="", help="die when the robot says that, for example carrying")
    options = parser.parse_args()
    seeds = range(options.first_seed, options.first_seed + options.times)
    told = Counter[str]()
    for seed in seeds:
        row = kill_once(seed, options.state)
        told[row["verdict"]] += 1
        print(json.dumps(row), flush=True)
    print(dict(told))


def kill_once(seed: int, state: str = "") -> dict[str, Any]:
    """One assembly with a death in it; how it ended."""
    chance = random.Random(seed)
    goal = sorted(PRODUCT.goals)[seed % len(PRODUCT.goals)]
    with with_person(goal, seed) as cell:
        killer = Killer(chance.uniform(2.0, 3.0 if state else 45.0), state)
        try:
            with no_stop():
                outcome = assemble(cell, killer)
            return {"seed": seed, "verdict": "over before", "end": outcome.end}
        except KilledError:
            clock = cell.devices.clock
            clock.sleep_until(clock.now_s() + chance.uniform(0.3, 4.0))
        diary = Diary()
        outcome = assemble(cell, diary)
        report = cell.report()
        lost = parts_lost(cell)
        right = outcome.end == "finished" and report["correct"] is True
        asked = [str(fields.get("text")) for _, topic, fields in diary.notes if topic == "help"]
        verdict = "right" if right and not lost else f"{outcome.end}, {'part lost' if lost else 'not right'}"
        return {
            "seed": seed,
            "verdict": verdict,
            "killed_s": round(killer.died_s, 2),
            "doing": killer.doing,
            "holding": killer.holding,
            "reason": outcome.reason,
            "asked": asked,
            "robot": report["robot_placements"],
            "sim_time_s": round(outcome.sim_time_s, 1),
            "failed": [reason for reason in diary.reasons() if "cannot" in reason or "no way" in reason][:3],
        }


def assemble(cell: SimCell, diary: Diary) -> Outcome:
    """One controller, from its start to its end."""
    tree = load_tree(ASSEMBLE, node_registry(PRODUCT))
    planners, faults = load_planners(CONFIGURATION, PRODUCT), load_faults(CONFIGURATION)
    files = Files(CONFIGURATION, PRODUCT, tree, planners, faults)
    return drive(files, cell.devices, motion_planner(), (diary,), operator=OperatorChannel(PRODUCT.goals))


def parts_lost(cell: SimCell) -> int:
    """Parts that lie neither in bins, tray or bracket nor on the table before it: beside it, or on the floor."""
    return sum(bool(cell.world.data.xpos[body.body][2] < -0.01) for body in cell.world.bodies)


@contextmanager
def no_stop() -> Iterator[None]:
    """A controller that dies sends nothing more: no safe stop."""
    stop = Controller._stop

    def die(*_: object) -> NoReturn:
        raise KilledError

    Controller._stop = die  # type: ignore[assignment, method-assign]
    try:
        yield
    finally:
        Controller._stop = stop  # type: ignore[method-assign]


if __name__ == "__main__":
    main()
