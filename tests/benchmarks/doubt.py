"""What `guard.doubt_probability` costs and brings: questions, and wrong acts at goals that nobody listed.

python -m tests.benchmarks.doubt --seed 101
The exact planner, 400 brackets of listed goals and 400 of others; alike types are confused.
"""

from __future__ import annotations

import argparse

from bracket_cell.configuration import load_configuration, load_product
from bracket_lab.experiments.semantic_streams import first_meetings

DOUBTS = (0.01, 0.0125, 0.015, 0.0175, 0.02, 0.03, 0.05, 0.1)
NAMES = ("asked_known", "asked_unknown", "wrong_acts_known", "wrong_assemblies_unknown")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seed", type=int, default=101)
    options = parser.parse_args()
    product = load_product(load_configuration())
    for doubt in DOUBTS:
        found = first_meetings(product, "bayes", "alike types", doubt, options.seed)
        print(f"{doubt:g}: " + ", ".join(f"{name} {found[name]:.3f}" for name in NAMES), flush=True)


if __name__ == "__main__":
    main()
