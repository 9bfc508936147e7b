"""Experiments on grasp planners as a list of cells, each computed once and kept on disk (Tables 2 and 3, and more).

A cell is one planner, trained with one seed on so many scenes, scored under one condition. Its file is named after
all that it depends on, the training settings included; so an interrupted series goes on where it stopped, and a
changed planner is measured anew.
"""

from __future__ import annotations

import hashlib
import json
import math
from collections.abc import Iterable
from dataclasses import asdict, dataclass
from functools import lru_cache
from pathlib import Path
from typing import Literal

from rich.console import Console
from rich.progress import track

from cell.interfaces.planning import GraspPlanner
from cell.interfaces.product import Product
from learned.grasp.contenders import CONTENDERS, SEEDS, Trainer
from learned.grasp.evaluate import SCENE_SIZES, evaluate_scenes, iterative_scores
from learned.grasp.planner import PaperPlanner
from learned.grasp.scenes import Scene, draw_scenes
from learned.grasp.settings import TRAY_SCENES, DetectionNoise, GripperGeometry, SceneSettings

Experiment = Literal["table2", "table3", "noise", "curve"]
EXPERIMENTS: tuple[Experiment, ...] = ("table2", "table3", "noise", "curve")

PAPER_SCENES = 427
TEST_SEED = 2026  # of all test scenes; nothing was ever chosen by their scores
CURVE = (100, 427, 1000, 3000, 10000)
_VERSION = 1  # of the code behind labels and scores; a new one makes all cells anew

_MM, _DEG = 0.001, math.pi / 180
NOISES = {
    "detector": DetectionNoise(),
    "2 mm, 4 deg": DetectionNoise(position_m=2 * _MM, yaw_rad=4 * _DEG),
    "5 mm, 10 deg": DetectionNoise(position_m=5 * _MM, yaw_rad=10 * _DEG),
    "heights and sizes 2 mm": DetectionNoise(bottom_m=2 * _MM, size_m=2 * _MM),
    "heights and sizes 5 mm": DetectionNoise(bottom_m=5 * _MM, size_m=5 * _MM),
    "all: 5 mm, 10 deg": DetectionNoise(position_m=5 * _MM, yaw_rad=10 * _DEG, bottom_m=5 * _MM, size_m=5 * _MM),
}


@dataclass(frozen=True)
class Cell:
    """One number of one table.

    Attributes:
        contender: its name.
        train_scenes, seed: what it learned from.
        what: "objects" on 1000 scenes, "fifty" on the first 50 of them, or "iterative 3" and so on.
        noise: name of the detections' noise.
        told: whether the planner knows that noise, or believes in the detector's own.
        tray: scenes as loose as the simulator's, not dense ones.
    """

    contender: str
    train_scenes: int = PAPER_SCENES
    seed: int = 1
    what: str = "objects"
    noise: str = "detector"
    told: bool = True
    tray: bool = False


def cells_of(experiment: Experiment) -> list[Cell]:
    """All cells of an experiment, those of one trained network together."""
    return list(_CELLS[experiment]())


def run_cells(cells: Iterable[Cell], product: Product, folder: Path, console: Console) -> dict[Cell, dict[str, float]]:
    """Scores of cells, as kept in `folder` or computed now."""
    trainer = Trainer(product, folder / "networks")
    cells = list(dict.fromkeys(cells))
    found: dict[Cell, dict[str, float]] = {}
    for cell in track(cells, "experiments", console=console):
        kept = folder / f"{_identity(cell)}.json"
        if not kept.exists():
            scores = _scores(cell, trainer, product)
            kept.parent.mkdir(parents=True, exist_ok=True)
            partial = kept.with_suffix(".partial")
            partial.write_text(json.dumps({"cell": asdict(cell), "scores": scores}) + "\n", encoding="utf-8")
            partial.replace(kept)
        found[cell] = json.loads(kept.read_text(encoding="utf-8"))["scores"]
    return found


def _table2() -> Iterable[Cell]:
    for name, contender in CONTENDERS.items():
        for seed in contender.seeds:
            for what, tray in (("objects", False), ("fifty", False), ("objects", True)):
                if not tray or name in ("default", "paper", "rule", "rule0"):
                    yield Cell(name, seed=seed, what=what, tray=tray)


def _table3() -> Iterable[Cell]:
    for name in ("default", "rule", "rule0", "paper"):
        for size in SCENE_SIZES:
            yield Cell(name, what=f"iterative {size}")


def _noise() -> Iterable[Cell]:
    for name in ("default", "rule", "rule0", "average", "paper"):
        for seed in SEEDS[:2] if name == "default" else SEEDS[:1]:
            for noise in NOISES if name != "average" else list(NOISES)[:3]:
                yield Cell(name, seed=seed, noise=noise)
                if name == "default" and noise != "detector":
                    yield Cell(name, seed=seed, noise=noise, told=False)


def _curve() -> Iterable[Cell]:
    for name in ("default", "paper"):
        for scenes in CURVE:
            for seed in SEEDS if scenes <= PAPER_SCENES else SEEDS[:1]:
                yield Cell(name, scenes, seed)


_CELLS = {"table2": _table2, "table3": _table3, "noise": _noise, "curve": _curve}


def _identity(cell: Cell) -> str:
    trained = CONTENDERS[cell.contender].settings
    learning = trained.model_dump(mode="json", exclude={"scenes", "test_scenes"}) if trained else None
    geometry = [settings.model_dump(mode="json") for settings in (SceneSettings(), TRAY_SCENES, GripperGeometry())]
    text = json.dumps([_VERSION, asdict(cell), learning, geometry], sort_keys=True)
    return hashlib.sha256(text.encode()).hexdigest()[:24]


def _scores(cell: Cell, trainer: Trainer, product: Product) -> dict[str, float]:
    noise = NOISES[cell.noise]
    planner = trainer.planner(cell.contender, cell.train_scenes, cell.seed)(noise if cell.told else DetectionNoise())
    settings = (TRAY_SCENES if cell.tray else SceneSettings()).model_copy(update={"noise": noise})
    if cell.what.startswith("iterative"):
        return _iterative(planner, product, int(cell.what.split()[1]), settings)
    crops = cell.contender == "crops"
    scenes = _test_scenes(product.model_dump_json(), cell.noise, cell.tray, crops)[
        : 50 if cell.what == "fifty" else None
    ]
    if isinstance(planner, PaperPlanner):
        planner.prepare([scene.parts for scene in scenes])
    return evaluate_scenes(planner, scenes, TEST_SEED)


def _iterative(planner: GraspPlanner, product: Product, size: int, settings: SceneSettings) -> dict[str, float]:
    drawn = draw_scenes(product, TEST_SEED, 250, "test", settings, (size, size))
    scores = iterative_scores(planner, drawn, TEST_SEED, size, settings)
    return {name.replace(f"_{size}", ""): value for name, value in scores.items()}


@lru_cache(maxsize=8)
def _test_scenes(product: str, noise: str, tray: bool, crops: bool) -> tuple[Scene, ...]:
    settings = (TRAY_SCENES if tray else SceneSettings()).model_copy(update={"noise": NOISES[noise], "crops": crops})
    return tuple(draw_scenes(Product.model_validate_json(product), TEST_SEED, 1000, "test", settings))
