"""The default grasp planner beside a reference that averages over the detector's known noise: what can be reached.

python -m tests.benchmarks.grasp_bound --seeds 3030 3031 --scenes 1000
"""

from __future__ import annotations

import argparse

from cell.commands.training.weights import shipped_weights
from learned.grasp.evaluate import evaluate_scenes
from learned.grasp.model import load_grasp_planner
from learned.grasp.scenes import draw_scenes
from learned.grasp.settings import SceneSettings
from learned.lab.grasp_baselines import AveragingPlanner
from tests.integration.cell_rig import CONFIGURATION, PRODUCT


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seeds", type=int, nargs="+", default=[3030])
    parser.add_argument("--scenes", type=int, default=1000, help="test scenes of each seed")
    options = parser.parse_args()
    grasp = CONFIGURATION.planners.grasp
    planners = {
        grasp.kind: load_grasp_planner(grasp.kind, shipped_weights("grasp", grasp.kind), PRODUCT),
        "average over the known noise": AveragingPlanner(PRODUCT, SceneSettings().noise),
    }
    shares: dict[str, list[float]] = {name: [] for name in planners}
    for seed in options.seeds:
        scenes = list(draw_scenes(PRODUCT, seed, options.scenes, "test"))
        for name, planner in planners.items():
            shares[name].append(evaluate_scenes(planner, scenes, seed)["object_accuracy_1"])
        print(seed, {name: round(each[-1], 4) for name, each in shares.items()}, flush=True)
    print("all", {name: round(sum(each) / len(each), 4) for name, each in shares.items()})


if __name__ == "__main__":
    main()
