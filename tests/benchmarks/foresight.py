"""How early, how often and how surely the hole of a placement is foreseen from the hand's way; fits the settings, too.

python -m tests.benchmarks.foresight --recordings 60
python -m tests.benchmarks.foresight --fit --recordings 120 --first-seed 973000
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator, Mapping
from dataclasses import dataclass

import numpy as np

from bracket_cell.configuration import Configuration, load_configuration, load_product
from bracket_cell.learned.classical.foresight import DEFAULT, ForesightSettings, foreseen
from bracket_cell.wiring.services import load_planners
from bracket_ground.interfaces.planning import AssemblyState
from bracket_ground.interfaces.pose import Array
from bracket_ground.interfaces.product import Product
from bracket_lab.drawing.without_physics import KinematicBench, Recording
from bracket_sim.scene.person import PERSONS

EARLY_S = (1.5, 1.25, 1.0, 0.75, 0.5, 0.25)
SPEED_FRAMES = 3  # that a measured velocity is a mean over
ERROR_M = 0.008  # of a tracked hand
SURE = 0.9
FIRST_SEED = 974000
XY = tuple[float, float]


@dataclass(frozen=True)
class Look:
    """What is known so long before a release.

    Attributes:
        belongs: of each open hole, how probable it is that the part belongs there.
    """

    early_s: float
    hole: str
    tips_m: XY
    velocity_m_s: XY
    holes_m: Mapping[str, XY]
    belongs: Mapping[str, float]


def looks(configuration: Configuration, product: Product, first_seed: int, count: int) -> Iterator[Look]:
    """Of the placements of people who work alone, by turns a careful, an ordinary and a varied one."""
    planner = load_planners(configuration, product).semantic
    bracket = configuration.bench.bracket.pose
    holes = {
        name: tuple(bracket.transform(np.array([*xy, 0.0]))[:2].tolist())
        for name, xy in product.bracket.holes_m.items()
    }
    goals, rng = list(product.goals), np.random.default_rng(first_seed)
    benches = [
        KinematicBench(product, configuration.bench, PERSONS[name]) for name in ("careful", "ordinary", "varied")
    ]
    for number in range(count):
        recording = benches[number % len(benches)].record(goals[number % len(goals)], first_seed + number)
        placed: dict[str, str] = {}
        for act in recording.acts:
            part, hole = act.fields.get("part"), act.fields.get("position")
            if act.fields.get("act") != "release" or part is None or hole is None or hole in placed:
                continue
            open_m = {name: xy for name, xy in holes.items() if name not in placed}
            plan = planner.plan(AssemblyState(dict(placed)))
            belongs = {name: plan.next_belief.get((str(part), name), 0.0) for name in open_m}
            for early_s in EARLY_S:
                if (hand := _hand(recording, act.time_s - early_s, rng)) is not None:
                    yield Look(early_s, str(hole), *hand, open_m, belongs)
            placed[str(hole)] = str(part)


def _hand(recording: Recording, now_s: float, rng: np.random.Generator) -> tuple[XY, XY] | None:
    last = int(np.searchsorted(recording.times_s, now_s, side="right"))
    if last < SPEED_FRAMES + 1:
        return None
    tips: Array = recording.fingertips_m[last - SPEED_FRAMES - 1 : last, :2]
    tips = tips + rng.normal(0, ERROR_M, tips.shape)
    took_s = float(recording.times_s[last - 1] - recording.times_s[last - SPEED_FRAMES - 1])
    velocity = (tips[-1] - tips[0]) / took_s
    return (float(tips[-1, 0]), float(tips[-1, 1])), (float(velocity[0]), float(velocity[1]))


def loss(rows: list[Look], settings: ForesightSettings) -> float:
    """Mean negative log of the probability of the true hole."""
    right = [
        foreseen(row.tips_m, row.velocity_m_s, row.holes_m, row.belongs, settings).get(row.hole, 0.0) for row in rows
    ]
    return float(-np.log(np.maximum(right, 1e-4)).mean())


def fit(rows: list[Look], tries: int = 120) -> ForesightSettings:
    """By steps at random that are kept where they help."""
    rng, best = np.random.default_rng(0), DEFAULT
    least = loss(rows, best)
    for _ in range(tries):
        factors = np.exp(rng.normal(0, 0.2, len(ForesightSettings.model_fields)))
        names = list(ForesightSettings.model_fields)
        tried = ForesightSettings(
            **{name: round(getattr(best, name) * factor, 4) for name, factor in zip(names, factors, strict=True)}
        )
        if (found := loss(rows, tried)) < least:
            least, best = found, tried
    print(f"fitted on {len(rows)} looks, {least:.3f}: {best}")
    return best


def report(rows: list[Look], settings: ForesightSettings) -> None:
    """Shares by how early it is."""
    print("before   looks  right  way alone   sure  right of sure  calibration error")
    for early_s in EARLY_S:
        asked = [row for row in rows if row.early_s == early_s]
        tops, alone = [], 0
        for look in asked:
            shares = foreseen(look.tips_m, look.velocity_m_s, look.holes_m, look.belongs, settings)
            hole = max(shares, key=lambda name: shares[name])
            tops.append((shares[hole], hole == look.hole))
            alike = foreseen(look.tips_m, look.velocity_m_s, look.holes_m, dict.fromkeys(look.holes_m, 1.0), settings)
            alone += max(alike, key=lambda name: alike[name]) == look.hole
        share, right = np.array(tops).T
        sure = share >= SURE
        error = sum(
            abs(share[bin_].mean() - right[bin_].mean()) * bin_.mean()
            for low in np.arange(0, 1, 0.1)
            if (bin_ := (share > low) & (share <= low + 0.1)).any()
        )
        of_sure = right[sure].mean() if sure.any() else float("nan")
        print(
            f"{early_s:5.2f} s {len(asked):6d} {right.mean():6.3f} {alone / len(asked):10.3f} {sure.mean():6.3f} "
            f"{of_sure:14.3f} {error:18.3f}"
        )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--recordings", type=int, default=60)
    parser.add_argument("--first-seed", type=int, default=FIRST_SEED)
    parser.add_argument("--fit", action="store_true")
    options = parser.parse_args()
    configuration = load_configuration()
    rows = list(looks(configuration, load_product(configuration), options.first_seed, options.recordings))
    report(rows, fit(rows) if options.fit else DEFAULT)


if __name__ == "__main__":
    main()
