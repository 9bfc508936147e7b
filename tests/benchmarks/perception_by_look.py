"""Classical perception under each look: `python -m tests.benchmarks.perception_by_look --looks varied hard`.

Clutter scenes from the wrist camera, and runs of the person alone from the overhead camera (perception_accuracy.py).
"""

from __future__ import annotations

import argparse

from bracket_cell.configuration import Configuration, load_configuration, load_product, simulated
from bracket_ground.interfaces.product import Product
from bracket_sim.scene.look import Look
from tests.benchmarks.perception_accuracy import RunErrors, parts_in_clutter, quantile, worker_run

SECTIONS = [f"hard:{section}" for section in Look.model_fields]
HEAD = """| look | parts in clutter, extra | position median / 95 % | placements, false | screws, false | holes right |
|---|---|---|---|---|---|"""


def row(configuration: Configuration, product: Product, look: str, scenes: int, first_seed: int, seeds: int) -> str:
    """One line of the table."""
    configuration = simulated(configuration, look)
    errors = parts_in_clutter(configuration, product, scenes).values()
    position_mm = [1e3 * error_m for each in errors for error_m in each.position_m]
    parts = len(position_mm) + sum(each.missed for each in errors)
    runs = RunErrors()
    for seed in range(first_seed, first_seed + seeds):
        worker_run(configuration, product, seed, runs)
    cells = (
        f"`{look}`",
        f"{len(position_mm)} of {parts}, {sum(each.extra for each in errors)}",
        f"{quantile(position_mm, 50):.2f} / {quantile(position_mm, 95):.2f} mm",
        f"{runs.placed_seen} of {runs.placements}, {runs.false_placements}",
        f"{runs.screws_seen} of {runs.screws}, {runs.false_screws}",
        f"{runs.holes - runs.wrong_holes} of {runs.holes}",
    )
    return f"| {' | '.join(cells)} |"


def main() -> None:
    """Parse options and print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--looks", nargs="+", default=["nominal", "varied", "hard", *SECTIONS])
    parser.add_argument("--scenes", type=int, default=12, help="of parts in clutter")
    parser.add_argument("--seeds", type=int, default=5, help="runs of the person")
    parser.add_argument("--first-seed", type=int, default=0)
    options = parser.parse_args()
    configuration = load_configuration()
    product = load_product(configuration)
    print(HEAD, flush=True)
    for look in options.looks:
        print(row(configuration, product, look, options.scenes, options.first_seed, options.seeds), flush=True)


if __name__ == "__main__":
    main()
