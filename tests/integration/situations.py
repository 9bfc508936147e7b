"""Situations of shops and papers, each a person's file, a tree or a cell: what became of the bracket, and contacts.

Run it: python -m tests.integration.situations --seeds 5 --first-seed 100 --kept runs/situations.jsonl
Some: python -m tests.integration.situations undoes hands_over --first-seed 100
With `--kept`, a run that is in the file is not made again. Nothing is rendered but where a look is the situation.
A run ends `right`; `wrong` where a part is where it should not be; or it was not finished in time: `held` by the
supervisor, `asked` where a question stands, else `open`. A job that is no bracket is right where it finished.
Beside these: contacts, those with an arm that moved, and the greatest force.
"""

from __future__ import annotations

import argparse
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import yaml

from bracket_cell.configuration import (
    DEFAULT_CONFIGURATION,
    DEFAULT_TREE,
    for_shift,
    load_configuration,
    load_product,
    simulated,
)
from bracket_cell.watching.observer import Observer, Outcome, TickRecord
from bracket_cell.wiring.detectors import with_detectors_for
from bracket_ground.files.row_store import Row, RowStore
from bracket_ground.interfaces.perception import Edge
from bracket_ground.interfaces.product import Product
from bracket_lab.evaluations.assembly import opened
from bracket_lab.evaluations.danger import DRIVEN_M_S
from bracket_sim.faults.injection import Injection
from tests import ROOT
from tests.benchmarks.late_orders import Bench

JOBS, EXAMPLES = ROOT / "trees" / "jobs", ROOT / "config" / "examples"
LONGEST_S = 900.0  # simulated: five minutes away, and the bracket
ENDS = ("right", "wrong", "held", "asked", "open")


@dataclass(frozen=True)
class Situation:
    """How a situation is said.

    Attributes:
        person: a shipped person, or a file.
        inject: a fault, as of `cell run --inject`.
        look: of the bench, which is rendered then.
        goals: other ones than the product's, type of the part by position.
        ordered_s: when somebody orders the goal that comes after the person's.
        shift: the person works on through a shift, and answers.
        people: edges over which further people come; one stands at each of them.
        bracket: it is about a bracket, that is to be right in the end.
    """

    person: str = "careful"
    tree: Path = DEFAULT_TREE
    inject: str | None = None
    cell: Path = DEFAULT_CONFIGURATION
    look: str | None = None
    goals: tuple[tuple[str, str], ...] = ()
    ordered_s: float | None = None
    shift: bool = False
    bracket: bool = True
    people: tuple[Edge, ...] = ()


SITUATIONS: Mapping[str, Situation] = {
    "pulls_at_held_part": Situation("pulls"),
    "swaps": Situation("swaps", shift=True),
    "undoes": Situation("undoes"),
    "faster_than_robot": Situation("quick"),
    "never_screws": Situation("never_screws"),
    "walks_off": Situation("walks_off"),
    "two_brackets": Situation(cell=EXAMPLES / "brackets" / "cell.yaml"),
    "gives_to_robot": Situation(tree=JOBS / "take_over.xml", bracket=False),
    "hands_over": Situation(tree=JOBS / "hand_over.xml", bracket=False),
    "order_changes": Situation(ordered_s=15.0),
    "begun_by_others": Situation("takes_over"),
    "both_hands_act": Situation("both_hands"),
    "two_people": Situation("two_people", people=("right",)),
    "exchanges_tray": Situation("exchanges_tray"),
    "from_tray": Situation("from_tray"),
    "parts_elsewhere": Situation("elsewhere"),
    "part_falls": Situation(inject="part_falls@carry"),
    "things_on_bench": Situation(look="people:things"),
    "gloves": Situation(look="people:person"),
    "left_handed": Situation("left_handed"),
    "seated": Situation("seated"),
    "leaning_in": Situation("leaning_in"),
    "goals_one_swap_apart": Situation(
        goals=(("g0", "o1 o1 o1 o2 o2 o3"), ("g1", "o1 o1 o1 o2 o3 o2"), ("g2", "o1 o2 o1 o1 o2 o3"))
    ),
    "unlisted_goal": Situation("builds_unlisted", shift=True),
    "third_hand": Situation(tree=ROOT / "trees" / "third_hand.xml"),
    "points_at_hole": Situation("points", shift=True),
}


class Last(Observer):
    """What the run's last tick allowed, and what was asked then."""

    held = asked = False

    def tick(self, record: TickRecord) -> None:
        """Keep it."""
        self.held = record.judgement is not None and bool(record.judgement.holding_faults)
        if (display := record.command.display) is not None:
            self.asked = bool(display.questions or display.help_request)


def _product(situation: Situation, product: Product) -> Product:
    """The cell's, or the same parts with the situation's goals."""
    if not situation.goals:
        return product
    said = yaml.safe_load((ROOT / "config" / "products.yaml").read_text(encoding="utf-8"))
    return Product(**{**said, "goals": {goal: parts.split() for goal, parts in situation.goals}})


def uninterrupted(outcome: Outcome) -> Outcome:
    """How a run ended; one that a signal ended is no run, and ends the table."""
    if outcome.end == "interrupted":
        raise SystemExit("interrupted: this run is not kept")
    return outcome


def seen(situation: Situation, seed: int) -> tuple[str, list[tuple[bool, float]]]:
    """How a run ended, and its contacts: whether the arm moved, and the force [N]."""
    configuration = simulated(load_configuration(situation.cell), situation.look, situation.person)
    configuration = for_shift(configuration, 1) if situation.shift else configuration
    if situation.people:
        knows = {"people": 1 + len(situation.people), "open_edges": situation.people}
        separation = configuration.motion.separation.model_copy(update=knows)
        motion = configuration.motion.model_copy(update={"separation": separation})
        configuration = configuration.model_copy(update={"motion": motion})
    longest = configuration.controller.model_copy(update={"max_duration_s": LONGEST_S})
    configuration = configuration.model_copy(update={"controller": longest})
    product = _product(situation, load_product(configuration, situation.cell))
    configuration, _ = with_detectors_for(configuration, product)
    injection = None if situation.inject is None else Injection.parse(situation.inject)
    last = Last()
    with opened(configuration, product, situation.tree, seed, rendered=situation.look is not None) as found:
        if situation.ordered_s is not None:
            goals = sorted(product.goals)
            other = goals[(goals.index(found.cell.score.goal) + 1) % len(goals)]
            found.cell.devices = Bench(found.cell.devices, other, situation.ordered_s).devices
        outcome = uninterrupted(found.run([last], injection))
        assert found.cell.contacts is not None
        contacts = [(contact.first_m_s > DRIVEN_M_S, contact.force_n) for contact in found.cell.contacts.all()]
        told = found.cell.score.report()
    if outcome.end == "finished" and (told["correct"] or not situation.bracket):
        return "right", contacts
    if situation.bracket and told["wrong_placements"]:
        return "wrong", contacts
    return "held" if last.held else "asked" if last.asked else "open", contacts


def row(name: str, seeds: Sequence[int], kept: RowStore) -> str:
    """A line of the table; what is not kept is run."""
    for seed in seeds:
        if (name, seed) not in kept:
            end, touched = seen(SITUATIONS[name], seed)
            kept.add({"situation": name, "seed": seed, "end": end, "contacts": touched})
    return told(name, [kept[name, seed] for seed in seeds])


def told(name: str, runs: Sequence[Row]) -> str:
    """A situation's line of the table."""
    ends = Counter(str(run["end"]) for run in runs)
    contacts = [(bool(moved), float(force_n)) for run in runs for moved, force_n in run["contacts"]]
    moving = [force_n for moved, force_n in contacts if moved]
    most = max((force_n for _, force_n in contacts), default=0.0)
    counted = " | ".join(str(ends[end]) for end in ENDS)
    return f"| {name} | {counted} | {len(contacts)} | {len(moving)} | {max(moving, default=0.0):.0f} | {most:.0f} |"


def table(names: Sequence[str], seeds: Sequence[int], kept: RowStore) -> Iterator[str]:
    """The lines, each as soon as it is known."""
    yield f"| situation | {' | '.join(ENDS)} | contacts | arm moved | most then [N] | most [N] |"
    yield "|---" * (len(ENDS) + 5) + "|"
    yield from (row(name, seeds, kept) for name in names)


def main() -> None:
    """Run situations and print their table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("situation", nargs="*", help=f"of {', '.join(SITUATIONS)}; all by default")
    parser.add_argument("--seeds", type=int, default=1)
    parser.add_argument("--first-seed", type=int, default=0)
    parser.add_argument("--kept", type=Path, help="a file of runs that are not made again")
    options = parser.parse_args()
    if unknown := [name for name in options.situation if name not in SITUATIONS]:
        parser.error(f"no situation {', '.join(unknown)}; legal: {', '.join(SITUATIONS)}")
    seeds = range(options.first_seed, options.first_seed + options.seeds)
    kept = RowStore(options.kept, ("situation", "seed"), {"command": "situations"})
    for line in table(options.situation or list(SITUATIONS), seeds, kept):
        print(line, flush=True)


if __name__ == "__main__":
    main()
