"""Scores of all trained detectors of a folder, to see whether the figures of one folder come again in another."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from cell.configuration import Configuration
from cell.evaluating.actions import evaluate_segments
from cell.evaluating.hands import evaluate_hands
from cell.evaluating.things import Cameras, Task, score_holes, score_parts
from cell.interfaces.bench import Bench
from cell.interfaces.perception import HandTracker
from cell.interfaces.planning import weights_file
from cell.interfaces.product import Product
from cell.running.detectors import Detectors
from cell.settings import LEARNED_KINDS, DetectorSettings
from sim.data.splits import seeds as seeds_of

FIGURES: Mapping[str, tuple[str, ...]] = {
    "holes": ("right", "called_empty", "upright"),
    "parts": ("map_50", "map_50_95", "posture", "position_mm_p95", "yaw_deg_p95"),
    "hands": ("found", "palm_mm_p50", "palm_mm_p95"),
    "actions": ("outside_guard", "all_segments", "assemblies"),
}


@dataclass(frozen=True)
class Sample:
    """What detectors are scored on.

    Attributes:
        configuration: with the look and the person.
        recordings: looks of the plate, trays and assemblies.
        stills: of each look of the plate; stretches: of frames of each assembly with a hand.
    """

    configuration: Configuration
    product: Product
    first_seed: int
    recordings: int
    cameras: Cameras = "calibrated"
    stills: int = 10
    stretches: int = 2

    @property
    def told(self) -> dict[str, object]:
        """For the heading of a file of rows."""
        numbers = ("first_seed", "recordings", "cameras", "stills", "stretches")
        return {name: getattr(self, name) for name in numbers}


def score_weights(sample: Sample, folder: Path, detector: str) -> dict[str, float]:
    """The figures of one detector, by name, with the weights of a folder.

    Raises:
        ModelError: the weights are missing, damaged, or of another product.
    """
    weights = folder / weights_file(detector, LEARNED_KINDS[detector])
    scored: Mapping[str, Any] = _SCORED[detector](sample, weights)
    return {name: _number(scored[name]) for name in FIGURES[detector] if name in scored}


def _task(sample: Sample, detector: str, weights: Path) -> tuple[Task, range]:
    task = Task(sample.configuration, sample.product, LEARNED_KINDS[detector], weights, sample.cameras)
    return task, seeds_of(sample.first_seed, sample.recordings)[1]


def _holes(sample: Sample, weights: Path) -> dict[str, float]:
    task, wanted = _task(sample, "holes", weights)
    return score_holes(task, wanted, sample.stills)


def _parts(sample: Sample, weights: Path) -> dict[str, float]:
    task, wanted = _task(sample, "parts", weights)
    return score_parts(task, wanted, mixed=True)


def _hands(sample: Sample, weights: Path) -> dict[str, Any]:
    chosen = DetectorSettings(kind=LEARNED_KINDS["hands"], weights=weights)
    perception = sample.configuration.perception.model_copy(update={"hands": chosen})

    def make(bench: Bench) -> HandTracker:
        tracker: HandTracker = Detectors(bench, sample.product, perception).make("hands")
        return tracker

    wanted = seeds_of(sample.first_seed, sample.recordings)[1]
    found = evaluate_hands(
        sample.configuration, sample.product, {"hands": make}, wanted, stretches=sample.stretches, physics=False
    )
    return found["hands"]


def _actions(sample: Sample, weights: Path) -> dict[str, Any]:
    wanted = seeds_of(sample.first_seed, sample.recordings)[1]
    return evaluate_segments(sample.configuration, sample.product, LEARNED_KINDS["actions"], wanted, weights)


_SCORED = {"holes": _holes, "parts": _parts, "hands": _hands, "actions": _actions}


def _number(value: Any) -> float:
    return float(value["share"] if isinstance(value, Mapping) else value)
