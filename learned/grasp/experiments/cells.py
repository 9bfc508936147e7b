"""Cells of the experiments: one planner, trained with one seed on so many scenes, scored under one condition."""

from __future__ import annotations

import math
from collections.abc import Iterator
from functools import lru_cache, partial
from typing import Any

from cell.interfaces.planning import GraspPlanner
from cell.interfaces.product import Product
from learned.experiments import Cell, Values
from learned.grasp.evaluate import SCENE_SIZES, evaluate_scenes, iterative_scores
from learned.grasp.experiments.baselines import BASELINES, SEEDS, planner_of
from learned.grasp.planner import PaperPlanner
from learned.grasp.scenes import Scene, draw_scenes
from learned.grasp.settings import TRAY_SCENES, DetectionNoise, SceneSettings

PAPER_SCENES = 427
TEST_SEED = 2026  # of all test scenes; nothing was ever chosen by their scores
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

USUAL = {"scenes": PAPER_SCENES, "what": "objects", "noise": "detector", "told": True, "tray": False}
"""What a cell's key holds beside the planner and the seed: training scenes; "objects" on TEST_SCENES, "few" of them or
"iterative 3" and so on; the detections' noise; whether the planner knows it; scenes as loose as the simulator's."""


def table2_cells(product: Product) -> list[Cell]:
    """Every baseline and seed, on dense scenes and some on loose ones."""
    cells = []
    for name, baseline in BASELINES.items():
        for seed in baseline.seeds:
            for what, tray in (("objects", False), ("few", False), ("objects", True)):
                if not tray or name in ("default", "paper", "rule", "rule0"):
                    cells.append(_cell(product, name, seed=seed, what=what, tray=tray))
    return cells


def table3_cells(product: Product) -> list[Cell]:
    """Algorithm 2 by number of parts."""
    names = ("default", "rule", "rule0", "paper")
    return [_cell(product, name, what=f"iterative {size}") for name in names for size in SCENE_SIZES]


def noise_cells(product: Product) -> list[Cell]:
    """Detections under noise that the planner knows, and noise that it does not know."""
    cells = []
    for name in ("default", "rule", "rule0", "average", "paper"):
        for seed in SEEDS[:2] if name == "default" else SEEDS[:1]:
            for noise in NOISES if name != "average" else list(NOISES)[:3]:
                cells.append(_cell(product, name, seed=seed, noise=noise))
                if name == "default" and noise != "detector":
                    cells.append(_cell(product, name, seed=seed, noise=noise, told=False))
    return cells


def curve_cells(product: Product) -> list[Cell]:
    """Score by number of training scenes."""
    return list(_curve(product))


def _curve(product: Product) -> Iterator[Cell]:
    for name in ("default", "paper"):
        for scenes in CURVE:
            for seed in SEEDS if scenes <= PAPER_SCENES else SEEDS[:1]:
                yield _cell(product, name, scenes=scenes, seed=seed)


def _cell(product: Product, name: str, *, seed: int = 1, **changes: Any) -> Cell:
    key = {"planner": name, "seed": seed, **USUAL, **changes}
    return Cell(key, partial(_measure, product, key))


def _measure(product: Product, key: dict[str, Any]) -> Values:
    noise = NOISES[key["noise"]]
    planner = planner_of(
        key["planner"], product, key["scenes"], key["seed"], noise if key["told"] else DetectionNoise()
    )
    settings = (TRAY_SCENES if key["tray"] else SceneSettings()).model_copy(update={"noise": noise})
    if key["what"].startswith("iterative"):
        return _iterative(planner, product, int(key["what"].split()[1]), settings)
    scenes = _test_scenes(product.model_dump_json(), key["noise"], key["tray"], key["planner"] == "crops")
    chosen = scenes[:FEW_SCENES] if key["what"] == "few" else scenes
    if isinstance(planner, PaperPlanner):
        planner.prepare([scene.parts for scene in chosen])
    return dict(evaluate_scenes(planner, chosen, TEST_SEED))


def _iterative(planner: GraspPlanner, product: Product, size: int, settings: SceneSettings) -> Values:
    drawn = draw_scenes(product, TEST_SEED, ITERATIVE_SCENES, "test", settings, (size, size))
    scores = iterative_scores(planner, drawn, TEST_SEED, size, settings)
    return {name.replace(f"_{size}", ""): value for name, value in scores.items()}


@lru_cache(maxsize=8)
def _test_scenes(product: str, noise: str, tray: bool, crops: bool) -> tuple[Scene, ...]:
    settings = (TRAY_SCENES if tray else SceneSettings()).model_copy(update={"noise": NOISES[noise], "crops": crops})
    return tuple(draw_scenes(Product.model_validate_json(product), TEST_SEED, TEST_SCENES, "test", settings))
