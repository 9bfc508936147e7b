"""Cells of the experiments: one planner, trained with one seed on a number of scenes, scored under one condition."""

from __future__ import annotations

import math
from collections.abc import Iterator
from functools import partial
from typing import Any

from bracket_cell.learned.grasp.crops import TrayCamera
from bracket_cell.learned.grasp.settings import PAPER_SCENES, TRAY_SCENES, DetectionNoise, SceneSettings
from bracket_ground.interfaces.product import Product
from bracket_lab.experiments.experiments import Cell, Cells, Values, markdown, number, shown_share
from bracket_lab.experiments.paper.grasp import BASELINES, SEEDS, USUAL_SCENES, TrainedBaseline, trained_baseline
from bracket_lab.learned.grasp.evaluate import REQUIRED_TYPES, SCENE_SIZES, evaluate_scenes, iterative_scores
from bracket_lab.learned.grasp.scenes import draw_scenes

HEAD = (
    "planner",
    "1 type",
    "2 types",
    "3 types",
    "1 type, by part",
    "verdict",
    "train, verdict",
    "train, whole",
    "paper, 1 / 2 / 3",
)


def paper_section(cells: Cells) -> str:
    """The table."""
    rows = []
    for name in ON_PAPER_SCENES:
        tested = [*(f"by_type_{count}" for count in REQUIRED_TYPES), "object_accuracy_1", "graspability_accuracy"]
        found = [shown_share(cells, score, planner=name, clutter="paper", what="objects") for score in tested]
        learned = [
            shown_share(cells, score, planner=name, clutter="paper", what="train")
            for score in ("graspability_accuracy", "by_type_1")
        ]
        rows.append((BASELINES[name].title, *found, *learned, " / ".join(map(number, BASELINES[name].paper)) or "-"))
    fewest, most = PAPER_SCENES.parts
    return (
        "## Table 2: scenes like the paper's\n"
        f"{USUAL_SCENES} training and {TEST_SCENES} test scenes of {fewest} to {most} parts, at most 3, 2 and 1 of a "
        "type, one way to grasp (across the width), a fifth of the parts asked for not graspable at once; one seed. "
        "Whole answers, right by type as the paper's words name types; `by part`: the very parts, in an order that "
        "works. 2 and 3 types: one graph with so many flags. f_i: a small network tells, from a crop of 14 cm of "
        "the rendered wrist image around each part, where parts stand; it is trained before on the same images, as the "
        "paper's detector is. A second one, trained with the rest, makes features of that. `train`: on its own "
        f"training scenes (the paper's Train_Acc is 1).\n\n{markdown(HEAD, rows)}"
    )


TEST_SEED = 2026  # of all test scenes, where no other is asked for; nothing was ever chosen by their scores
TEST_SCENES, FEW_SCENES, ITERATIVE_SCENES = 1000, 50, 250
CURVE = (100, 427, 1000, 3000, 10000)

_MM, _DEG = 0.001, math.pi / 180
NOISES = {
    "detector": DetectionNoise(),
    "2 mm, 4 deg": DetectionNoise(position_m=2 * _MM, yaw_rad=4 * _DEG),
    "5 mm, 10 deg": DetectionNoise(position_m=5 * _MM, yaw_rad=10 * _DEG),
    "heights and sizes 2 mm": DetectionNoise(bottom_m=2 * _MM, size_m=2 * _MM),
    "heights and sizes 5 mm": DetectionNoise(bottom_m=5 * _MM, size_m=5 * _MM),
    "all: 5 mm, 10 deg": DetectionNoise(position_m=5 * _MM, yaw_rad=10 * _DEG, bottom_m=5 * _MM, size_m=5 * _MM),
}
CLUTTERS = {"paper": PAPER_SCENES, "dense": SceneSettings(), "loose": TRAY_SCENES}

USUAL = {"scenes": USUAL_SCENES, "what": "objects", "noise": "detector", "told": True, "clutter": "dense"}
"""What a cell's key holds beside the planner, its seed and that of the test scenes: training scenes; "objects" on
TEST_SCENES, "few" of them, "train" on those that it learned from, or "iterative 3" and so on; the detections' noise;
whether the planner knows it; how scenes are drawn: like the paper's, dense, or as loose as the simulator's tray
(learned from the dense ones)."""

ON_PAPER_SCENES = tuple(name for name in BASELINES if name not in ("rule", "average"))
ON_DENSE_SCENES = ("always", "default", "rule", "rule0", "average", "paper", "poses", "relations", "near")


def paper_cells(product: Product, camera: TrayCamera, test_seed: int = TEST_SEED) -> list[Cell]:
    """Table 2 on scenes like the paper's: every baseline, one seed, and its training scenes where it learns."""
    return [
        _cell(product, camera, test_seed, name, clutter="paper", what=what)
        for name in ON_PAPER_SCENES
        for what in (("objects", "train") if BASELINES[name].settings else ("objects",))
    ]


def table2_cells(product: Product, camera: TrayCamera, test_seed: int = TEST_SEED) -> list[Cell]:
    """Table 2 on dense scenes and some on loose ones."""
    cells = []
    for name in ON_DENSE_SCENES:
        for seed in BASELINES[name].seeds if name == "default" else SEEDS[:1]:
            for what, clutter in (("objects", "dense"), ("few", "dense"), ("objects", "loose")):
                if clutter == "dense" or name in ("always", "default", "paper", "rule", "rule0"):
                    cells.append(_cell(product, camera, test_seed, name, seed=seed, what=what, clutter=clutter))
    return cells


def table3_cells(product: Product, camera: TrayCamera, test_seed: int = TEST_SEED) -> list[Cell]:
    """Algorithm 2 by number of parts."""
    asked = [("paper", name) for name in ("paper", "rule0")] + [("dense", name) for name in ("default", "rule")]
    return [
        _cell(product, camera, test_seed, name, what=f"iterative {size}", clutter=clutter)
        for clutter, name in asked
        for size in SCENE_SIZES
    ]


def noise_cells(product: Product, camera: TrayCamera, test_seed: int = TEST_SEED) -> list[Cell]:
    """Detections under noise that the planner knows, and noise that it does not know."""
    cells = []
    for name in ("default", "rule", "rule0", "average"):
        for seed in SEEDS[:2] if name == "default" else SEEDS[:1]:
            for noise in NOISES if name != "average" else list(NOISES)[:3]:
                cells.append(_cell(product, camera, test_seed, name, seed=seed, noise=noise))
                if name == "default" and noise != "detector":
                    cells.append(_cell(product, camera, test_seed, name, seed=seed, noise=noise, told=False))
    return cells


def curve_cells(product: Product, camera: TrayCamera, test_seed: int = TEST_SEED) -> list[Cell]:
    """Score by number of training scenes."""
    return list(_curve(product, camera, test_seed))


def _curve(product: Product, camera: TrayCamera, test_seed: int) -> Iterator[Cell]:
    for name in ("default", "paper"):
        for scenes in CURVE:
            for seed in SEEDS if scenes <= USUAL_SCENES and name == "default" else SEEDS[:1]:
                yield _cell(product, camera, test_seed, name, scenes=scenes, seed=seed)


def _cell(product: Product, camera: TrayCamera, test_seed: int, name: str, *, seed: int = 1, **changes: Any) -> Cell:
    key = {"planner": name, "seed": seed, "test_seed": test_seed, **USUAL, **changes}
    return Cell(key, partial(_measure, product, camera, key))


def _measure(product: Product, camera: TrayCamera, key: dict[str, Any]) -> Values:
    noise, data = NOISES[key["noise"]], CLUTTERS[key["clutter"]]
    known = noise if key["told"] else DetectionNoise()
    learned_from = CLUTTERS["dense" if key["clutter"] == "loose" else key["clutter"]]
    asked = trained_baseline(key["planner"], product, camera, key["scenes"], key["seed"], known, learned_from)
    settings = data.model_copy(update={"noise": noise})
    if key["what"].startswith("iterative"):
        return _iterative(asked, product, int(key["what"].split()[1]), settings, key["test_seed"])
    if key["what"] == "train":
        drawn = draw_scenes(product, key["seed"], key["scenes"], "train", learned_from, learned_from.parts)
    else:
        count = FEW_SCENES if key["what"] == "few" else TEST_SCENES
        drawn = draw_scenes(product, key["test_seed"], count, "test", settings)
    return dict(evaluate_scenes(asked.planner, asked.look(list(drawn)), key["test_seed"]))


def _iterative(asked: TrainedBaseline, product: Product, size: int, settings: SceneSettings, seed: int) -> Values:
    drawn = draw_scenes(product, seed, ITERATIVE_SCENES, "test", settings, (size, size))
    scores = iterative_scores(asked.planner, drawn, seed, size, settings, asked.look)
    return {name.replace(f"_{size}", ""): value for name, value in scores.items()}
