"""An order that contradicts the person comes late: the right bracket, or one question; nothing is placed twice.

python -m tests.benchmarks.late_orders --moments 60
Nothing is rendered. A careful person builds one goal; at one of K moments, evenly over the time that the bracket takes
without it, somebody orders another one. Told is for each moment how it ended, and the moments by their end: `right`
without a question about the goal, `asked` once and right, `asked again` and right, `wrong`, and beside these how many
had a part that was let go twice in the same hole.
"""

from __future__ import annotations

import argparse
import json
import tempfile
from collections import Counter
from collections.abc import Sequence
from contextlib import closing
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from mcap.reader import make_reader
from rich.console import Console

from bracket_cell.configuration import DEFAULT_CONFIGURATION, DEFAULT_TREE, load_configuration, load_product
from bracket_cell.recording.parts import parts_of
from bracket_cell.runs.options import RunOptions
from bracket_cell.runs.run import run
from bracket_ground.interfaces.command import Display
from bracket_ground.interfaces.devices import Devices
from bracket_ground.interfaces.operator import OperatorOrder
from bracket_sim.process.no_render_host import without_pixels
from bracket_sim.process.opening import open_simulation

FIRST_SEED = 911_000
LONGEST_S = 300.0
LET_GO = " was let go at "


class Bench:
    """Panel and voice of a cell, where somebody orders a goal at a moment.

    Attributes:
        asked: numbers of the questions about the goal.
    """

    def __init__(self, devices: Devices, goal: str, at_s: float) -> None:
        self._devices, self._goal, self._at_s = devices, goal, at_s
        self.asked: set[int] = set()
        self.devices = replace(devices, panel=self, pressed=self._pressed)

    def show(self, display: Display) -> None:
        """For the person."""
        self.asked |= {question.number for question in display.questions if question.kind == "goal"}
        self._devices.panel.show(display)

    def alarm(self, text: str) -> None:
        """For the person."""
        self._devices.panel.alarm(text)

    def _pressed(self) -> Sequence[OperatorOrder]:
        pressed = self._devices.pressed()
        if self._devices.clock.now_s() < self._at_s:
            return pressed
        self._at_s = float("inf")
        return (*pressed, OperatorOrder("goal", self._goal))


@dataclass(frozen=True)
class Ended:
    """How one bracket ended."""

    at_s: float
    built: str
    ordered: str
    right: bool
    asked: int
    twice: tuple[str, ...]
    took_s: float

    @property
    def word(self) -> str:
        """In short."""
        if not self.right:
            return "wrong"
        return ("right", "asked")[self.asked] if self.asked < 2 else "asked again"


def bracket(seed: int, tree: Path, built: str, ordered: str, at_s: float) -> Ended:
    """One bracket, with an order at a moment."""
    configuration = load_configuration()
    product = load_product(configuration, DEFAULT_CONFIGURATION)
    with (
        tempfile.TemporaryDirectory() as name,
        closing(open_simulation(configuration, product, seed, built, rendered=False)) as cell,
    ):
        bench = Bench(without_pixels(cell, configuration, product), ordered, at_s)
        log = Path(name) / "log.mcap"
        options = RunOptions(
            tree=tree,
            log=log,
            max_duration_s=LONGEST_S,
            pixels=False,
            images=False,
            devices=bench.devices,
            answered=True,
        )
        result = run(options, Console(quiet=True))
        let_go = _let_go(log)
    right = result.end == "finished" and bool(result.summary.get("correct"))
    twice = tuple(where for where, count in let_go.items() if count > 1)
    return Ended(round(at_s, 2), built, ordered, right, len(bench.asked), twice, round(result.outcome.sim_time_s, 1))


def _let_go(log: Path) -> Counter[str]:
    """How often the robot let a part of a type go in a hole."""
    found: Counter[str] = Counter()
    for part in parts_of(log):
        with part.open("rb") as stream:
            for _, _, message in make_reader(stream).iter_messages(["/note/skill"]):
                reason = str(json.loads(message.data).get("reason", ""))
                found[reason] += LET_GO in reason
    return found


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--moments", type=int, default=60)
    parser.add_argument("--seed", type=int, default=FIRST_SEED)
    parser.add_argument("--tree", type=Path, default=DEFAULT_TREE)
    asked = parser.parse_args()
    goals = sorted(load_product(load_configuration(), DEFAULT_CONFIGURATION).goals)
    whole = {goal: bracket(asked.seed, asked.tree, goal, goal, float("inf")).took_s for goal in goals}
    rng, ended = np.random.default_rng(asked.seed), list[Ended]()
    for number in range(asked.moments):
        built, ordered = (str(goal) for goal in rng.choice(goals, 2, replace=False))
        at_s = whole[built] * (number + 0.5) / asked.moments
        ended.append(bracket(asked.seed, asked.tree, built, ordered, at_s))
        print(ended[-1].word, ended[-1], flush=True)
    words = Counter(one.word for one in ended)
    print({"moments": len(ended), **words, "placed twice": sum(bool(one.twice) for one in ended)})


if __name__ == "__main__":
    main()
