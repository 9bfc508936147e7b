"""Time of a plan on one CPU thread, with the shipped weights; the paper reports 2.1 ms an object on a GPU.

Semantic planners plan for all part types at once: every state of the default product, ROUNDS times. Medians in
milliseconds are printed as JSON, with the limit for one object.
"""

from __future__ import annotations

import json
import statistics
import time
from collections.abc import Callable
from functools import partial
from pathlib import Path

import yaml

from cell.interfaces.planning import weights_file
from cell.interfaces.product import Product
from learned.semantic.graph import Layout
from learned.semantic.planner import load_semantic_planner
from learned.semantic.scenarios import scenarios

ROOT = Path(__file__).resolve().parents[2]
ROUNDS = 5
LIMIT_MS = 0.3


def median_ms(calls: list[Callable[[], object]]) -> float:
    """Median time of one of the calls, each made ROUNDS times after a first round that is not counted."""
    times = []
    for counted in [False] + ROUNDS * [True]:
        for call in calls:
            begin = time.perf_counter()
            call()
            if counted:
                times.append(time.perf_counter() - begin)
    return 1e3 * statistics.median(times)


def semantic_times(product: Product) -> dict[str, float]:
    """Median time of a plan by kind."""
    layout = Layout.of(product)
    states = [layout.state(row) for row in scenarios(layout, 0).seen]
    found = {}
    for kind in ("factored", "paper", "and_or", "bayes"):
        path = ROOT / "learned" / "weights" / weights_file("semantic", kind)
        planner = load_semantic_planner(kind, path, product)
        found[f"semantic {kind}"] = median_ms([partial(planner.plan, state) for state in states])
    return found


def main() -> None:
    product = Product.model_validate(yaml.safe_load((ROOT / "config" / "products.yaml").read_text()))
    times = semantic_times(product)
    report = {name: {"median_ms": round(value, 4), "kept": value <= LIMIT_MS} for name, value in times.items()}
    print(json.dumps({"limit_ms": LIMIT_MS, "planners": report}, indent=2))


if __name__ == "__main__":
    main()
