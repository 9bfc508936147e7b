"""Hand-overs in the simulator's physics, without pixels: what becomes of each part.

Run it: python -m tests.integration.test_hand_over --offers 40 --first-seed 100 --kept runs/hand_overs.jsonl
Persons who pull early, late and never take turns, a seed each, until so many parts were held out. A seed that is in the
kept file is not run again.
"""

from __future__ import annotations

import argparse
import itertools
from collections import Counter
from pathlib import Path

import numpy as np
import pytest

from bracket_cell.configuration import DEFAULT_CONFIGURATION
from bracket_ground.files.row_store import RowStore
from bracket_lab.evaluations.assembly import assembly
from bracket_sim.cell import SimCell
from tests import ROOT
from tests.integration.situations import uninterrupted

JOBS = ROOT / "trees" / "jobs"
PERSONS = ("hand_over_early", "hand_over_late", "hand_over_never")
LIES_RAD, TABLE_M = 0.6, 0.10


def fallen(cell: SimCell) -> list[str]:
    """Parts of the robot that lie on the table, outside of the tray."""
    tray, world = cell.world.bench.tray, cell.world
    found = []
    for body in world.bodies:
        pose = world.part_pose(body)
        x, y, z = pose.position_m
        off = np.abs(np.array([x, y]) - np.array(tray.centre_m)[:2]) - np.array(tray.size_m) / 2
        lies = float(np.arccos(min(1.0, float(pose.rotation[2, 2])))) > LIES_RAD
        if body.owner == "robot" and lies and z < TABLE_M and off.max() > 0:
            found.append(body.name)
    return found


class Dropped:
    """Sees in every period whether a part lies on the table, also if the person picks it up later."""

    def __init__(self, cell: SimCell) -> None:
        assert cell.worker is not None
        self.names: set[str] = set()
        self._cell, self._update = cell, cell.worker.update
        cell.worker.update = self._look  # type: ignore[method-assign]

    def _look(self, time_s: float, dt_s: float) -> None:
        self._update(time_s, dt_s)
        self.names |= set(fallen(self._cell))


def handed(person: str, seed: int, tree: Path = JOBS / "hand_over.xml") -> Counter[str]:
    """How many parts were offered, taken and dropped, and how often another one was pulled out."""
    counted: Counter[str] = Counter()
    with assembly(DEFAULT_CONFIGURATION, person, seed, tree=tree) as opened:
        worker = opened.cell.worker
        assert worker is not None
        dropped, last, show = Dropped(opened.cell), "", worker.show

        def shown(display: object) -> None:
            nonlocal last
            said = str(getattr(display, "message", ""))
            if said != last:
                counted["offered"] += "holding o" in said and said.endswith(" out")
                counted["taken"] += said.endswith("was handed over")
                counted["kept"] += said.startswith("nobody took")
                counted["given"] += said.endswith("is given")
                last = said
            show(display)  # type: ignore[arg-type]

        worker.show = shown  # type: ignore[method-assign]
        outcome = uninterrupted(opened.run([], None))
        counted["dropped"] = len(dropped.names)
        counted[outcome.end] += 1
    return counted


@pytest.mark.slow
@pytest.mark.parametrize(
    ("person", "seed", "end"),
    [
        ("careful", 7, "taken"),
        ("hand_over_late", 7, "taken"),
        ("hand_over_late", 990210, "taken"),
        ("hand_over_early", 990210, "taken"),
        ("hand_over_never", 7, "kept"),
    ],
)
def test_no_part_is_dropped_whoever_pulls_and_when(person: str, seed: int, end: str) -> None:
    counted = handed(person, seed)
    assert counted["dropped"] == 0
    assert counted[end] > 0
    assert counted["finished"] == 1


@pytest.mark.slow
def test_parts_are_taken_from_a_hand_into_the_tray() -> None:
    counted = handed("careful", 8, JOBS / "take_over.xml")
    assert counted["dropped"] == 0
    assert counted["given"] > 0


def main() -> None:
    """Hand parts over on fresh seeds and count what became of them."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--person", nargs="+", default=PERSONS)
    parser.add_argument("--offers", type=int, default=40)
    parser.add_argument("--first-seed", type=int, default=0)
    parser.add_argument("--tree", type=Path, default=JOBS / "hand_over.xml")
    parser.add_argument("--kept", type=Path, help="a file of seeds that are not run again")
    options = parser.parse_args()
    kept = RowStore(options.kept, ("person", "seed"), {"command": "hand_overs", "tree": options.tree.name})
    total: dict[str, Counter[str]] = {person: Counter() for person in options.person}
    for seed, person in zip(itertools.count(options.first_seed), itertools.cycle(options.person), strict=False):
        if sum(counted["offered"] for counted in total.values()) >= options.offers:
            break
        if (person, seed) not in kept:
            kept.add({"person": person, "seed": seed, "counted": handed(person, seed, options.tree)})
        total[person].update(kept[person, seed]["counted"])
        print(f"{person} {seed}: {kept[person, seed]['counted']}", flush=True)
    for person, counted in total.items():
        print(f"{person}: {dict(counted)}")


if __name__ == "__main__":
    main()
