"""Processor time of a `cell run` that ends with its first ticks, all of its processes, with byte code.

python -m tests.benchmarks.startup --times 5 [--before CHECKOUT]
"""

from __future__ import annotations

import argparse
import tempfile
from pathlib import Path
from statistics import median

from rich.console import Console
from rich.table import Table

from tests import ROOT
from tests.benchmarks.overlap import FIRST_TICKS_S, adopt_orphans, configuration, run, use_byte_code


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--times", type=int, default=5)
    parser.add_argument("--before", type=Path, help="checkout to compare with, in turns")
    options = parser.parse_args()
    adopt_orphans()
    checkouts = [ROOT, *([options.before.resolve()] if options.before else [])]
    spent: dict[Path, list[float]] = {checkout: [] for checkout in checkouts}
    with tempfile.TemporaryDirectory() as name:
        use_byte_code(Path(name))
        for number in range(options.times + 1):
            for checkout in checkouts:
                path = configuration(checkout, Path(name) / "cell.yaml", None, FIRST_TICKS_S)
                cost = run(checkout, path, number, Path(name))
                if number:  # the first one compiles
                    spent[checkout].append(cost.processor_s)
    shown = Table("checkout", "median", "least", title=f"start-up, processor time in s, {options.times} times")
    for checkout, values in spent.items():
        shown.add_row(str(checkout), f"{median(values):.2f}", f"{min(values):.2f}")
    Console().print(shown)


if __name__ == "__main__":
    main()
