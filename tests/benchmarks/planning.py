"""Time of a plan on one CPU thread, with the shipped weights; the paper reports 2.1 ms an object on a GPU.

Semantic planners plan for all part types at once: every state of the default product, ROUNDS times. Grasp planners are
asked about every part of dense scenes of 3 to 6 parts, as the controller asks: all about one view, one after the
other; the time is that of one answer. For the first answer about a view it stands beside. Medians in milliseconds are
printed as JSON, with the limit for one object.
"""

from __future__ import annotations

import argparse
import json
import statistics
import time
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from pathlib import Path

import yaml

from bracket_cell.learned.grasp.crops import EMBEDDING
from bracket_cell.learned.semantic.graph import Layout
from bracket_ground.interfaces.planning import weights_file
from bracket_ground.interfaces.product import Product
from bracket_lab.learned.grasp.paper_planner import load_grasp_planner
from bracket_lab.learned.grasp.scenes import draw_scenes
from bracket_lab.learned.semantic.paper_planner import load_semantic_planner
from bracket_lab.learned.semantic.scenarios import scenarios

ROOT = Path(__file__).resolve().parents[2]
ROUNDS = 5
LIMIT_MS = 0.3
GRASP_SEED, GRASP_SCENES = 5, 100
EMBEDDED = tuple(EMBEDDING * [0.5])  # the time does not depend on what a crop shows


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
    for kind in ("factored", "paper", "bayes"):
        path = ROOT / "learned" / "weights" / weights_file("semantic", kind)
        planner = load_semantic_planner(kind, path, product)
        found[f"semantic {kind}"] = median_ms([partial(planner.plan, state) for state in states])
    return found


def grasp_times(product: Product) -> dict[str, float]:
    """Median time of an answer by kind, over all parts of a view and for the first one alone."""
    scenes = list(draw_scenes(product, GRASP_SEED, GRASP_SCENES, "test"))
    found = {}
    for kind in ("pairwise", "paper", "rule"):
        path = ROOT / "learned" / "weights" / weights_file("grasp", kind)
        planner = load_grasp_planner(kind, path, product)
        each, first = [], []
        for scene in ROUNDS * scenes:
            parts = tuple(replace(part, embedding=EMBEDDED) for part in scene.parts)  # as if seen anew
            begin = time.perf_counter()
            planner.plan(parts, 0)
            first.append(time.perf_counter() - begin)
            for required in range(1, len(parts)):
                planner.plan(parts, required)
            each.append((time.perf_counter() - begin) / len(parts))
        found[f"grasp {kind}"] = 1e3 * statistics.median(each)
        found[f"grasp {kind}, first answer about a view"] = 1e3 * statistics.median(first)
    return found


def main() -> None:
    argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter).parse_args()
    product = Product.model_validate(yaml.safe_load((ROOT / "config" / "products.yaml").read_text()))
    times = semantic_times(product) | grasp_times(product)
    report = {name: {"median_ms": round(value, 4), "kept": value <= LIMIT_MS} for name, value in times.items()}
    print(json.dumps({"limit_ms": LIMIT_MS, "planners": report}, indent=2))


if __name__ == "__main__":
    main()
