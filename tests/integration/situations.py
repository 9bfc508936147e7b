"""Situations of shops and papers, each a person's file, a tree or a cell: what became of the bracket, and contacts.

Run it: python -m tests.integration.situations --seeds 5 --first-seed 100
Some: python -m tests.integration.situations undoes hands_over --first-seed 100
Nothing is rendered. A row counts runs by their end: `right`, `wrong` where a part is where it should not be, or `open`
where holes are left or the run was not finished, as in a job that hands parts over;
contacts, those with an arm that moved, and the greatest force of either. `cannot` names what no file can say.
"""

from __future__ import annotations

import argparse
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from bracket_cell.configuration import (
    DEFAULT_CONFIGURATION,
    DEFAULT_TREE,
    load_configuration,
    load_product,
    simulated,
)
from bracket_cell.wiring.detectors import with_detectors_for
from bracket_lab.evaluations.assembly import opened
from bracket_lab.evaluations.danger import DRIVEN_M_S
from bracket_sim.faults.injection import Injection
from tests import ROOT

JOBS, EXAMPLES = ROOT / "trees" / "jobs", ROOT / "config" / "examples"
LONGEST_S = 900.0  # simulated: five minutes away, and the bracket


@dataclass(frozen=True)
class Situation:
    """How a situation is said.

    Attributes:
        person: a shipped person, or a file.
        inject: a fault, as of `cell run --inject`.
    """

    person: str = "careful"
    tree: Path = DEFAULT_TREE
    inject: str | None = None
    cell: Path = DEFAULT_CONFIGURATION


SITUATIONS: Mapping[str, Situation] = {
    "pulls_at_held_part": Situation("pulls"),
    "swaps": Situation("swaps"),
    "undoes": Situation("undoes"),
    "faster_than_robot": Situation("quick"),
    "never_screws": Situation("never_screws"),
    "walks_off": Situation("walks_off"),
    "two_brackets": Situation(cell=EXAMPLES / "brackets" / "cell.yaml"),
    "gives_to_robot": Situation(tree=JOBS / "take_over.xml"),
    "hands_over": Situation(tree=JOBS / "hand_over.xml"),
    "begun_by_others": Situation("takes_over"),
    "exchanges_tray": Situation("exchanges_tray"),
    "from_tray": Situation("from_tray"),
    "parts_elsewhere": Situation("elsewhere"),
    "part_falls": Situation(inject="part_falls@carry"),
    "left_handed": Situation("left_handed"),
    "seated": Situation("seated"),
    "leaning_in": Situation("leaning_in"),
    "third_hand": Situation(tree=ROOT / "trees" / "third_hand.xml"),
}
ELSEWHERE: Mapping[str, str] = {
    "order_changes": "python -m tests.benchmarks.late_orders --moments 5",
    "goals_one_swap_apart": "cell run --goal g1",
    "unlisted_goal": "python -m tests.benchmarks.unlisted",
    "things_on_bench": "cell run --look people:things",
    "gloves": "cell run --look people:person",
}
CANNOT: Mapping[str, str] = {
    "two_people": "the simulator has one person, and the tracker follows that person's hands alone",
    "both_hands_act": "one stream of actions for both hands",
    "points_at_hole": "neither the person points, nor does a detector read it as an order",
}


def seen(situation: Situation, seed: int) -> tuple[str, list[tuple[bool, float]]]:
    """How a run ended, and its contacts: whether the arm moved, and the force [N]."""
    configuration = simulated(load_configuration(situation.cell), None, situation.person)
    longest = configuration.controller.model_copy(update={"max_duration_s": LONGEST_S})
    configuration = configuration.model_copy(update={"controller": longest})
    product = load_product(configuration, situation.cell)
    configuration, _ = with_detectors_for(configuration, product)
    injection = None if situation.inject is None else Injection.parse(situation.inject)
    with opened(configuration, product, situation.tree, seed, rendered=False) as found:
        outcome = found.run([], injection)
        assert found.cell.contacts is not None
        contacts = [(one.first_m_s > DRIVEN_M_S, one.force_n) for one in found.cell.contacts.all()]
        told = found.cell.score.report()
    end = "right" if told["correct"] and outcome.end == "finished" else "wrong" if told["wrong_placements"] else "open"
    return end, contacts


def row(name: str, seeds: Sequence[int]) -> str:
    """A line of the table."""
    ends: Counter[str] = Counter()
    contacts: list[tuple[bool, float]] = []
    for seed in seeds:
        end, touched = seen(SITUATIONS[name], seed)
        ends[end] += 1
        contacts += touched
    moving = [force_n for moved, force_n in contacts if moved]
    most = max((force_n for _, force_n in contacts), default=0.0)
    counted = " | ".join(str(ends[end]) for end in ("right", "wrong", "open"))
    return f"| {name} | {counted} | {len(contacts)} | {len(moving)} | {max(moving, default=0.0):.0f} | {most:.0f} |"


def table(names: Sequence[str], seeds: Sequence[int]) -> Iterator[str]:
    """The lines, each as soon as it is known."""
    yield "| situation | right | wrong | open | contacts | arm moved | most then [N] | most [N] |"
    yield "|---|---|---|---|---|---|---|---|"
    yield from (row(name, seeds) for name in names)


def main() -> None:
    """Run situations and print their table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("situation", nargs="*", help=f"of {', '.join(SITUATIONS)}; all by default")
    parser.add_argument("--seeds", type=int, default=1)
    parser.add_argument("--first-seed", type=int, default=0)
    options = parser.parse_args()
    if unknown := [name for name in options.situation if name not in SITUATIONS]:
        parser.error(f"no situation {', '.join(unknown)}; legal: {', '.join(SITUATIONS)}")
    seeds = range(options.first_seed, options.first_seed + options.seeds)
    for line in table(options.situation or list(SITUATIONS), seeds):
        print(line, flush=True)
    if not options.situation:
        for title, further in (("by another command", ELSEWHERE), ("cannot", CANNOT)):
            print(f"\n{title}:", *(f"- {name}: {words}" for name, words in further.items()), sep="\n")


if __name__ == "__main__":
    main()
