"""Goal inference as a family grows: processor time of a plan, how often the robot may act, and how often that is wrong.

python -m tests.benchmarks.family_scale [--assemblies 200]

Assemblies of random goals in random order; each report is mistaken for another type with 4.5 %, of all actions or, in
the rows with confusions, as the planner expects. Every row says how goals were inferred.
"""

from __future__ import annotations

import argparse
import random
import statistics
import time
from collections.abc import Iterator

from bracket_cell.fleet.intervals import wilson
from bracket_cell.learned.semantic.confusions import Confusions
from bracket_cell.learned.semantic.graph import Layout
from bracket_cell.learned.semantic.model import BayesPlanner
from bracket_cell.learned.semantic.settings import DETECTION_ERROR
from bracket_ground.interfaces.planning import UNKNOWN_GOAL, AssemblyState
from bracket_ground.interfaces.product import Product
from bracket_ground.interfaces.variants import EMPTY

ACT = 0.9  # probability of a placement from which the robot acts
SIZES = ((6, 3, 3), (6, 3, 60), (10, 5, 12), (12, 5, 12), (20, 8, 30), (20, 8, 200), (50, 20, 200))
STATES = 8  # of each assembly that are planned


def family(slots: int, types: int, goals: int, *, varied: bool) -> Product:
    """Random goals; varied ones leave a tenth of their slots empty, and take either of two types in another tenth."""
    rng = random.Random(7)
    names = [f"t{i}" for i in range(types)]
    made: dict[str, list[object]] = {}
    while len(made) < goals:
        bag: list[object] = [names[i % types] for i in range(slots)]
        rng.shuffle(bag)
        for at in rng.sample(range(slots), max(1, slots // 10)) if varied else ():
            bag[at] = EMPTY
        for at in rng.sample(range(slots), max(1, slots // 10)) if varied else ():
            bag[at] = rng.sample(names, 2)
        if bag not in made.values():
            made[f"g{len(made)}"] = bag
    part = {"title": "part", "size_m": [0.045, 0.028, 0.02], "peg_diameter_m": 0.022, "peg_length_m": 0.012}
    look = {"colour_rgb": [0.5, 0.5, 0.5], "mass_kg": 0.08}
    holes = {f"p{i + 1}": [0.1 * (i // 10), 0.05 * (i % 10)] for i in range(slots)}
    bracket = {"thickness_m": 0.016, "hole_clearance_m": 0.003, "margin_m": 0.045, "holes_m": holes}
    parts = {name: {**part, **look} for name in names}
    return Product.model_validate({"name": "family", "parts": parts, "bracket": bracket, "goals": made})


def assembly(product: Product, rng: random.Random) -> Iterator[tuple[dict[str, str], dict[str, str], str]]:
    """What was reported after each placement but the last, what was placed, and the goal."""
    goal = rng.choice(list(product.goals))
    wanted = {at: rng.choice(types) for at, types in product.accepted(goal).items()}
    order = rng.sample(list(wanted), len(wanted))
    reported: dict[str, str] = {}
    for count, at in enumerate(order[:-1], 1):
        others = [part for part in product.parts if part != wanted[at]]
        reported[at] = rng.choice(others) if rng.random() < DETECTION_ERROR else wanted[at]
        yield dict(reported), {one: wanted[one] for one in order[:count]}, goal


def row(product: Product, assemblies: int, *, confused: bool) -> str:
    """One line of the table."""
    layout = Layout.of(product)
    planner = BayesPlanner(product, confusions=Confusions.of(layout, "alike types") if confused else None)
    rng, times_ms, states, acts, wrong = random.Random(1), list[float](), 0, 0, 0
    for _ in range(assemblies):
        steps = list(assembly(product, rng))
        for reported, placed, goal in rng.sample(steps, min(STATES, len(steps))):
            began = time.process_time()
            plan = planner.plan(AssemblyState(reported))
            times_ms.append(1e3 * (time.process_time() - began))
            (part, at), belief = max(plan.next_belief.items(), key=lambda entry: entry[1], default=(("", ""), 0.0))
            states += 1
            if belief >= ACT and plan.goal_belief[UNKNOWN_GOAL] < 0.5:
                acts += 1
                wrong += part not in product.accepted(goal).get(at, ()) or not product.fits(goal, {**placed, at: part})
    low, _, high = wilson(wrong, acts)
    share = f"{wrong / max(acts, 1):.3f} ({low:.3f} to {high:.3f})"
    p95 = statistics.quantiles(times_ms, n=20)[-1]
    return (
        f"| {statistics.median(times_ms):.2f} / {p95:.2f} | {acts / states:.2f} | {wrong} of {acts}: {share} "
        f"| {assemblies} | {planner.inference} |"
    )


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--assemblies", type=int, default=200)
    assemblies = parser.parse_args().assemblies
    print("| slots / types / goals | kind | ms median / p95 | acts in | wrong acts | n | inference |")
    print("|---|---|---|---|---|---|---|")
    for slots, types, goals in SIZES:
        for varied, confused in ((False, False), (True, False), (False, True), (True, True)):
            kind = ("varied" if varied else "alike") + (", confusions" if confused else "")
            made = row(family(slots, types, goals, varied=varied), assemblies, confused=confused)
            print(f"| {slots} / {types} / {goals} | {kind} {made}", flush=True)


if __name__ == "__main__":
    main()
