"""The shipped `paper` grasp weights against always answering "grasp", on trays that they were not trained on.

python -m tests.benchmarks.grasp_clutter --scenes 200
Trays are rendered; two parts of two types are asked for in each. Shares with their 95 % interval.
"""

from __future__ import annotations

import argparse

from bracket_cell.learned.grasp.settings import TRAY_SCENES, SceneSettings
from bracket_lab.learned.grasp.evaluate import evaluate_scenes
from bracket_lab.learned.grasp.paper_planner import load_grasp_planner
from bracket_lab.learned.grasp.scenes import draw_scenes
from tests.learned.grasp.layouts import PRODUCT, WEIGHTS
from tests.learned.grasp.rendered import look

SEED = 41
CLUTTERS = {
    "dense, as trained on": SceneSettings(),
    "loose, as trained on": TRAY_SCENES,
    "gaps of 3 to 15 mm": SceneSettings(farthest_gap_m=0.015, by_quantity=True),
    "a third beside another, gaps of 6 to 20 mm": SceneSettings(
        neighbour_share=0.3, nearest_gap_m=0.006, farthest_gap_m=0.02, crowding=4
    ),
    "a tray of 20 x 24 cm": SceneSettings(tray_m=(0.20, 0.24), crowding=1, farthest_gap_m=0.02),
    "strewn over 22 x 22 cm": SceneSettings(
        neighbour_share=0, crowding=1, tray_m=(0.22, 0.22), by_quantity=True, nearest_gap_m=0.002
    ),
}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--scenes", type=int, default=200)
    options = parser.parse_args()
    planner = load_grasp_planner("paper", WEIGHTS / "grasp_paper.onnx", PRODUCT)
    for name, clutter in CLUTTERS.items():
        scenes = look(list(draw_scenes(PRODUCT, SEED, options.scenes, "validation", clutter)))
        found = evaluate_scenes(planner, scenes, SEED)
        asked = "object_accuracy_2"
        free = [scene.graspable(part) for scene in scenes for part in range(len(scene.parts))]
        print(
            f"{name}: {found[asked]:.3f} ({found[asked + '_low']:.3f} - {found[asked + '_high']:.3f}); "
            f"share of parts that can be grasped at once {sum(free) / len(free):.3f}",
            flush=True,
        )


if __name__ == "__main__":
    main()
