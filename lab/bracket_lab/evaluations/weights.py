"""Scores of all trained networks of a folder, to see whether the figures of one folder come again in another."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from bracket_cell.configuration import Configuration
from bracket_cell.kinds import TRAINED_DEFAULTS
from bracket_cell.learned.grasp.crops import load_crops
from bracket_cell.learned.grasp.settings import SceneSettings
from bracket_cell.wiring.detectors import Detectors
from bracket_ground.interfaces.bench import Bench
from bracket_ground.interfaces.perception import HandTracker
from bracket_ground.interfaces.planning import crops_file, weights_file
from bracket_ground.interfaces.product import Product
from bracket_lab.drawing.splits import seeds as seeds_of
from bracket_lab.evaluations.actions import evaluate_segments
from bracket_lab.evaluations.hands import evaluate_hands
from bracket_lab.evaluations.holes_and_parts import Cameras, Task, score_holes, score_parts
from bracket_lab.learned.grasp.evaluate import embedded, evaluate_scenes
from bracket_lab.learned.grasp.paper_planner import load_grasp_planner
from bracket_lab.learned.grasp.scenes import draw_scenes
from bracket_lab.learned.semantic.evaluate import evaluate_scenarios
from bracket_lab.learned.semantic.paper_planner import load_semantic_planner
from bracket_lab.wiring.drawn_frames import tray_camera

NETWORKS = (
    *TRAINED_DEFAULTS.items(),
    ("grasp", "pairwise"),
    ("grasp", "paper"),
    ("semantic", "factored"),
    ("semantic", "paper"),
)
FIGURES: Mapping[str, Mapping[str, str]] = {  # names, and that of how many they were counted on; none: not a share
    "holes": {"right": "holes", "called_empty": "filled", "upright": "upright_n"},
    "parts": {
        "map_50": "things",
        "map_50_95": "things",
        "posture": "posture_n",
        "position_mm_p95": "",
        "yaw_deg_p95": "",
    },
    "hands": {"found": "found_n", "palm_mm_p50": "", "palm_mm_p95": ""},
    "actions": dict.fromkeys(("outside_guard", "all_segments", "assemblies"), "n"),
    "grasp": dict.fromkeys((*(f"object_accuracy_{count}" for count in (1, 2, 3)), "graspability_accuracy"), "scenes"),
    "semantic": dict.fromkeys(("success_all", "success_held_out"), "drawn"),
}
NEAR_POINTS = 0.5  # per cent, up to which a share counts as the same
SAME, CHANCE, APART = "the same within .5 points", "apart by no more than chance", "apart"

Figure = dict[str, float]  # "value", and "n" where it is a share of n


@dataclass(frozen=True)
class Sample:
    """What detectors are scored on.

    Attributes:
        configuration: with the look and the person.
        recordings: looks of the plate, trays and assemblies.
        stills: of each look of the plate; stretches: of frames of each assembly with a hand.
        scenes: of parts in a tray, for the planners of grasps.
    """

    configuration: Configuration
    product: Product
    first_seed: int
    recordings: int
    cameras: Cameras = "calibrated"
    stills: int = 10
    stretches: int = 2
    scenes: int = 2000

    @property
    def told(self) -> dict[str, object]:
        """For the heading of a file of rows."""
        numbers = ("first_seed", "recordings", "cameras", "stills", "stretches", "scenes")
        return {name: getattr(self, name) for name in numbers}


@dataclass(frozen=True)
class Comparison:
    """Figures of two networks that are to be the same.

    Attributes:
        told: by figure `before`, `now`, and of shares `points` (per cent) apart, `n`, `chance_points` (95 %; where n
            is known) and a verdict.
        verdict: that of the worst figure.
    """

    told: Mapping[str, Mapping[str, Any]]
    verdict: str

    @property
    def rows(self) -> dict[str, str]:
        """For a table."""
        return {name: _in_words(figure) for name, figure in self.told.items()} | {"verdict": self.verdict}


def compared(before: Mapping[str, Figure], now: Mapping[str, Figure]) -> Comparison:
    """How far figures are apart, and whether chance alone explains it.

    The interval is that of two shares of independent samples; both saw the same images, so it is rather too wide.
    """
    told: dict[str, dict[str, Any]] = {}
    for name in now.keys() & before.keys():
        one, other = before[name], now[name]
        told[name] = {"before": one["value"], "now": other["value"]}
        if "n" in other:
            told[name] |= _apart(one["value"], other["value"], int(other["n"]))
    verdicts = [figure["verdict"] for figure in told.values() if "verdict" in figure]
    worst = max(verdicts, key=(SAME, CHANCE, APART).index, default="no figure in common")
    return Comparison(dict(sorted(told.items())), worst)


def _apart(before: float, now: float, n: int) -> dict[str, Any]:
    points, mean = 100 * (now - before), (before + now) / 2
    chance = 100 * 1.96 * math.sqrt(max(0.0, mean * (1 - mean)) * 2 / n) if n else 0.0
    verdict = SAME if abs(points) <= NEAR_POINTS else CHANCE if abs(points) <= chance else APART
    return {"points": round(points, 2), "n": n, "chance_points": round(chance, 2), "verdict": verdict}


def _in_words(figure: Mapping[str, Any]) -> str:
    told = f"{figure['before']:.4g} -> {figure['now']:.4g}"
    if "points" not in figure:
        return told
    n = f" of {figure['n']}, chance up to {figure['chance_points']:.2g}" if figure["n"] else ""
    return f"{told} ({figure['points']:+.2f} points{n}): {figure['verdict']}"


def score_weights(sample: Sample, folder: Path, name: str, kind: str) -> dict[str, Figure]:
    """The figures of one network, with the weights of a folder.

    Raises:
        ModelError: the weights are missing, damaged, or of another product.
    """
    weights = folder / weights_file(name, kind)
    scored: Mapping[str, Any] = _SCORED[name](sample, weights, kind)
    return {figure: _figure(scored, figure, count) for figure, count in FIGURES[name].items() if figure in scored}


def _figure(scored: Mapping[str, Any], name: str, count: str) -> Figure:
    value = scored[name]
    if isinstance(value, Mapping):
        return {"value": float(value["share"]), "n": float(value["n"])}
    return {"value": float(value)} | ({"n": float(scored[count])} if count else {})


def _task(sample: Sample, kind: str, weights: Path) -> tuple[Task, range]:
    task = Task(sample.configuration, sample.product, kind, weights, sample.cameras)
    return task, seeds_of(sample.first_seed, sample.recordings)[1]


def _holes(sample: Sample, weights: Path, kind: str) -> dict[str, float]:
    task, wanted = _task(sample, kind, weights)
    return score_holes(task, wanted, sample.stills)


def _parts(sample: Sample, weights: Path, kind: str) -> dict[str, float]:
    task, wanted = _task(sample, kind, weights)
    return score_parts(task, wanted, mixed=True)


def _hands(sample: Sample, weights: Path, kind: str) -> dict[str, Any]:
    perception = sample.configuration.perception.with_detector("hands", kind, weights)

    def make(bench: Bench) -> HandTracker:
        tracker: HandTracker = Detectors(bench, sample.product, perception).make("hands")
        return tracker

    wanted = seeds_of(sample.first_seed, sample.recordings)[1]
    found = evaluate_hands(
        sample.configuration, sample.product, {"hands": make}, wanted, stretches=sample.stretches, physics=False
    )
    return found["hands"]


def _actions(sample: Sample, weights: Path, kind: str) -> dict[str, Any]:
    wanted = seeds_of(sample.first_seed, sample.recordings)[1]
    return evaluate_segments(sample.configuration, sample.product, kind, wanted, weights)


def _grasp(sample: Sample, weights: Path, kind: str) -> dict[str, float]:
    planner = load_grasp_planner(kind, weights, sample.product)
    scenes = list(draw_scenes(sample.product, sample.first_seed, sample.scenes, "test", SceneSettings()))
    if kind == "paper":
        with tray_camera(sample.product, sample.configuration.bench) as camera:
            scenes = embedded(scenes, camera, load_crops(crops_file(weights)))
    return {**evaluate_scenes(planner, scenes, sample.first_seed), "scenes": len(scenes)}


def _semantic(sample: Sample, weights: Path, kind: str) -> dict[str, float]:
    planner = load_semantic_planner(kind, weights, sample.product)
    return {**evaluate_scenarios(planner, sample.product, sample.first_seed), "drawn": 0}  # every state is asked about


_SCORED = {
    "holes": _holes,
    "parts": _parts,
    "hands": _hands,
    "actions": _actions,
    "grasp": _grasp,
    "semantic": _semantic,
}
